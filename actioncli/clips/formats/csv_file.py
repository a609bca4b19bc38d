"""CSV: one row a frame, a header that names the joint and the axis of each column."""

from __future__ import annotations

import csv
import re
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from actioncli.clips.clip import FloatArray
from actioncli.clips.formats.fields import as_confidence
from actioncli.clips.formats.files import Numbers, frame_rate, parsed, text_lines
from actioncli.clips.recording import LARGEST_CLIP, MOST_JOINTS, MOST_PEOPLE, Recording
from actioncli.errors import ClipError

_SEP = r"[\s_.:\-/|]*"
_AXIS = r"(?:pos(?:ition)?|coord(?:inate)?|world|t)?" + _SEP + r"(?P<axis>[xyz])"
_UNIT = r"(?:" + _SEP + r"[(\[]?(?P<unit>mm|cm|m)[)\]]?)?"
# `lsho_x`, `lsho.X`, `LeftArm X (mm)`, `lm_0_z`, `LeftArmX` (capital without separator), and
# the axis first: `x_lsho`, `x0`.
_STYLES = (
    re.compile(rf"(?P<joint>.+?)[\s_.:\-/|(\[]+(?i:{_AXIS})[)\]]?(?i:{_UNIT})"),
    re.compile(rf"(?i:{_AXIS})[\s_.:\-/|]+(?P<joint>.+?)"),
    re.compile(r"(?i:(?P<axis>[xyz]))(?P<joint>\d+)"),
    re.compile(r"(?P<joint>.*[a-z\d])(?P<axis>[XYZ])"),
)
_TIME = re.compile(r"(?i)(?:time|timestamp|t|sec|seconds)[\s_(\[]*(?P<unit>s|sec|ms|us|ns)?[)\]]?")
_PERSON = re.compile(r"(?i)(?:person|body|subject|track|people)(?:[\s_]*(?:id|index|nr))?|id|pid")
_CONFIDENCE = re.compile(
    r"(?i)(?P<joint>.+?)[\s_.:\-/|]+(?:v|vis|visibility|c|conf|confidence|score|likelihood)"
)
_JOINT = re.compile(
    r"(?i)(?:joint|landmark|marker|keypoint|body[\s_]*part|bone)(?:[\s_]*(?:name|id|index|nr))?"
)
_SEEN = re.compile(r"(?i)visibility|vis|conf(?:idence)?|score|likelihood")
_PLACE = re.compile(rf"(?i)(?:{_AXIS}{_UNIT})")
_FRAME = re.compile(r"(?i)(?:frame|index)(?:[\s_]*(?:number|nr|no|id|index))?|#?frame")
_COUNTED = re.compile(r"(?i)(?:joint|lm|landmark|j|kp|keypoint|p|point)?[_\s]*\d+")
_BEFORE = re.compile(r"(?i)sep=.?$|#\s|//")
_SECONDS = {"ms": 1e-3, "us": 1e-6, "ns": 1e-9}


class _Columns:
    """What each column of the header holds."""

    def __init__(self, header: list[str], file: Path) -> None:
        found: dict[str, dict[str, int]] = {}
        units = set()
        self.confidence: dict[str, int] = {}
        self.time: int | None = None
        self.person: int | None = None
        self.time_unit = 1.0
        for column, title in enumerate(header):
            name = title.strip()
            match = next((m for style in _STYLES if (m := style.fullmatch(name))), None)
            if match is not None:
                found.setdefault(match["joint"], {}).setdefault(match["axis"].lower(), column)
                unit = match.groupdict().get("unit")
                units.add(unit.lower() if unit else None)
            elif seen := _CONFIDENCE.fullmatch(name):
                self.confidence[seen["joint"]] = column
            elif (time := _TIME.fullmatch(name)) and self.time is None:
                self.time = column
                self.time_unit = _SECONDS.get((time["unit"] or "").lower(), 1.0)
            elif _PERSON.fullmatch(name) and self.person is None:
                self.person = column
        self.joints = {name: axes for name, axes in found.items() if len(axes) == 3}
        if not self.joints:
            half = next(iter(found), None)
            hint = f"{half!r} lacks x, y or z"
            if half is None:
                hint = "found: " + ", ".join(repr(title.strip()[:30]) for title in header[:6])
            raise ClipError(
                f"{file}: its first line names no joint with x, y and z columns (like "
                f"lsho_x,lsho_y,lsho_z); {hint}."
            )
        if len(self.joints) > MOST_JOINTS:
            raise ClipError(f"{file}: names {len(self.joints)} joints; at most {MOST_JOINTS}.")
        self.unit = next(iter(units)) if len(units) == 1 else None
        # Joint names, or None where the columns are only counted (`x0`, `joint_3_x`).
        self.names: tuple[str, ...] | None = tuple(self.joints)
        if all(_COUNTED.fullmatch(name) for name in self.joints):
            self.names = None
            order = sorted(self.joints, key=lambda name: int(re.sub(r"\D", "", name)[:9]))
            self.joints = {name: self.joints[name] for name in order}


