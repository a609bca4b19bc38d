"""Body parts over time: what was not seen gives no numbers."""

from __future__ import annotations

import numpy as np
import pytest

from actioncli import Clip
from actioncli.clips.clip import FloatArray
from actioncli.clips.gaps import LONGEST_GAP
from actioncli.clips.parts import PARTS, PartFrames, prepare_parts
from actioncli.clips.prepare import prepare
from actioncli.clips.skeleton import BONES, DEFAULT_JOINTS, HAND_JOINTS, bone_columns
from actioncli.model.config import PartsConfig

from .bodies import waving

FPS = 20.0
PREPARATION = PartsConfig().preparation


def with_hands() -> FloatArray:
    """A waving person, and fingers that move about the wrists."""
    body = waving()
    fingers = np.random.default_rng(1).normal(0, 0.05, (len(body), 42, 3))
    fingers += np.repeat(body[:, -2:], 21, axis=1)
    return np.concatenate([body, fingers], axis=1).astype(np.float32)


def prepared(joints: FloatArray, confidence: FloatArray | None = None) -> PartFrames:
    names = (*DEFAULT_JOINTS, *HAND_JOINTS)[: joints.shape[1]]
    return prepare_parts([Clip(joints, names, FPS, confidence)], PREPARATION)


def test_bones_are_those_of_the_standard_body() -> None:
    clip = Clip(waving(), DEFAULT_JOINTS, FPS)
    children, parents = bone_columns(DEFAULT_JOINTS)
    frames = prepare(clip, PREPARATION)
    lengths = np.array([length for _, _, length in BONES])[:, None]
    found = prepare_parts([clip], PREPARATION)
    expected = (frames[:, children] - frames[:, parents]) / lengths
    np.testing.assert_allclose(found.bones[0], expected, atol=1e-4)
    assert not found.missing[0, :, :5].any()
    assert found.missing[0, :, 5:].all()
    assert not found.hands.any()


@pytest.mark.parametrize(
    ("lost", "parts"),
    [
        ("lkne rkne lank rank", [3, 4]),
        ("lwri", [1]),
        ("lhip rhip", []),
        ("head", []),
        ("relb rwri lkne", [2, 3]),
        (" ".join(HAND_JOINTS[:21]), [5]),
    ],
)
def test_what_was_not_seen_is_missing_and_its_place_changes_nothing(
    lost: str, parts: list[int]
) -> None:
    joints = with_hands()
    confidence = np.ones(joints.shape[:2], np.float32)
    at = [(*DEFAULT_JOINTS, *HAND_JOINTS).index(name) for name in lost.split()]
    confidence[:, at] = 0.05
    elsewhere = joints.copy()
    elsewhere[:, at] += np.random.default_rng(2).normal(0, 1, (len(joints), len(at), 3))
    found, other = prepared(joints, confidence), prepared(elsewhere, confidence)
    for one, two in zip(found, other, strict=True):
        np.testing.assert_array_equal(one, two)
    assert found.missing[0, :, parts].all()
    assert not np.delete(found.missing[0], parts, axis=1).any()


def test_short_gaps_are_interpolated_and_long_ones_are_missing() -> None:
    joints = waving().astype(np.float32)
    wrist, arm = DEFAULT_JOINTS.index("rwri"), PARTS.index("right arm")
    short = int(LONGEST_GAP * FPS)
    for length, missing in ((short, False), (short + 2, True)):
        confidence = np.ones(joints.shape[:2], np.float32)
        broken = joints.copy()
        confidence[15 : 15 + length, wrist], broken[15 : 15 + length, wrist] = 0, 50
        found = prepared(broken, confidence)
        assert found.missing[0, :, arm].any() == missing
        np.testing.assert_allclose(found.bones, prepared(joints).bones, atol=0.1)


def test_hands_turn_with_the_body() -> None:
    turn = np.array([[0.6, 0, 0.8], [0, 1, 0], [-0.8, 0, 0.6]], np.float32)
    turned = prepared(with_hands() @ turn.T)
    for one, other in zip(prepared(with_hands()), turned, strict=True):
        np.testing.assert_allclose(one, other, atol=1e-3)
