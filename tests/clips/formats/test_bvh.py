from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from actioncli.clips.formats.bvh import read
from actioncli.clips.read import read_clip
from actioncli.errors import AmbiguousClipError, ClipError

from ..bodies import waving, write_bvh

ARM = """HIERARCHY
ROOT Hips
{
  OFFSET 0 0 0
  CHANNELS 6 Xposition Yposition Zposition Zrotation Xrotation Yrotation
  JOINT LeftArm
  {
    OFFSET 1 2 0
    CHANNELS 3 zrotation xrotation yrotation
    JOINT LeftForeArm
    {
      OFFSET 3 0 0
      CHANNELS 3 Zrotation Xrotation Yrotation
      End Site
      {
        OFFSET 1 0 0
      }
    }
  }
}
MOTION
Frames: 3
Frame Time: 0.04
10 20 30 0 0 0 0 0 0 0 0 0
10 20 30 90 0 0 0 0 0 0 0 0
0 0 0 0 0 90 90 90 0 0 0 0
"""


def write(tmp_path: Path, text: str) -> Path:
    (tmp_path / "a.bvh").write_text(text)
    return tmp_path / "a.bvh"


def test_forward_kinematics_by_hand(tmp_path: Path) -> None:
    # Position channels replace the root's offset.
    text = ARM.replace("OFFSET 0 0 0\n  CH", "OFFSET 5 5 5\n  CH")
    recording = read(write(tmp_path, text))
    root, arm, forearm = recording.positions[:, 0].swapaxes(0, 1)
    np.testing.assert_allclose(root, [[10, 20, 30], [10, 20, 30], [0, 0, 0]], atol=1e-5)
    # Frame 1: nothing turned. Frame 2: a quarter turn of the root about z takes x to y, y to -x.
    np.testing.assert_allclose(arm[:2], [[11, 22, 30], [8, 21, 30]], atol=1e-5)
    np.testing.assert_allclose(forearm[:2], [[14, 22, 30], [8, 24, 30]], atol=1e-5)
    # Frame 3: a quarter turn about y takes x to -z: the arm from (1, 2, 0) to (0, 2, -1). Its own
    # turn is Z(90) X(90): X leaves the bone (3, 0, 0), Z makes it (0, 3, 0), the root's leaves it.
    np.testing.assert_allclose(arm[2], [0, 2, -1], atol=1e-5)
    np.testing.assert_allclose(forearm[2], [0, 5, -1], atol=1e-5)
    assert recording.joint_names == ("Hips", "LeftArm", "LeftForeArm")
    assert recording.fps == 25


def test_the_order_of_channels_is_the_order_of_rotations(tmp_path: Path) -> None:
    # Y(90) then Z(90) in the file's order Y Z: the bone x goes by Z to y, which Y leaves.
    swapped = ARM.replace("3 zrotation xrotation yrotation", "3 Yrotation Zrotation Xrotation")
    swapped = swapped.replace("0 0 0 0 0 90 90 90 0 0 0 0", "0 0 0 0 0 0 90 90 0 0 0 0")
    forearm = read(write(tmp_path, swapped)).positions[2, 0, 2]
    np.testing.assert_allclose(forearm, [1, 5, 0], atol=1e-5)


def test_a_person_who_lies_stands_in_the_rest_pose(tmp_path: Path) -> None:
    lying = waving()[..., [1, 0, 2]] * np.array([1, -1, 1])
    clip = read_clip(write_bvh(tmp_path / "a.bvh", lying))
    np.testing.assert_allclose(clip.joints, lying, atol=1e-4)
    below = (waving() - np.array([0, 0, 2.5]))[..., [0, 2, 1]] * np.array([1, -1, 1])
    with pytest.raises(AmbiguousClipError, match="rest pose"):
        read_clip(write_bvh(tmp_path / "b.bvh", below))


def test_the_origin_is_a_place_like_any_other(tmp_path: Path) -> None:
    centred = waving() - waving()[:, :1]
    clip = read_clip(write_bvh(tmp_path / "a.bvh", centred, scale=100))
    np.testing.assert_allclose(clip.joints, centred, atol=1e-4)
    assert clip.fps == pytest.approx(30, abs=0.01)


def test_several_figures(tmp_path: Path) -> None:
    one = ARM[ARM.index("ROOT") : ARM.index("MOTION")]
    text = (
        "HIERARCHY\n" + one + one.replace("Hips", "Hips2") + "MOTION\nFrames: 2\nFrame Time: 0.1\n"
    )
    still, moving = ["0"] * 12, ["5", *["0"] * 11]
    text += " ".join(still * 2) + "\n" + " ".join(still + moving) + "\n"
    recording = read(write(tmp_path, text))
    assert recording.joint_names == ("Hips2", "LeftArm", "LeftForeArm")
    assert recording.notes == ("2 figures in the file: took the one below Hips2, who moves most",)


def test_names_that_appear_twice_or_hold_blanks(tmp_path: Path) -> None:
    text = ARM.replace("JOINT LeftForeArm", "JOINT LeftArm").replace(
        "ROOT Hips\n{", "ROOT My Hips {"
    )
    assert read(write(tmp_path, text)).joint_names == ("My Hips", "LeftArm", "LeftArm#2")


def test_fewer_frames_than_announced_are_noted(tmp_path: Path) -> None:
    recording = read(write(tmp_path, ARM.replace("Frames: 3", "Frames:\t999999999")))
    assert recording.notes == ("3 of 999999999 announced frames are there",)
    assert read(write(tmp_path, ARM.replace("0.04", "0"))).fps is None


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("ROOT Hips", "JOINT Hips", "line 2: joint in the wrong place"),
        ("JOINT LeftArm", "ROOT LeftArm", "root in the wrong place"),
        ("HIERARCHY", "HELLO", "'hello' is not understood"),
        ("OFFSET 1 2 0", "OFFSET 1 2", "offset of three numbers"),
        ("OFFSET 1 2 0", "OFFSET 1 2 nan", "not finite"),
        ("CHANNELS 6", "CHANNELS 60", "up to 6 channels"),
        ("Xposition", "Wposition", "channels must be"),
        ("Yposition Zposition", "Xposition Zposition", "up to 6 channels and their names"),
        ("}\nMOTION", "MOTION", "motion before a complete skeleton"),
        ("}\nMOTION", "}}\nMOTION", "a bracket too many"),
        ("{\n  OFFSET 0 0 0\n  CH", "{{\n  OFFSET 0 0 0\n  CH", "bracket in the wrong place"),
        ("Frames: 3", "Frames: -3", "'Frames:' must be a count"),
        ("Frames: 3", "", "'Frames:' and 'Frame Time:' expected"),
        ("10 20 30 90", "10 20 90", "line 25 has 11 of 12 channels"),
        ("10 20 30 90", "10 20 30 x", "line 25: .*'x'"),
        ("10 20 30 90", "10 20 30 inf", "NaN or infinity"),
        (ARM[ARM.index("JOINT LeftForeArm") :], "", "is cut off"),
        (ARM[ARM.index("10 20 30 90") :], "", "at least 2 frames"),
        (ARM, "HIERARCHY\nROOT a\n{\n" + "JOINT a\n{\n" * 5000, "more than 1024 joints"),
    ],
)
def test_damage(tmp_path: Path, old: str, new: str, message: str) -> None:
    assert old in ARM
    with pytest.raises(ClipError, match=rf"a\.bvh: .*{message}"):
        read(write(tmp_path, ARM.replace(old, new, 1)))