def read(file: Path) -> Recording:
    """Joint positions from a table.

    The columns are separated by comma, semicolon (with decimal commas too) or tab. A column
    `time` gives the frame rate, one of `person` separates several people, `lsho_visibility`
    and the like give the confidence. Empty cells are gaps. A table whose columns are frame,
    joint, x, y and z has a row for each joint in each frame.

    Raises:
        ClipError: no header names joints, or a row does not fit it.
    """
    lines = _rows(file)
    header = next(lines, (0, []))[1]
    if (long := _long_columns(header)) is not None:
        return _read_long(lines, long, header, file)
    columns = _Columns(header, file)
    picked = [column for axes in columns.joints.values() for _, column in sorted(axes.items())]
    seen = [columns.confidence.get(name) for name in columns.joints]
    extra = [column for column in seen if column is not None]
    wanted = picked + (extra if len(extra) == len(seen) else [])
    places = Numbers(file, len(wanted))
    times: list[float] = []
    people: list[str] = []
    for line, row in lines:
        if len(row) < len(header) or any(map(str.strip, row[len(header) :])):
            raise ClipError(f"{file}: line {line} has {len(row)} of {len(header)} columns.")
        places.parse([row[column] for column in wanted], line)
        if columns.time is not None:
            times += parsed([row[columns.time]], file, line)
        if columns.person is not None:
            people.append(row[columns.person].strip())
    if len(places) < 2:
        raise ClipError(f"{file}: a clip needs at least 2 frames, this has {len(places)} rows.")
    table = places.table()
    split, times = _by_person(table, people, times, file)
    frames, count = split.shape[:2]
    positions = split[:, :, : len(picked)].reshape(frames, count, -1, 3)
    confidence, notes = None, tuple[str, ...]()
    if len(wanted) > len(picked):
        confidence, notes = as_confidence(split[:, :, len(picked) :], positions)
    return Recording(
        positions,
        joint_names=columns.names,
        fps=_rate(times, columns.time_unit),
        unit=columns.unit,
        confidence=confidence,
        notes=notes,
    )


def _long_columns(header: list[str]) -> dict[str, int] | None:
    """The columns of frame, joint, x, y and z where each row is one joint in one frame."""
    found: dict[str, int] = {}
    kinds = {"joint": _JOINT, "frame": _FRAME, "time": _TIME, "person": _PERSON, "seen": _SEEN}
    for column, title in enumerate(cell.strip() for cell in header):
        kind = next((kind for kind, style in kinds.items() if style.fullmatch(title)), None)
        place = _PLACE.fullmatch(title)
        found.setdefault(kind or (place["axis"] if place else title).lower(), column)
    found.setdefault("frame", found.get("time", -1))
    return found if {"joint", *"xyz"} <= found.keys() and found["frame"] >= 0 else None


