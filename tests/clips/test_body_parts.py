"""Body parts over time: what was not seen gives no numbers."""

from __future__ import annotations

import numpy as np
import pytest

from actioncli import Clip
from actioncli.clips.clip import FloatArray
from actioncli.clips.parts import LONGEST_GAP, PARTS, PartFrames, prepare_parts
from actioncli.clips.prepare import Preparation, prepare
from actioncli.clips.skeleton import BONES, DEFAULT_JOINTS, HAND_JOINTS
from actioncli.model.parts_config import PartsConfig

FRAMES, FPS = 40, 20.0
PREPARATION: Preparation = PartsConfig().preparation
REST = np.array(
    [
        (0, 1, 0), (-0.1, 1, 0), (0.1, 1, 0), (-0.1, 0.5, 0), (0.1, 0.5, 0),
        (-0.1, 0.1, 0), (0.1, 0.1, 0), (0, 1.5, 0), (0, 1.7, 0), (-0.2, 1.5, 0),
        (0.2, 1.5, 0), (-0.25, 1.2, 0), (0.25, 1.2, 0), (-0.25, 0.95, 0), (0.25, 0.95, 0),
    ],
    np.float32,
)  # fmt: skip
LEGS = [DEFAULT_JOINTS.index(name) for name in ("lkne", "rkne", "lank", "rank")]


def body() -> FloatArray:
    rng = np.random.default_rng(0)
    swing = rng.normal(0, 0.1, (15, 3)).astype(np.float32)
    time = np.linspace(0, 1, FRAMES, dtype=np.float32)[:, None, None]
    joints = REST + swing * np.sin(np.pi * time)
    joints[:, 0] = joints[:, 1:3].mean(axis=1)
    joints[:, 7] = joints[:, 9:11].mean(axis=1)
    return np.asarray(joints, np.float32)


def with_hands(joints: FloatArray) -> FloatArray:
    fingers = np.random.default_rng(1).normal(0, 0.05, (len(joints), 42, 3)).astype(np.float32)
    return np.concatenate([joints, fingers + joints[:, -2:].mean(axis=1, keepdims=True)], axis=1)


def prepared(joints: FloatArray, confidence: FloatArray | None = None) -> PartFrames:
    names = (*DEFAULT_JOINTS, *HAND_JOINTS)[: joints.shape[1]]
    return prepare_parts([Clip(joints, names, FPS, confidence)], PREPARATION)


def test_bones_are_those_of_the_standard_body() -> None:
    clip = Clip(body(), DEFAULT_JOINTS, FPS)
    frames = prepare(clip, PREPARATION)
    parents = [DEFAULT_JOINTS.index(parent) for _, parent, _ in BONES]
    children = [DEFAULT_JOINTS.index(child) for child, _, _ in BONES]
    lengths = np.array([length for _, _, length in BONES])[:, None]
    expected = (frames[:, children] - frames[:, parents]) / lengths
    found = prepare_parts([clip], PREPARATION)
    np.testing.assert_allclose(found.bones[0], expected, atol=1e-4)
    assert not found.missing[0, :, :5].any()
    assert found.missing[0, :, 5:].all()
    assert not found.hands.any()


@pytest.mark.parametrize("lost", [("lkne", "rkne", "lank", "rank"), ("lwri",), ("lhip", "rhip"),
                                  ("head",), ("relb", "rwri", "lkne")])  # fmt: skip
def test_the_place_of_an_unseen_joint_changes_nothing(lost: tuple[str, ...]) -> None:
    joints = with_hands(body())
    confidence = np.ones(joints.shape[:2], np.float32)
    at = [DEFAULT_JOINTS.index(name) for name in lost]
    confidence[:, at] = 0.05
    elsewhere = joints.copy()
    elsewhere[:, at] += np.random.default_rng(2).normal(0, 1, (FRAMES, len(at), 3))
    if "lhip" in lost:
        elsewhere[:, 0] = elsewhere[:, 1:3].mean(axis=1)
    for one, other in zip(
        prepared(joints, confidence), prepared(elsewhere, confidence), strict=True
    ):
        np.testing.assert_array_equal(one, other)


def test_what_was_not_seen_is_missing_and_the_rest_is_not() -> None:
    joints = with_hands(body())
    confidence = np.ones(joints.shape[:2], np.float32)
    confidence[:, LEGS] = 0
    confidence[:, 15:36] = 0  # the left hand
    missing = prepared(joints, confidence).missing[0]
    gone = [PARTS.index(name) for name in ("left leg", "right leg", "left hand")]
    assert missing[:, gone].all()
    assert not np.delete(missing, gone, axis=1).any()


def test_short_gaps_are_interpolated_and_long_ones_are_missing() -> None:
    joints = body()
    wrist, arm = DEFAULT_JOINTS.index("rwri"), PARTS.index("right arm")
    short = int(LONGEST_GAP * FPS)
    for length, missing in ((short, False), (short + 2, True)):
        confidence = np.ones(joints.shape[:2], np.float32)
        confidence[15 : 15 + length, wrist] = 0
        broken = joints.copy()
        broken[15 : 15 + length, wrist] = 50
        found = prepared(broken, confidence)
        assert found.missing[0, :, arm].any() == missing
        np.testing.assert_allclose(found.bones, prepared(joints).bones, atol=0.2)


def test_hands_turn_with_the_body() -> None:
    joints = with_hands(body())
    turn = np.array([[0.6, 0, 0.8], [0, 1, 0], [-0.8, 0, 0.6]], np.float32)
    for one, other in zip(prepared(joints), prepared(joints @ turn.T), strict=True):
        np.testing.assert_allclose(one, other, atol=1e-4)
