"""TRC: tracks of markers or joints, as OpenSim, Pose2Sim and Sports2D write them.

A text file: a line `PathFileType ...`, a line of keys (DataRate, Units, ...) and one of their
values, a line `Frame#  Time  <name>  <name> ...`, a line X1 Y1 Z1 ..., and a row a frame. With
tabs or commas, an empty cell is a missing number; with blanks nothing may be missing.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np

from actioncli.clips.formats.files import Numbers, frame_rate, number, parsed, text_lines
from actioncli.clips.recording import MOST_JOINTS, Recording
from actioncli.errors import ClipError

_HEADER_LINES = 20


def read(file: Path) -> Recording:
    """Joint positions (T, 1, J, 3), with the unit and the frame rate of the header.

    Raises:
        ClipError: it has no header of a TRC file, or a row does not fit it.
    """
    lines = enumerate(text_lines(file), 1)
    keys, names, separator = _header(lines, file)
    width = 3 * len(names)
    places = Numbers(file, width)
    times: list[float] = []
    for at, line in lines:
        cells = _split(line, separator)
        # The line of X1 Y1 Z1, and empty ones, before and between the rows.
        if not any(cell.strip() for cell in cells) or _is_axes(cells):
            continue
        if separator:
            # Missing numbers at the end of a row may be left out with their separators.
            cells += [""] * (2 + width - len(cells))
        if (not separator and len(cells) < 2 + width) or any(map(str.strip, cells[2 + width :])):
            raise ClipError(f"{file}: line {at} has {len(cells)} of {width + 2} columns.")
        times += parsed(cells[1:2], file, at)
        places.parse(cells[2 : 2 + width], at)
    if len(places) < 2:
        raise ClipError(f"{file}: a clip needs at least 2 frames, this has {len(places)}.")
    announced = keys.get("numframes", "")
    notes: tuple[str, ...] = ()
    if announced.isdigit() and len(announced) < 10 and int(announced) > len(places):
        notes = (f"is cut off: {len(places)} of {announced} announced frames are there",)
    return Recording(
        places.table().reshape(len(places), 1, len(names), 3),
        joint_names=names,
        fps=_rate(keys.get("datarate", ""), times),
        unit=keys.get("units") or None,
        notes=notes,
    )


def _header(
    lines: Iterator[tuple[int, str]], file: Path
) -> tuple[dict[str, str], tuple[str, ...], str | None]:
    """Keys to values, names of the columns, and the separator (None: blanks)."""
    keys: dict[str, str] = {}
    titles: list[str] = []
    for at, line in lines:
        separator = "\t" if "\t" in line else "," if "," in line else None
        cells = [cell.strip() for cell in _split(line, separator)]
        first = cells[0].lower() if cells else ""
        if first.startswith("frame#") or first == "frame":
            names = tuple(cell for cell in cells[2:] if cell)
            if not names or len(names) > MOST_JOINTS:
                raise ClipError(
                    f"{file}: line {at} names {len(names)} markers; 1 to {MOST_JOINTS} expected."
                )
            return keys, names, separator
        if titles and not keys:
            keys = dict(zip(titles, cells, strict=False))
        elif first == "datarate":
            titles = [cell.lower() for cell in cells]
        if at >= _HEADER_LINES:
            break
    raise ClipError(
        f"{file}: is not a TRC file: no line 'Frame#  Time  ...' within its first "
        f"{_HEADER_LINES} names the markers."
    )


def _split(line: str, separator: str | None) -> list[str]:
    return line.split(separator) if separator else line.split()


def _is_axes(cells: list[str]) -> bool:
    filled = [cell.strip() for cell in cells if cell.strip()]
    return all(cell[0] in "XYZxyz" and cell[1:].isdigit() for cell in filled)


def _rate(stated: str, times: list[float]) -> float | None:
    """The stated frame rate, or the one that the times give."""
    try:
        rate = number(stated)
    except ValueError:
        rate = 0.0
    if np.isfinite(rate) and rate > 0:
        return rate
    return frame_rate(float(np.median(np.diff(np.asarray(times)))))
