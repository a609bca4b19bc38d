"""BVH: a skeleton of bones and the angles of its joints; positions by forward kinematics.

A joint's place is its parent's place plus the parent's rotation of its offset; its rotation is
the parent's times its own, and its own is the product of its channels in the order in which the
file lists them (`Zrotation Xrotation Yrotation` is Z X Y, degrees). Position channels replace
the offset.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from actioncli.clips.axes import body_size, infer_up
from actioncli.clips.clip import FloatArray
from actioncli.clips.formats.files import Numbers, frame_rate, number, text_lines
from actioncli.clips.persons import activity
from actioncli.clips.recording import LARGEST_CLIP, MOST_JOINTS, Recording
from actioncli.clips.skeleton import default_columns
from actioncli.errors import ClipError

_CHANNELS = {f"{axis}{kind}" for axis in "xyz" for kind in ("position", "rotation")}
_BATCH = 2048


@dataclass(slots=True)
class _Joint:
    name: str
    parent: int
    offset: tuple[float, float, float] = (0.0, 0.0, 0.0)
    # The channels in order, and the column of the first.
    channels: tuple[str, ...] = ()
    column: int = 0


@dataclass(slots=True)
class _Skeleton:
    joints: list[_Joint] = field(default_factory=list)
    # Offsets of the end sites, by the joints that they belong to.
    ends: dict[int, tuple[float, float, float]] = field(default_factory=dict)
    columns: int = 0


def read(file: Path) -> Recording:
    """Joint positions (T, 1, J, 3) of the (most active) figure.

    End sites are left out, but for that of the neck where no joint is the head.

    Raises:
        ClipError: it is damaged.
    """
    lines = enumerate(text_lines(file), 1)
    skeleton = _hierarchy(lines, file)
    announced, frame_time = _motion(lines, file)
    angles = Numbers(file, skeleton.columns)
    for at, line in lines:
        cells = line.split()
        if not cells:
            continue
        if len(cells) != skeleton.columns:
            raise ClipError(f"{file}: line {at} has {len(cells)} of {skeleton.columns} channels.")
        try:
            angles.add([number(cell) for cell in cells])
        except ValueError as error:
            raise ClipError(f"{file}: line {at}: {error}.") from error
    frames, joints = len(angles), len(skeleton.joints)
    if frames < 2:
        raise ClipError(f"{file}: a clip needs at least 2 frames, this has {frames}.")
    if frames * joints * 3 > LARGEST_CLIP:
        raise ClipError(
            f"{file}: {frames} frames of {joints} joints are more than the {LARGEST_CLIP} "
            "coordinates that a clip may have; cut out the action."
        )
    table = angles.table()
    if not np.isfinite(table).all():
        raise ClipError(f"{file}: its motion holds NaN or infinity.")
    positions = np.concatenate(
        [_forward(skeleton, table[at : at + _BATCH]) for at in range(0, frames, _BATCH)]
    )
    notes = (f"{frames} of {announced} announced frames are there",)
    fps = frame_rate(frame_time, shortest=1e-4)
    return _one_figure(skeleton, positions, fps, notes if frames != announced else ())


def _one_figure(
    skeleton: _Skeleton,
    positions: FloatArray,
    fps: float | None,
    notes: tuple[str, ...],
) -> Recording:
    """The figure (a file may have several roots) that moves most."""
    roots = [at for at, joint in enumerate(skeleton.joints) if joint.parent < 0]
    rest = _forward(skeleton, np.zeros((1, skeleton.columns), np.float32), rest=True)
    figures = []
    for first, beyond in zip(roots, [*roots[1:], len(skeleton.joints)], strict=True):
        names = _unique([joint.name for joint in skeleton.joints[first:beyond]])
        figures.append((names, positions[:, first:beyond], rest[:, first:beyond]))
    chosen = figures[0]
    if len(figures) > 1:
        moved = [activity(part, np.zeros(part.shape[:2], dtype=bool)) for _, part, _ in figures]
        chosen = figures[int(np.argmax(moved))]
        notes += (
            f"{len(figures)} figures in the file: took the one below {chosen[0][0]}, who moves "
            "most",
        )
    names, places, stance = chosen
    # The pose without rotations nearly always stands.
    size, rest_up = body_size(stance, names), None
    with suppress(ClipError):
        rest_up = infer_up(stance, names, 1 / size if size else 1.0, None, "")
    return Recording(
        places[:, None], names, fps=fps, rest_up=rest_up, zeros_are_gaps=False, notes=notes
    )


def _hierarchy(lines: Iterator[tuple[int, str]], file: Path) -> _Skeleton:
    """Parse up to the line MOTION, which is consumed."""
    skeleton = _Skeleton()
    stack: list[int] = []
    opening = -1
    in_end_site = False
    for at, line in lines:
        words = line.replace("{", " { ").replace("}", " } ").split()
        while words:
            word = words.pop(0).lower()
            if word == "hierarchy":
                continue
            if word == "motion":
                if stack or not skeleton.joints or not skeleton.columns:
                    raise ClipError(f"{file}: line {at}: motion before a complete skeleton.")
                _add_head(skeleton)
                return skeleton
            if word in ("root", "joint"):
                if (word == "root") != (not stack):
                    raise ClipError(f"{file}: line {at}: {word} in the wrong place.")
                if len(skeleton.joints) == MOST_JOINTS:
                    raise ClipError(f"{file}: has more than {MOST_JOINTS} joints.")
                name = " ".join(word for word in words if word != "{") or f"joint{at}"
                words = [word for word in words if word == "{"]
                skeleton.joints.append(_Joint(name[:100], stack[-1] if stack else -1))
                opening = len(skeleton.joints) - 1
            elif word == "end":
                in_end_site, words = True, [word for word in words if word == "{"]
            elif word == "{":
                if not in_end_site:
                    if opening < 0:
                        raise ClipError(f"{file}: line {at}: a bracket in the wrong place.")
                    stack.append(opening)
                    opening = -1
            elif word == "}":
                if in_end_site:
                    in_end_site = False
                elif stack:
                    stack.pop()
                else:
                    raise ClipError(f"{file}: line {at}: a bracket too many.")
            elif word == "offset":
                offset = _three(words, file, at)
                if stack and in_end_site:
                    skeleton.ends[stack[-1]] = offset
                elif stack:
                    skeleton.joints[stack[-1]].offset = offset
                words = words[3:]
            elif word == "channels" and stack and not in_end_site:
                words = _channels(skeleton, stack[-1], words, file, at)
            else:
                raise ClipError(f"{file}: line {at}: {word[:30]!r} is not understood.")
    raise ClipError(f"{file}: is cut off: its skeleton has no end, or no line MOTION follows.")


def _add_head(skeleton: _Skeleton) -> None:
    """Where no joint is the head, the end of the neck is."""
    names = [joint.name for joint in skeleton.joints]
    necks = [at for at in skeleton.ends if "neck" in names[at].lower()]
    roots = sum(joint.parent < 0 for joint in skeleton.joints)
    if len(necks) == 1 and roots == 1 and "head" not in default_columns(names):
        prefix = names[necks[0]][: names[necks[0]].lower().rindex("neck")]
        skeleton.joints.append(_Joint(f"{prefix}Head", necks[0], skeleton.ends[necks[0]]))


def _channels(skeleton: _Skeleton, joint: int, words: list[str], file: Path, at: int) -> list[str]:
    count = int(words[0]) if words and words[0].isascii() and words[0].isdigit() else -1
    names = tuple(word.lower() for word in words[1 : 1 + count])
    owner = skeleton.joints[joint]
    if not (0 <= count <= 6 and len(names) == count and len(set(names)) == count):
        raise ClipError(f"{file}: line {at}: up to 6 channels and their names expected.")
    if not set(names) <= _CHANNELS or owner.channels:
        raise ClipError(f"{file}: line {at}: channels must be {', '.join(sorted(_CHANNELS))}.")
    owner.channels, owner.column = names, skeleton.columns
    skeleton.columns += count
    return words[1 + count :]


def _three(words: list[str], file: Path, at: int) -> tuple[float, float, float]:
    try:
        x, y, z = (number(word) for word in words[:3])
    except ValueError as error:
        raise ClipError(f"{file}: line {at}: an offset of three numbers expected.") from error
    if not all(math.isfinite(value) and abs(value) < 1e9 for value in (x, y, z)):
        raise ClipError(f"{file}: line {at}: the offset is not finite.")
    return x, y, z


def _motion(lines: Iterator[tuple[int, str]], file: Path) -> tuple[int, float]:
    """The announced number of frames and the time of one (NaN where it is no number)."""
    found: dict[str, str] = {}
    for at, line in lines:
        key, colon, value = line.partition(":")
        if not line.strip():
            continue
        if not colon:
            raise ClipError(f"{file}: line {at}: 'Frames:' and 'Frame Time:' expected.")
        found[" ".join(key.lower().split())] = value.strip()
        if len(found) == 2:
            break
    frames, time = found.get("frames", ""), found.get("frame time", "")
    if not (frames.isascii() and frames.isdigit() and len(frames) < 12):
        raise ClipError(f"{file}: 'Frames:' must be a count, not {frames[:30]!r}.")
    try:
        return int(frames), number(time)
    except ValueError:
        return int(frames), math.nan


def _forward(skeleton: _Skeleton, table: FloatArray, rest: bool = False) -> FloatArray:
    """Forward kinematics: channels (T, C) to positions (T, J, 3); with `rest`, of the offsets."""
    frames = len(table)
    values = table.astype(np.float64)
    places = np.empty((frames, len(skeleton.joints), 3))
    turns: list[NDArray[np.float64]] = []
    for at, joint in enumerate(skeleton.joints):
        offset = np.tile(np.array(joint.offset), (frames, 1))
        turn = np.tile(np.eye(3), (frames, 1, 1))
        for index, channel in enumerate(() if rest else joint.channels):
            axis, value = "xyz".index(channel[0]), values[:, joint.column + index]
            if channel.endswith("position"):
                offset[:, axis] = value
            else:
                turn = turn @ _rotation(axis, np.deg2rad(value))
        if joint.parent < 0:
            places[:, at] = offset
        else:
            base = turns[joint.parent]
            places[:, at] = places[:, joint.parent] + (base @ offset[:, :, None])[:, :, 0]
            turn = base @ turn
        turns.append(turn)
    with np.errstate(over="ignore"):
        return places.astype(np.float32)


def _rotation(axis: int, angle: NDArray[np.float64]) -> NDArray[np.float64]:
    """Right-handed rotation about x, y or z: (T,) radians to (T, 3, 3)."""
    turn = np.zeros((len(angle), 3, 3))
    one, other = (axis + 1) % 3, (axis + 2) % 3
    turn[:, axis, axis] = 1
    turn[:, one, one] = turn[:, other, other] = np.cos(angle)
    turn[:, other, one] = np.sin(angle)
    turn[:, one, other] = -turn[:, other, one]
    return turn


def _unique(names: list[str]) -> tuple[str, ...]:
    """Names with a number behind those that appeared before."""
    counts = (names[: at + 1].count(name) for at, name in enumerate(names))
    return tuple(
        f"{name}#{count}" if count > 1 else name for name, count in zip(names, counts, strict=True)
    )