def _read_long(
    lines: Iterator[tuple[int, list[str]]], columns: dict[str, int], header: list[str], file: Path
) -> Recording:
    """A table of a row a joint; joints that a frame lacks are missing in it."""
    keys: dict[str, dict[str, int]] = {kind: {} for kind in ("frame", "person", "joint")}
    owners: list[list[int]] = []
    times: dict[int, float] = {}
    wanted = [columns[kind] for kind in (*"xyz", "seen") if kind in columns]
    places = Numbers(file, len(wanted), LARGEST_CLIP)
    for line, row in lines:
        if len(row) <= max(columns.values()):
            raise ClipError(f"{file}: line {line} has {len(row)} columns, fewer than its header.")
        cells = {kind: row[columns[kind]].strip()[:100] if kind in columns else "" for kind in keys}
        owners.append([of.setdefault(cells[kind], len(of)) for kind, of in keys.items()])
        if len(keys["joint"]) > MOST_JOINTS or len(keys["person"]) > MOST_PEOPLE:
            raise ClipError(
                f"{file}: names more than {MOST_JOINTS} joints or {MOST_PEOPLE} people."
            )
        places.parse([row[column] for column in wanted], line)
        frame = owners[-1][0]
        if "time" in columns and frame not in times:
            (times[frame],) = parsed([row[columns["time"]]], file, line)
    shape = tuple(len(of) for of in keys.values())
    if shape[0] < 2 or np.prod(shape) * len(wanted) > LARGEST_CLIP:
        raise ClipError(f"{file}: holds {shape[0]} frames of {shape[2]} joints.")
    table = np.full((*shape, len(wanted)), np.nan, np.float32)
    table[tuple(np.array(owners).T)] = places.table()
    names = [*keys["joint"]]
    counted = all(name.isdecimal() for name in names)
    if counted:  # in the order of their numbers, as a layout has them
        table = table[:, :, np.argsort([int(name) for name in names])]
    positions, confidence, notes = table[..., :3], None, tuple[str, ...]()
    if "seen" in columns:
        confidence, notes = as_confidence(table[..., 3], positions)
    units = {
        match["unit"]
        for axis in "xyz"
        if (match := _PLACE.fullmatch(header[columns[axis]].strip()))
    }
    return Recording(
        positions,
        joint_names=None if counted else tuple(names),
        fps=_rate([*times.values()], 1.0),
        unit=(units.pop() or "").lower() or None if len(units) == 1 else None,
        confidence=confidence,
        notes=notes,
    )


def _rows(file: Path) -> Iterator[tuple[int, list[str]]]:
    """Line numbers and cells; the separator is the one that the header has most of."""
    lines = ((at, line) for at, line in enumerate(text_lines(file), 1) if line.strip())
    # Spreadsheets state the separator in a line of its own.
    at, first = next((each for each in lines if not _BEFORE.match(each[1])), (1, ""))
    separator = max(",;\t", key=first.count)
    yield at, _cells(first, separator, file)
    for at, line in lines:
        yield at, _cells(line, separator, file)


def _cells(line: str, separator: str, file: Path) -> list[str]:
    if '"' not in line:
        return line.split(separator)
    try:
        return next(csv.reader([line], delimiter=separator, skipinitialspace=True))
    except csv.Error as error:
        raise ClipError(f"{file}: is not a table: {error}.") from error


def _by_person(
    table: FloatArray, people: list[str], times: list[float], file: Path
) -> tuple[FloatArray, list[float]]:
    """Rows (R, C) of several people, each with a row a frame, to (T, P, C).

    Rows of one frame follow each other: a frame ends where somebody appears again.
    """
    column = {person: at for at, person in enumerate(dict.fromkeys(people))}
    if len(column) < 2:
        return table[:, None], times
    if len(column) > MOST_PEOPLE:
        raise ClipError(f"{file}: names {len(column)} people; at most {MOST_PEOPLE} are read.")
    frame = 0
    here: set[str] = set()
    frames = []
    starts = [0]
    for row, person in enumerate(people):
        if person in here or (times and row and times[row] != times[row - 1]):
            frame, here = frame + 1, set()
            starts.append(row)
        here.add(person)
        frames.append(frame)
    if (frame + 1) * len(column) * table.shape[1] > LARGEST_CLIP:
        raise ClipError(f"{file}: holds more than {LARGEST_CLIP} numbers; cut out the action.")
    split = np.full((frame + 1, len(column), table.shape[1]), np.nan, dtype=np.float32)
    split[frames, [column[person] for person in people]] = table
    return split, [times[row] for row in starts] if times else times


def _rate(times: list[float], unit: float) -> float | None:
    """Frames per second from the times of frames, where they give one."""
    if len(times) < 2:
        return None
    step = float(np.median(np.diff(np.asarray(times)))) * unit
    # Times that count in milliseconds without saying so.
    step = step / 1000 if step >= 2 and unit == 1.0 else step
    return frame_rate(step)
