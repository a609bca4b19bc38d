"""Poses of a video, as a clip."""

import numpy as np
import pytest

from actioncli.pose.poses import Poses


def test_a_clip_knows_when_in_the_video_it_begins() -> None:
    rng = np.random.default_rng(0)
    times = 2 + np.arange(31) / 15
    world = rng.normal(size=(31, 33, 3)).astype(np.float32)
    ones = np.ones((31, 33), np.float32)
    poses = Poses(times, world, ones, np.stack([ones, ones], axis=2), times, (640, 480))
    assert poses.to_clip("a.mp4").start == pytest.approx(2)
    clip = poses.between(2.99, 3.51).to_clip("a.mp4")
    assert clip.start == pytest.approx(3)
    assert clip.duration == pytest.approx(7 / 15)
