"""Poses of a video, as a clip."""

import numpy as np
import pytest

from actioncli.clips.parts import PARTS, prepare_parts
from actioncli.clips.prepare import Preparation
from actioncli.clips.skeleton import LAYOUTS
from actioncli.pose.hands import SIDES
from actioncli.pose.poses import Poses
from actioncli.pose.sides import TWINS


def random_poses(joints: int, frames: int = 31) -> Poses:
    """Somebody who trembles, followed at 15 frames a second from 2 s on."""
    rng = np.random.default_rng(0)
    times = 2 + np.arange(frames) / 15
    still = rng.normal(size=(joints, 3))
    world = (still + 0.01 * rng.normal(size=(frames, joints, 3))).astype(np.float32)
    ones = np.ones((frames, joints), np.float32)
    return Poses(times, world, ones, np.stack([ones, ones], axis=2), times, (640, 480))


def test_a_clip_knows_when_in_the_video_it_begins() -> None:
    poses = random_poses(33)
    assert poses.to_clip("a.mp4").start == pytest.approx(2)
    clip = poses.between(2.99, 3.51).to_clip("a.mp4")
    assert clip.start == pytest.approx(3)
    assert clip.duration == pytest.approx(7 / 15)
    assert clip.joint_names == LAYOUTS["blazepose_33"]


def test_a_hand_that_was_not_seen_is_missing_and_the_other_is_not() -> None:
    poses = random_poses(75)
    (_, left), _ = SIDES
    poses.visibility[10:25, left] = 0
    poses.world[10:25, left] = 9
    clip = poses.to_clip("a.mp4")
    assert clip.joint_names == LAYOUTS["holistic_75"]
    assert clip.confidence is not None
    np.testing.assert_array_equal(np.isnan(clip.joints[..., 0]), clip.confidence == 0)
    gone = np.isnan(clip.joints[:, left]).all(axis=(1, 2))
    assert np.flatnonzero(gone).tolist() == list(range(10, 25))
    assert np.isfinite(np.delete(clip.joints, range(left.start, left.stop), axis=1)).all()
    # What is not seen draws nothing towards itself.
    assert np.nanmax(np.abs(clip.joints)) < 6
    for (wrist, *_), own in SIDES:
        np.testing.assert_allclose(
            clip.joints[:, own.start][~gone], clip.joints[:, wrist][~gone], atol=1e-5
        )
    parts = prepare_parts([clip], Preparation(frames=48, motion=0.5))
    missing = dict(zip(PARTS, parts.missing[0].mean(axis=0), strict=True))
    assert 0.3 < missing["left hand"] < 0.7
    assert not missing["right hand"]


def test_a_hand_seen_in_one_frame_is_missing() -> None:
    poses = random_poses(75)
    (_, left), _ = SIDES
    poses.visibility[:, left] = 0
    poses.visibility[4, left] = 1
    assert np.isnan(poses.to_clip("a.mp4").joints[:, left]).all()


def test_a_hand_goes_with_the_arm_that_changed_sides() -> None:
    poses = random_poses(75)
    straight = poses.to_clip("a.mp4").joints
    crossed = np.arange(12, 15)
    arms = np.r_[0:23, 33:75]
    for values in (poses.world, poses.visibility):
        values[np.ix_(crossed, arms)] = values[np.ix_(crossed, TWINS[arms])]
    clip = poses.to_clip("a.mp4")
    assert any("put right" in note for note in clip.notes)
    np.testing.assert_allclose(clip.joints, straight, atol=1e-5)
