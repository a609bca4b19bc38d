from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from actioncli.clips.formats.trc import read
from actioncli.clips.read import read_clip
from actioncli.clips.skeleton import DEFAULT_JOINTS
from actioncli.errors import ClipError

from ..bodies import waving, write_trc


def test_joints_unit_and_rate(tmp_path: Path) -> None:
    recording = read(write_trc(tmp_path / "a.trc", 1000 * waving(), "mm", 59.94))
    np.testing.assert_allclose(recording.positions[:, 0], 1000 * waving(), atol=1e-3)
    assert (recording.joint_names, recording.unit, recording.fps) == (DEFAULT_JOINTS, "mm", 59.94)


def test_missing_numbers(tmp_path: Path) -> None:
    body = waving()
    body[3, 4] = body[5, -1] = np.nan
    file = write_trc(tmp_path / "a.trc", body)
    file.write_text("\n".join(line.rstrip("\t") for line in file.read_text().split("\n")))
    np.testing.assert_allclose(read(file).positions[:, 0], body, atol=1e-5)
    filled = read_clip(file).joints
    np.testing.assert_allclose(filled[3, 4], (body[2, 4] + body[4, 4]) / 2, atol=1e-4)


@pytest.mark.parametrize("separator", [",", " "])
def test_other_separators(tmp_path: Path, separator: str) -> None:
    file = write_trc(tmp_path / "a.trc", waving())
    text = file.read_text()
    if separator == " ":
        text = " ".join(text.split("\t")).replace("   ", " ")
    file.write_text(text.replace("\t", separator))
    recording = read(file)
    np.testing.assert_allclose(recording.positions[:, 0], waving(), atol=1e-5)
    assert (recording.joint_names, recording.unit) == (DEFAULT_JOINTS, "m")


def test_the_rate_from_times(tmp_path: Path) -> None:
    file = write_trc(tmp_path / "a.trc", waving(), rate=50)
    file.write_text(file.read_text().replace("50\t50\t40", "\t\t40"))
    assert read(file).fps == 50


def test_fewer_frames_than_announced_are_noted(tmp_path: Path) -> None:
    file = write_trc(tmp_path / "a.trc", waving())
    file.write_text("\n".join(file.read_text().split("\n")[:16]))
    assert read(file).notes == ("is cut off: 10 of 40 announced frames are there",)


@pytest.mark.parametrize(
    ("content", "message"),
    [
        ("hello", "not a TRC file"),
        ("PathFileType\t4\nDataRate\n30\nFrame#\tTime\n", "names 0 markers"),
        ("PathFileType\t4\nDataRate\n30\nFrame#\tTime\ta\n1\t0\t1\t2\t3\n", "this has 1"),
        ("DataRate\n30\nFrame#\tTime\ta\n1\t0\t1\t2\t3\n2\t0\t1\tx\t3\n", "line 5: .*'x'"),
        ("DataRate\n30\nFrame#\tTime\ta\n1\t0\t1\t2\t3\t4\n", "more|line 4 has 6 of 5"),
        ("DataRate\n30\nFrame# Time a\n1 0 1 2\n", "line 4 has 4 of 5"),
    ],
)
def test_damage(tmp_path: Path, content: str, message: str) -> None:
    (tmp_path / "a.trc").write_text(content)
    with pytest.raises(ClipError, match=rf"a\.trc: .*({message})"):
        read(tmp_path / "a.trc")
