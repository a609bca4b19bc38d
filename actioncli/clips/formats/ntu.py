"""NTU RGB+D `.skeleton`: bodies that a Kinect v2 tracked, frame by frame.

A text file: the number of frames; for each the number of bodies; for each body a line that
begins with its tracking number, the number of joints, and a line a joint, which begins with
x y z in metres and ends with the tracking state (0 lost, 1 inferred, 2 tracked). The sensor's
axes are those of `Clip`.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from actioncli.clips.clip import FloatArray
from actioncli.clips.formats.files import Numbers, number, text_lines
from actioncli.clips.recording import LARGEST_CLIP, LONGEST_CLIP, MOST_PEOPLE, Recording
from actioncli.clips.skeleton import LAYOUTS
from actioncli.errors import ClipError

_LAYOUT = "kinect_v2_25"
_JOINTS = len(LAYOUTS[_LAYOUT])
_FPS = 30.0
_COLUMNS = 12
# The sensor tracks 6 bodies at once; over a recording each of them may get new numbers.
_MOST_BODIES = 6
# A body that appears within this time (frames) and distance (metres) of where another was lost
# is the same person under a new number.
_LOST_FRAMES = 15
_LOST_DISTANCE = 0.5


def read(file: Path) -> Recording:
    """All bodies of a recording as (T, P, 25, 3) metres, with the tracking state as confidence.

    Raises:
        ClipError: it is damaged, or nobody is in it.
    """
    lines = enumerate(text_lines(file), 1)
    announced = _count(lines, file, "frames", LONGEST_CLIP)
    rows = Numbers(file, 4, LARGEST_CLIP)
    owners: list[tuple[int, str]] = []
    frames = 0
    for at, line in lines:
        if not line.strip():
            continue
        if frames == announced:
            raise ClipError(f"{file}: line {at}: goes on after its {announced} frames.")
        bodies_here = _parsed_count(line, at, file, "bodies", _MOST_BODIES)
        owners.extend((frames, _body(lines, rows, file)) for _ in range(bodies_here))
        frames += 1
    notes: tuple[str, ...] = ()
    if frames < announced:
        notes = (f"is cut off: {frames} of {announced} announced frames are there",)
    numbers = list(dict.fromkeys(number for _, number in owners))
    if not numbers:
        raise ClipError(f"{file}: nobody is in it ({frames} frames without a body).")
    # Before somebody comes and after all have left there is nothing to see, nor a gap to fill.
    first, last = owners[0][0], owners[-1][0]
    if last - first + 1 < frames:
        notes += (f"{frames - (last - first + 1)} frames without a body at the ends dropped",)
        owners = [(frame - first, number) for frame, number in owners]
        frames = last - first + 1
    if len(numbers) > MOST_PEOPLE or frames * len(numbers) * _JOINTS * 3 > LARGEST_CLIP:
        raise ClipError(
            f"{file}: {len(numbers)} bodies over {frames} frames are more than a clip may have."
        )
    samples = rows.table().reshape(-1, _JOINTS, 4)
    bodies = np.full((frames, len(numbers), _JOINTS, 4), np.nan, dtype=np.float32)
    # Not by the positions, which may be no numbers: who is listed is there.
    there = np.zeros(bodies.shape[:2], np.bool_)
    column = {number: at for at, number in enumerate(numbers)}
    for sample, (frame, owner) in zip(samples, owners, strict=True):
        bodies[frame, column[owner]] = sample
        there[frame, column[owner]] = True
    bodies, numbers, joined = _join(bodies, there, numbers)
    # What the sensor lost is a gap; it reports a place for it all the same.
    state = bodies[..., 3]
    positions = np.where(state[..., None] > 0, bodies[..., :3], np.float32(np.nan))
    return Recording(
        positions,
        joint_names=LAYOUTS[_LAYOUT],
        fps=_FPS,
        unit="m",
        up="y",
        confidence=np.clip(np.nan_to_num(state) / 2, 0, 1),
        people=tuple(f"body {number}" for number in numbers),
        notes=notes + joined,
    )


def _body(lines: Iterator[tuple[int, str]], rows: Numbers, file: Path) -> str:
    """Read one body's joints; its tracking number is returned."""
    at, line = next(lines, (0, ""))
    body = (line.split() or [""])[0]
    # The reference reader takes the number as an integer; what else stands here is damage.
    if not body.lstrip("-").isdigit():
        raise ClipError(f"{file}: {_line(at)}: a body's tracking number expected.")
    joints = _count(lines, file, "joints", _JOINTS)
    if joints != _JOINTS:
        raise ClipError(f"{file}: a body has {joints} joints; a Kinect v2 gives {_JOINTS}.")
    for _ in range(joints):
        at, line = next(lines, (0, ""))
        cells = line.split()
        try:
            x, y, z = map(number, cells[:3])
            state = number(cells[_COLUMNS - 1]) if len(cells) >= _COLUMNS else 2.0
        except ValueError as error:
            raise ClipError(f"{file}: {_line(at)}: a joint's x y z expected: {error}.") from error
        rows.add((x, y, z, state))
    return body[:20]


def _count(lines: Iterator[tuple[int, str]], file: Path, what: str, most: int) -> int:
    at, line = next(((at, line) for at, line in lines if line.strip()), (0, ""))
    return _parsed_count(line, at, file, what, most)


def _parsed_count(line: str, at: int, file: Path, what: str, most: int) -> int:
    text = line.strip()
    if not (text.isascii() and text.isdigit() and len(text) < 10 and int(text) <= most):
        raise ClipError(
            f"{file}: {_line(at)}: the number of {what} (0 to {most}) expected, not {text[:30]!r}."
        )
    return int(text)


def _line(at: int) -> str:
    return f"line {at}" if at else "is cut off at its end"


def _join(
    bodies: FloatArray, there: NDArray[np.bool_], numbers: list[str]
) -> tuple[FloatArray, list[str], tuple[str, ...]]:
    """Put together one person's tracks under several numbers: (T, P, J, 4) to fewer P.

    Args:
        there: (T, P) whether a body is listed in a frame; each is in one at least.
    """
    kept: list[int] = []
    notes = []
    for body in np.argsort(there.argmax(axis=0), kind="stable").tolist():
        first = int(there[:, body].argmax())
        for earlier in kept:
            last = int(np.flatnonzero(there[:, earlier])[-1])
            with np.errstate(invalid="ignore"):  # an infinite step is not short
                step = bodies[first, body, 0, :3] - bodies[last, earlier, 0, :3]
            if 0 < first - last <= _LOST_FRAMES and np.linalg.norm(step) < _LOST_DISTANCE:
                bodies[first:, earlier] = bodies[first:, body]
                there[first:, earlier] = there[first:, body]
                notes.append(f"bodies {numbers[earlier]} and {numbers[body]} taken as one person")
                break
        else:
            kept.append(body)
    return bodies[:, kept], [numbers[body] for body in kept], tuple(notes)
