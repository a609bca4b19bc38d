"""Gaps: joints that a sensor did not see for a moment are interpolated in time.

A gap is filled by a straight line between the samples around it, and held at the ends. What is
mostly gap is refused: a line drawn through it would be motion that nobody made.
"""

from __future__ import annotations

from itertools import compress

import numpy as np
from numpy.typing import NDArray

from actioncli.clips.clip import FloatArray
from actioncli.clips.skeleton import default_columns
from actioncli.errors import ClipError

BoolArray = NDArray[np.bool_]

# A joint, or a body, that is missing in more than this share of the frames is refused.
_MOST_MISSING = 0.5
# The whole body may be out of sight for this long (seconds) before the clip counts as two.
_LONGEST_ABSENCE = 1.0
# The origin of a clip that is centred on the body stands at zero and is no gap.
_ROOTS = frozenset(
    {"pelv", "pelvis", "hips", "hip", "hipcenter", "midhip", "chip", "root", "jointroot"}
    | {"spinebase", "torso"}
)


def missing_joints(positions: FloatArray, zeros_are_gaps: bool = True) -> BoolArray:
    """Which joints are not there: (..., J, 3) to (..., J)."""
    # Most clips lack nothing, which takes much less time to see than where something is missing.
    if np.isfinite(positions).all() and (positions.all() or not zeros_are_gaps):
        return np.zeros(positions.shape[:-1], np.bool_)
    missing: BoolArray = np.logical_not(np.isfinite(positions).all(axis=-1))
    if zeros_are_gaps:
        missing |= (positions == 0).all(axis=-1)
    return missing


def fill_gaps(
    positions: FloatArray,
    names: tuple[str, ...],
    fps: float,
    where: str,
    confidence: FloatArray | None = None,
    zeros_are_gaps: bool = True,
) -> tuple[FloatArray, tuple[str, ...], FloatArray | None, tuple[str, ...]]:
    """Fill short gaps; drop empty frames at the ends and joints that nothing reads.

    Args:
        positions: (T, J, 3); a joint that is NaN, infinite or exactly zero is a gap.
        names: J joint names.
        fps: frames per second.
        where: the file, for messages.
        confidence: (T, J) or None; 0 afterwards where a gap was filled.
        zeros_are_gaps: False where (0, 0, 0) is a position like any other.

    Returns:
        Positions without gaps, the remaining joint names, the confidence, notes for people.

    Raises:
        ClipError: the clip, or a default joint, is mostly gap, or the whole body is out of
            sight for more than a second.
    """
    missing = missing_joints(positions, zeros_are_gaps)
    if not missing.any():
        return positions, names, confidence, ()
    needed = sorted({at for columns in default_columns(names).values() for at in columns})
    needed = np.setdiff1d(needed or range(len(names)), _roots(positions, names)).tolist()
    _check_mostly_there(missing, needed, names, where)

    notes = []
    seen = np.flatnonzero(~missing[:, needed].all(axis=1))
    if len(seen) < 2:
        raise ClipError(f"{where}: a body is seen in {len(seen)} of {len(missing)} frames.")
    if len(seen) < len(missing):
        pause = int(np.diff(seen).max()) - 1
        if pause > _LONGEST_ABSENCE * fps:
            first = int(seen[np.diff(seen).argmax()]) + 1
            raise ClipError(
                f"{where}: the body is out of sight for {pause} frames ({pause / fps:.1f} s) "
                f"after frame {first}; cut the recording there."
            )
        ends = slice(int(seen[0]), int(seen[-1]) + 1)
        cut = len(missing) - (ends.stop - ends.start)
        positions, missing = positions[ends], missing[ends]
        confidence = None if confidence is None else confidence[ends]
        if cut:
            notes.append(f"{cut} empty frames at the ends dropped")

    unseen = missing.mean(axis=0) > _MOST_MISSING
    unseen[_roots(positions, names)] = False
    if unseen.any():
        notes.append(f"joints mostly missing, dropped: {', '.join(compress(names, unseen))}")
        positions, missing = positions[:, ~unseen], missing[:, ~unseen]
        confidence = None if confidence is None else confidence[:, ~unseen]
        names = tuple(compress(names, ~unseen))
    missing[:, _roots(positions, names)] = False
    if missing.any():
        positions = _interpolate(positions, missing)
        if confidence is not None:
            confidence = np.where(missing, np.float32(0), confidence)
        notes.append(
            f"gaps filled: {missing.mean():.1%} of the joint positions, "
            f"the longest over {_longest_run(missing)} frames"
        )
    return positions, names, confidence, tuple(notes)


def _roots(positions: FloatArray, names: tuple[str, ...]) -> list[int]:
    """Columns of the origin of a clip that is centred on the body."""
    bare = ["".join(filter(str.isalnum, name.lower())) for name in names]
    # A root that is NaN throughout is missing like any other joint.
    return [at for at, name in enumerate(bare) if name in _ROOTS and not positions[:, at].any()]


def _check_mostly_there(
    missing: BoolArray, needed: list[int], names: tuple[str, ...], where: str
) -> None:
    share = missing[:, needed].mean() if needed else 1.0
    if share > _MOST_MISSING:
        raise ClipError(
            f"{where}: mostly gap: {share:.0%} of the joint positions are missing (NaN or "
            f"zero) over {len(missing)} frames; record the action again."
        )
    lost = {column: missing[:, column].mean() for column in needed}
    figures = ", ".join(f"{names[at]} in {lost[at]:.0%}" for at in lost if lost[at] > _MOST_MISSING)
    if figures:
        raise ClipError(
            f"{where}: joints are missing in most of the {len(missing)} frames: {figures}; "
            "record the action again with the whole body in view."
        )


def _interpolate(positions: FloatArray, missing: BoolArray) -> FloatArray:
    filled = np.array(positions, dtype=np.float32)
    frames = np.arange(len(filled))
    for joint in np.flatnonzero(missing.any(axis=0)):
        gap = missing[:, joint]
        for axis in range(3):
            line = filled[:, joint, axis]
            line[gap] = np.interp(frames[gap], frames[~gap], line[~gap])
    return filled


def _longest_run(missing: BoolArray) -> int:
    """Frames of the longest unbroken gap of any joint."""
    longest = run = np.zeros(missing.shape[1], dtype=int)
    for frame in missing:
        run = (run + 1) * frame
        longest = np.maximum(longest, run)
    return int(longest.max())
