from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from actioncli.clips.formats.csv_file import read
from actioncli.clips.skeleton import DEFAULT_JOINTS
from actioncli.errors import ClipError

from ..bodies import waving, write_csv

STYLES: list[Callable[[str, str], str]] = [
    "{}_{}".format,
    "{}.{}".format,
    "{} {}".format,
    "{}:{}".format,
    "{}-{}".format,
    '"{} ({})"'.format,
    "{}[{}]".format,
    "{}_pos_{}".format,
    "{}.position.{}".format,
    "{1}_{0}".format,
    "{1}.{0}".format,
    lambda joint, axis: f"{joint}_{axis.upper()}",
    lambda joint, axis: f"{joint}{axis.upper()}",
    lambda joint, axis: f"{axis.upper()} {joint}",
    "{}_{} (mm)".format,
    "{}_{}_mm".format,
    "{}.{} [mm]".format,
]


@pytest.mark.parametrize("style", STYLES)
def test_headers(tmp_path: Path, style: Callable[[str, str], str]) -> None:
    recording = read(write_csv(tmp_path / "a.csv", waving(), style))
    assert recording.joint_names == DEFAULT_JOINTS
    assert recording.unit == ("mm" if "mm" in style("a", "x") else None)
    np.testing.assert_allclose(recording.positions[:, 0], waving(), atol=1e-5)


@pytest.mark.parametrize("style", ["x{at}", "lm_{at}_x", "joint{at}_x", "{at}_x", "X{at}"])
def test_joints_that_are_only_counted(tmp_path: Path, style: str) -> None:
    flip = "X" if "X" in style else "x"
    header = [style.replace(flip, axis if flip == "x" else axis.upper(), 1).format(at=at)
              for axis in "xyz" for at in range(15)]  # fmt: skip
    body = waving().transpose(0, 2, 1).reshape(40, -1)
    lines = [",".join(header), *(",".join(map(str, row)) for row in body)]
    (tmp_path / "a.csv").write_text("\n".join(lines))
    recording = read(tmp_path / "a.csv")
    assert recording.joint_names is None
    np.testing.assert_allclose(recording.positions[:, 0], waving(), atol=1e-5)


@pytest.mark.parametrize(("separator", "point"), [(",", "."), ("\t", "."), (";", "."), (";", ",")])
def test_separators_bom_and_crlf(tmp_path: Path, separator: str, point: str) -> None:
    text = write_csv(tmp_path / "a.csv", waving(), sep=separator).read_text().replace(".", point)
    for encoding in ("utf-8-sig", "utf-16"):
        (tmp_path / "a.csv").write_bytes(text.replace("\n", "\r\n").encode(encoding))
        recording = read(tmp_path / "a.csv")
        assert recording.joint_names == DEFAULT_JOINTS
        np.testing.assert_allclose(recording.positions[:, 0], waving(), atol=1e-5)


def test_other_columns(tmp_path: Path) -> None:
    lines = ["frame,time,label,lsho_x,lsho_y,lsho_z,lsho_visibility"]
    lines += [f'{at},{at / 25},"wave, left",1,{at},,0.5' for at in range(4)]
    (tmp_path / "a.csv").write_text("\n".join(lines))
    recording = read(tmp_path / "a.csv")
    assert recording.fps == 25
    assert recording.joint_names == ("lsho",)
    np.testing.assert_array_equal(recording.positions[:, 0, 0, 1], [0, 1, 2, 3])
    assert np.isnan(recording.positions[:, 0, 0, 2]).all()
    assert recording.confidence is not None
    assert (recording.confidence == 0.5).all()


@pytest.mark.parametrize(
    ("title", "step", "fps"),
    [("time", 0.04, 25), ("timestamp_ms", 40, 25), ("t", 40, 25), ("time_us", 40e3, 25),
     ("time", 0, None)],
)  # fmt: skip
def test_frame_rates(tmp_path: Path, title: str, step: float, fps: float | None) -> None:
    lines = [f"{title},a_x,a_y,a_z", *(f"{at * step},1,2,{at}" for at in range(5))]
    (tmp_path / "a.csv").write_text("\n".join(lines))
    assert read(tmp_path / "a.csv").fps == fps


def test_several_people(tmp_path: Path) -> None:
    lines = ["frame,person_id,a_x,a_y,a_z"]
    lines += [
        f"{at},{who},{at},{who},0.5" for at in range(4) for who in (7, 3) if (at, who) != (2, 3)
    ]
    (tmp_path / "a.csv").write_text("\n".join(lines))
    positions = read(tmp_path / "a.csv").positions
    assert positions.shape == (4, 2, 1, 3)
    np.testing.assert_array_equal(positions[:, 0, 0, 0], [0, 1, 2, 3])
    assert np.isnan(positions[2, 1]).all()


@pytest.mark.parametrize("title", ["{}", "pos_{}", "{} (cm)"])
def test_long_tables(tmp_path: Path, title: str) -> None:
    """A row a joint, by name or number, in any order, of people who are kept apart."""
    body = waving(5)
    for joints, names in ((DEFAULT_JOINTS, DEFAULT_JOINTS), (range(15), None)):
        axes = ",".join(title.format(axis) for axis in "xyz")
        lines = [f"Frame,person id,joint_name,{axes},confidence"]
        lines += [
            f"{frame},{who},{joint},{who + x:.5f},{y:.5f},{z:.5f},0.5"
            for at, joint in reversed([*enumerate(joints)])
            for frame in range(5)
            for who in range(2)
            for x, y, z in [body[frame, at]]
        ]
        (tmp_path / "a.csv").write_text("\n".join(lines))
        recording = read(tmp_path / "a.csv")
        assert recording.positions.shape == (5, 2, 15, 3)
        found = recording.positions if names is None else recording.positions[:, :, ::-1]
        np.testing.assert_allclose(found[:, 1] - [1, 0, 0], body, atol=1e-4)
        assert recording.joint_names == (names if names is None else names[::-1])
        assert recording.confidence is not None
        assert (recording.confidence == 0.5).all()
        assert recording.unit == ("cm" if "cm" in title else None)


@pytest.mark.parametrize(
    ("content", "message"),
    [
        ("1,2,3\n4,5,6\n", "first line names no joint"),
        ("lsho_x,lsho_y\n1,2\n", "'lsho' lacks x, y or z"),
        ("a_x,a_y,a_z\n1,2,3\n", "at least 2 frames, this has 1"),
        ("a_x,a_y,a_z\n1,2,3\n1,2\n", "line 3 has 2 of 3 columns"),
        ("a_x,a_y,a_z\n1,2,3\n1,5,2,5,3,5\n", "line 3 has 6 of 3 columns"),
        ("a_x,a_y,a_z\n1,2,3\n1,2,wave\n", "line 3: .*'wave'"),
        ("a_x,a_y,a_z\n1,2,3\n1,\0,3\n", "NUL"),
        ("\n\n", "names no joint"),
        ('"a_x\n', "names no joint|not a table"),
        ("a_x,a_y,a_z," + "1" * 2**21, "line of more than"),
    ],
)
def test_what_is_no_table(tmp_path: Path, content: str, message: str) -> None:
    (tmp_path / "a.csv").write_text(content)
    with pytest.raises(ClipError, match=rf"a\.csv: .*({message})"):
        read(tmp_path / "a.csv")
