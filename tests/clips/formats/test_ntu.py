from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from actioncli.clips.formats.ntu import read
from actioncli.clips.read import read_clip
from actioncli.clips.skeleton import LAYOUTS
from actioncli.errors import ClipError

from ..bodies import kinect_v2, waving, write_ntu

BODY = kinect_v2(waving())
OTHER = np.repeat(BODY[:1], 40, axis=0) + np.array([1.5, 0, 0])


def test_one_body(tmp_path: Path) -> None:
    recording = read(write_ntu(tmp_path / "a.skeleton", [[("72057594037", body)] for body in BODY]))
    np.testing.assert_allclose(recording.positions[:, 0], BODY, atol=1e-5)
    assert recording.joint_names == LAYOUTS["kinect_v2_25"]
    assert (recording.fps, recording.unit, recording.up) == (30, "m", "y")
    assert recording.confidence is not None
    assert (recording.confidence == 1).all()
    assert recording.notes == ()


def test_the_body_that_moves_most(tmp_path: Path) -> None:
    frames = [[("5", other), ("9", body)] for other, body in zip(OTHER, BODY, strict=True)]
    frames[3], frames[4] = [], [("9", BODY[4])]
    clip = read_clip(write_ntu(tmp_path / "a.skeleton", frames))
    assert "took body 9" in clip.notes[0]
    np.testing.assert_allclose(np.delete(clip.joints, 3, 0), np.delete(BODY, 3, 0), atol=1e-4)


def test_a_new_number_for_the_same_person(tmp_path: Path) -> None:
    frames = [[("5" if at < 20 else "8", body)] for at, body in enumerate(BODY)]
    frames[20] = []
    clip = read_clip(write_ntu(tmp_path / "a.skeleton", frames))
    assert len(clip) == 40
    assert "bodies 5 and 8 taken as one person" in clip.notes


def test_frames_before_and_after_the_body_are_dropped(tmp_path: Path) -> None:
    frames = [[("5", body)] if 28 <= at < 38 else [] for at, body in enumerate(BODY)]
    clip = read_clip(write_ntu(tmp_path / "a.skeleton", frames))
    assert clip.notes == ("30 frames without a body at the ends dropped",)
    np.testing.assert_allclose(clip.joints, BODY[28:38], atol=1e-5)


def test_a_lost_joint_is_a_gap(tmp_path: Path) -> None:
    file = write_ntu(tmp_path / "a.skeleton", [[("5", body)] for body in BODY])
    lines = file.read_text().splitlines()
    # Frame 0, body 0, joint 0 is line 4 of the file; 2 is "tracked", 0 "lost".
    lines[4] = lines[4][:-1] + "0"
    lines[5] = lines[5][:-1] + "1"
    file.write_text("\n".join(lines))
    recording = read(file)
    assert np.isnan(recording.positions[0, 0, 0]).all()
    assert np.isfinite(recording.positions[0, 0, 1:]).all()
    assert recording.confidence is not None
    np.testing.assert_array_equal(recording.confidence[0, 0, :3], [0, 0.5, 1])


@pytest.mark.parametrize("value", [np.nan, np.inf])
@pytest.mark.parametrize("lost", ["5", "8"])
def test_a_body_whose_place_is_never_a_number(tmp_path: Path, value: float, lost: str) -> None:
    bodies = {"5": BODY.copy(), "8": OTHER.copy()}
    bodies[lost][:, 0, 0] = value
    frames = [[("5", bodies["5"][at])] for at in range(20)]
    frames += [[("8", bodies["8"][at])] for at in range(20, 40)]
    recording = read(write_ntu(tmp_path / "a.skeleton", frames))
    assert recording.people == ("body 5", "body 8")
    assert np.isfinite(recording.positions[:20, 0, 1:]).all()
    assert np.isfinite(recording.positions[20:, 1, 1:]).all()


def test_fewer_frames_than_announced_are_noted(tmp_path: Path) -> None:
    file = write_ntu(tmp_path / "a.skeleton", [[("5", body)] for body in BODY])
    lines = file.read_text().splitlines()
    file.write_text("\n".join(lines[: 1 + 10 * 28]))
    assert read(file).notes == ("is cut off: 10 of 40 announced frames are there",)
    file.write_text("\n".join(lines[: 10 + 10 * 28]))
    with pytest.raises(ClipError, match="cut off"):
        read(file)


@pytest.mark.parametrize(
    ("content", "message"),
    [
        ("", "number of frames"),
        ("hello", "line 1: the number of frames"),
        ("-3\n", "number of frames"),
        ("99999999999999\n", "number of frames"),
        ("3\n0\n0\n0\n", "nobody is in it .3 frames"),
        ("3\n-1\n", "line 2: the number of bodies"),
        ("3\n9\n", "number of bodies"),
        ("1\n1\n5 0\n20\n", "20 joints"),
        ("1\n1\nabc 0\n25\n", "tracking number"),
        ("1\n1\n5 0\n25\n1 2\n", "line 5: a joint's x y z"),
        ("1\n1\n5 0\n25\n1 2 wave\n", "line 5: .*wave"),
        ("1\n0\n0\n", "goes on after its 1 frames"),
    ],
)
def test_damage(tmp_path: Path, content: str, message: str) -> None:
    (tmp_path / "a.skeleton").write_text(content)
    with pytest.raises(ClipError, match=rf"a\.skeleton: .*{message}"):
        read(tmp_path / "a.skeleton")
