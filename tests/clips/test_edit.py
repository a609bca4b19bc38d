from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from actioncli.clips.clip import Clip
from actioncli.clips.edit import cut, mirrored, resample
from actioncli.clips.read import read_clip
from actioncli.clips.skeleton import DEFAULT_JOINTS, select_joints

from .bodies import waving

EXAMPLES = Path(__file__).parents[2] / "examples"


def test_a_part_begins_within_its_clip() -> None:
    part = cut(Clip(waving(100), DEFAULT_JOINTS, 20.0, np.ones((100, 15))), 1, 3)
    assert (part.start, part.duration) == (1, pytest.approx(2))
    assert part.confidence is not None
    assert cut(part, 0.5, 1).start == pytest.approx(1.5)


def test_values_at_other_times() -> None:
    times, values = np.array([0.0, 1.0, 3.0]), np.array([[0, 1], [2, 1], [4, 5]], np.float32)
    found = resample(values, times, np.array([-1, 0.5, 2, 9]))
    np.testing.assert_allclose(found, [[0, 1], [1, 1], [3, 3], [4, 5]])


def test_the_mirror_exchanges_the_sides_of_whatever_layout() -> None:
    clip = read_clip(EXAMPLES / "wave_right/ada.npz")
    image = mirrored(clip)
    assert image.joint_names == DEFAULT_JOINTS
    names = list(DEFAULT_JOINTS)
    joints = select_joints(clip.joints, clip.joint_names, names)
    flip = np.array([-1, 1, 1], np.float32)
    np.testing.assert_array_equal(
        image.joints[:, names.index("lwri")], joints[:, names.index("rwri")] * flip
    )
    np.testing.assert_array_equal(mirrored(image).joints, joints)
    assert mirrored(image).joint_names == DEFAULT_JOINTS
    seen = np.ones((len(clip), 15), np.float32)
    seen[:, names.index("lwri")] = 0.25
    half = mirrored(Clip(joints, names, clip.fps, seen))
    assert half.confidence is not None
    assert (half.confidence[:, names.index("rwri")] == 0.25).all()
