"""Preparation: what it removes is gone, what tells actions apart stays."""

from __future__ import annotations

import numpy as np
import pytest
from cases import cases
from hypothesis import given, settings
from hypothesis import strategies as st

from actioncli.clips.clip import Clip, FloatArray
from actioncli.clips.prepare import Preparation, prepare, prepare_all, prepared_at, sample
from actioncli.clips.skeleton import BONES, DEFAULT_JOINTS, mirrored_columns
from actioncli.errors import ClipError

from . import bodies

PAPER = Preparation()
FULL = Preparation(size="standard", heading=True, motion=0.5)
AT = {name: column for column, name in enumerate(DEFAULT_JOINTS)}


def waving(frames: int = 40, seed: int = 0) -> FloatArray:
    """A person who faces the sensor, left at smaller x, and waves with the left hand."""
    jitter = np.random.default_rng(seed).normal(0, 0.002, (frames, 15, 3))
    return np.asarray(bodies.waving(frames) + jitter, np.float32)


def prepared(joints: FloatArray, preparation: Preparation = FULL) -> FloatArray:
    return prepare(Clip(joints, DEFAULT_JOINTS), preparation)


def turned(joints: FloatArray, angle: float) -> FloatArray:
    cos, sin = np.cos(angle), np.sin(angle)
    return np.asarray(joints @ np.array([[cos, 0, -sin], [0, 1, 0], [sin, 0, cos]]), np.float32)


def test_the_paper_only_centres_and_samples() -> None:
    joints = waving()
    ours = prepared(joints, PAPER)
    assert ours.shape == (16, 15, 3)
    hips = (joints[:, AT["lhip"]] + joints[:, AT["rhip"]]) / 2
    np.testing.assert_allclose(ours[0], joints[0] - hips[0], atol=0.02)
    np.testing.assert_allclose(ours[:, AT["pelv"]], 0, atol=1e-6)


@given(angle=st.floats(-3.1, 3.1), shift=st.tuples(*[st.floats(-5, 5)] * 3))
@settings(max_examples=cases(30))
def test_place_and_heading_do_not_matter(angle: float, shift: tuple[float, ...]) -> None:
    joints = waving()
    moved = turned(joints, angle) + np.array(shift, np.float32)
    np.testing.assert_allclose(prepared(moved), prepared(joints), atol=2e-4)


def test_a_person_who_faces_the_sensor_is_not_turned() -> None:
    assert (
        prepared(waving())[:, AT["lsho"], 0].max() < 0 < prepared(waving())[:, AT["rsho"], 0].min()
    )


@given(size=st.floats(0.4, 2.0))
@settings(max_examples=cases(20))
@pytest.mark.parametrize("body", ["torso", "standard"])
def test_body_size_does_not_matter(body: str, size: float) -> None:
    how = Preparation(size=body)  # type: ignore[arg-type]  # parametrised
    joints = waving()
    np.testing.assert_allclose(
        prepared(joints * np.float32(size), how), prepared(joints, how), atol=1e-3
    )


def test_standard_bodies_have_standard_bones_and_the_same_directions() -> None:
    ours = prepared(waving())
    for joint, parent, length in BONES:
        bone = ours[:, AT[joint]] - ours[:, AT[parent]]
        np.testing.assert_allclose(np.linalg.norm(bone, axis=1), length, rtol=1e-3)
    joints = waving()
    before = joints[0, AT["lkne"]] - joints[0, AT["lhip"]]
    after = ours[0, AT["lkne"]] - ours[0, AT["lhip"]]
    assert before @ after / np.linalg.norm(before) / np.linalg.norm(after) > 0.999


def test_a_bone_without_length_stays_finite() -> None:
    joints = waving()
    joints[:, AT["lwri"]] = joints[:, AT["lelb"]]
    assert np.isfinite(prepared(joints)).all()


def test_left_and_right_stay_apart() -> None:
    joints = waving()
    mirrored = joints * np.array([-1, 1, 1], np.float32)
    swap = mirrored_columns(DEFAULT_JOINTS)
    other_hand = prepared(mirrored[:, swap])
    ours = prepared(joints)
    np.testing.assert_allclose(other_hand, ours[:, swap] * [-1, 1, 1], atol=1e-3)
    assert np.abs(other_hand - ours).max() > 0.5


def test_idling_takes_few_frames_when_motion_is_the_clock() -> None:
    joints = waving(seed=0)
    still = np.repeat(joints[:1], 60, axis=0)
    idle = np.concatenate([still, joints, np.repeat(joints[-1:], 60, axis=0)])
    by_time = np.abs(prepared(idle, Preparation()) - prepared(joints, Preparation())).mean()
    by_motion = Preparation(motion=1.0)
    assert np.abs(prepared(idle, by_motion) - prepared(joints, by_motion)).mean() < 0.3 * by_time


@given(frames=st.integers(2, 200), wanted=st.integers(2, 48), motion=st.floats(0, 1))
@settings(max_examples=cases(40))
def test_first_and_last_frame_are_kept(frames: int, wanted: int, motion: float) -> None:
    joints = waving(frames)
    ours = sample(joints, wanted, motion)
    assert ours.shape == (wanted, 15, 3)
    np.testing.assert_allclose(ours[0], joints[0], atol=1e-5)
    np.testing.assert_allclose(ours[-1], joints[-1], atol=1e-3)


def test_a_layout_without_wrists_is_refused_with_names() -> None:
    names = [f"joint{i}" for i in range(15)]
    with pytest.raises(ClipError, match=r"lwri.*--layout"):
        prepare(Clip(waving(), names), PAPER)


@pytest.mark.parametrize("motion", [0.0, 0.5])
def test_prepared_at_tells_which_frames_were_taken(motion: float) -> None:
    clip = Clip(waving(), DEFAULT_JOINTS)
    wanted = Preparation(frames=9, motion=motion)
    at = prepared_at(clip, wanted)
    assert (at[0], at[-1]) == (0, pytest.approx(39))
    assert (np.diff(at) > 0).all()
    hand = clip.joints[:, AT["lwri"]] - clip.joints[:, AT["pelv"]]
    taken = np.stack([np.interp(at, np.arange(40), hand[:, axis]) for axis in range(3)], axis=1)
    np.testing.assert_allclose(prepare(clip, wanted)[:, AT["lwri"]], taken, atol=0.01)


@pytest.mark.parametrize("preparation", [PAPER, Preparation(size="torso"), FULL])
def test_many_clips_are_prepared_as_each_alone(preparation: Preparation) -> None:
    others = tuple(reversed(DEFAULT_JOINTS))
    clips = [
        Clip(waving(2), DEFAULT_JOINTS),
        Clip(waving(40, seed=1), DEFAULT_JOINTS),
        Clip(turned(waving(17, seed=2), 1.0)[:, ::-1], others),
        Clip(waving(90, seed=3), DEFAULT_JOINTS),
    ]
    together = prepare_all(clips, preparation)
    for clip, frames in zip(clips, together, strict=True):
        np.testing.assert_allclose(frames, prepare(clip, preparation), atol=1e-5)
    assert prepare_all([], preparation).shape == (0, *together.shape[1:])
