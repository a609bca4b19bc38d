"""Poses in a terminal."""

import re
from pathlib import Path

import numpy as np
import pytest

from actioncli import Clip, read_clip
from actioncli.report.figure import figure
from actioncli.report.terminal import strip_lines

EXAMPLES = Path(__file__).parents[2] / "examples"
SQUAT = read_clip(EXAMPLES / "squat/ada.npz")


@pytest.mark.parametrize("columns", [20, 80, 300])
def test_lines_fit_the_terminal(columns: int) -> None:
    lines = strip_lines(figure(SQUAT), columns, colours=False)
    assert max(map(len, lines)) <= max(columns, 28)
    assert lines[-1].split()[:2] == ["0.0", "s"]
    assert any("\u2800" < c <= "\u28ff" for line in lines for c in line)


def test_ascii_marks_the_same_cells() -> None:
    braille = strip_lines(figure(SQUAT), 80, colours=False)
    plain = strip_lines(figure(SQUAT), 80, colours=False, braille=False)
    assert "".join(plain).isascii()
    assert [re.sub("[\u2800-\u28ff]", "#", line) for line in braille[:-2]] == plain[:-2]


def test_colours_end_where_they_begin() -> None:
    coloured = strip_lines(figure(SQUAT), 80, colours=True)
    assert "\x1b[94m" in coloured[5]
    assert "\x1b[33m" in coloured[5]
    bare = [re.sub(r"\x1b\[\d+m", "", line) for line in coloured]
    assert bare == strip_lines(figure(SQUAT), 80, colours=False)


def test_guessed_joints_leave_dots() -> None:
    unsure = Clip(SQUAT.joints, SQUAT.joint_names, 30, np.zeros(SQUAT.joints.shape[:2]))

    def dots(clip: Clip) -> int:
        lines = strip_lines(figure(clip), 80, colours=False)
        return sum((ord(c) - 0x2800).bit_count() for line in lines for c in line if c > "\u2800")

    assert 0 < dots(unsure) < 0.7 * dots(SQUAT)


def test_points_without_bones_are_drawn() -> None:
    joints = np.random.default_rng(0).uniform(0, 1, size=(4, 3, 3))
    lines = strip_lines(figure(Clip(joints, ["a", "b", "c"])), 80, colours=False)
    assert any(line.strip() for line in lines[:-2])
