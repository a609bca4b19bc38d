"""Poses in a terminal: braille patterns, eight dots to a character; and pictures, two to one."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from actioncli.clips.clip import FloatArray
from actioncli.clips.skeleton import Side
from actioncli.report.figure import Figure, project

# Bits of a braille character for the dots of its four rows and two columns (Unicode 2800).
_BITS = np.array([[0x01, 0x08], [0x02, 0x10], [0x04, 0x20], [0x40, 0x80]])
# ANSI colours that the theme of the terminal keeps apart from one another.
_COLOURS: dict[Side, str] = {"left": "\x1b[94m", "right": "\x1b[33m", "middle": ""}
_SIDES: tuple[Side, ...] = ("middle", "left", "right")
_ROWS = 9
_COLUMNS = 14  # characters of a pose
_METRES = 2.1  # that the rows are high, at least


def strip_lines(figure: Figure, columns: int, colours: bool, braille: bool = True) -> list[str]:
    """A row of poses over the ground, and the seconds below them.

    Args:
        figure: whose poses.
        columns: width of the terminal; decides how many poses there are.
        colours: whether left and right are coloured (ANSI escapes).
        braille: False where the terminal has only ASCII.

    Returns:
        Lines of equal meaning for every terminal: what braille draws, `#` marks.
    """
    poses = max(2, min(10, columns // _COLUMNS))
    frames = np.linspace(0, len(figure.points) - 1, poses).round().astype(int)
    flat = project(figure.points)
    height = max(_METRES, float(flat[..., 1].max()) + 0.1)
    scale = (4 * _ROWS - 1) / height
    cells = [_cells(figure, int(frame), flat[frame], scale) for frame in frames]
    lines = [
        "".join(
            _character(int(dots[row, column]), _SIDES[side[row, column]], colours, braille)
            for dots, side in cells
            for column in range(_COLUMNS)
        ).rstrip()
        for row in range(_ROWS)
    ]
    ground = "\u2594" if braille else "-"  # an upper block: the ground touches the feet
    lines.append((ground * (_COLUMNS - 4)).center(_COLUMNS) * poses)
    times = [f"{frame / figure.fps:.1f} s".center(_COLUMNS) for frame in frames]
    lines.append("".join(times).rstrip())
    return lines


def picture_lines(image: NDArray[np.uint8], columns: int) -> list[str]:
    """A BGR picture (H, W, 3) as half blocks in true colour: two points to a character."""
    height, width = image.shape[:2]
    across = (np.arange(columns) + 0.5) * width / columns
    rows = max(round(columns * height / width / 2), 1)
    down = (np.arange(2 * rows) + 0.5) * height / (2 * rows)
    points = image[down.astype(int)[:, np.newaxis], across.astype(int), ::-1]
    return [
        "".join(
            "\x1b[38;2;{};{};{};48;2;{};{};{}m\u2580".format(*above, *below)
            for above, below in zip(upper, lower, strict=True)
        )
        + "\x1b[0m"
        for upper, lower in zip(points[::2], points[1::2], strict=True)
    ]


def _cells(
    figure: Figure, frame: int, flat: FloatArray, scale: float
) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """Braille bits (rows, columns) of one pose, and the index of the side that each shows."""
    bits = np.zeros((_ROWS, _COLUMNS), np.intp)
    sides = np.zeros((_ROWS, _COLUMNS), np.intp)
    pelvis = figure.names.index("pelv") if "pelv" in figure.names else 0
    x = _COLUMNS + scale * (flat[:, 0] - flat[pelvis, 0])
    y = (4 * _ROWS - 1) - scale * flat[:, 1]
    # A bone between guessed joints is dotted.
    sure = figure.sure[frame]
    strokes = [
        (x[[a, b]], y[[a, b]], side, 40 if sure[a] and sure[b] else 3)
        for a, b, side in figure.bones
    ]
    if figure.head is not None:
        turn = np.linspace(0, 2 * np.pi, 12)
        around = x[figure.head] + 2 * np.cos(turn), y[figure.head] + 2 * np.sin(turn)
        strokes.append((*around, "middle", 40))
    if not figure.bones:
        strokes += [(x[[p, p]], y[[p, p]], "middle", 1) for p in range(len(x))]
    for xs, ys, side, dots in strokes:
        along = np.linspace(0, len(xs) - 1, dots)
        column = np.interp(along, np.arange(len(xs)), xs).round().astype(int)
        row = np.interp(along, np.arange(len(ys)), ys).round().astype(int)
        inside = (column >= 0) & (column < 2 * _COLUMNS) & (row >= 0) & (row < 4 * _ROWS)
        row, column = row[inside], column[inside]
        np.bitwise_or.at(bits, (row // 4, column // 2), _BITS[row % 4, column % 2])
        sides[row // 4, column // 2] = _SIDES.index(side)
    return bits, sides


def _character(bits: int, side: Side, colours: bool, braille: bool) -> str:
    if not bits:
        return " "
    drawn = chr(0x2800 + bits) if braille else "#"
    colour = _COLOURS[side] if colours else ""
    return f"{colour}{drawn}\x1b[0m" if colour else drawn
