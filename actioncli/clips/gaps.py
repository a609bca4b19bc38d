"""Gaps: joints that a sensor did not see for a moment are interpolated in time.

A short gap is filled by a straight line between the samples around it, and held at the ends. What
was not seen for longer is missing: a line drawn through it would be motion that nobody made.
"""

from __future__ import annotations

from itertools import compress

import numpy as np
from numpy.typing import NDArray

from actioncli.clips.skeleton import HAND_JOINTS, LIMBS, FloatArray, default_columns
from actioncli.errors import ClipError

BoolArray = NDArray[np.bool_]

# Seconds without a joint that are interpolated and still count as seen.
LONGEST_GAP = 0.4
# A joint that is missing in more than this share of the frames was not seen.
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


def interpolated(
    joints: FloatArray, gone: BoolArray, longest: float
) -> tuple[FloatArray, BoolArray]:
    """Joints (T, J, 3) with those that are `gone` (T, J) on a line in time between the frames
    around them, at the ends where the nearest frame has them; and which of them are in a gap of
    more than `longest` frames. A joint that is never there keeps its place, and is such a gap."""
    joints, lost = np.array(joints, np.float32), np.zeros_like(gone)
    frames = np.arange(len(joints))
    for joint in np.flatnonzero(gone.any(axis=0)):
        gap = gone[:, joint]
        if gap.all():
            lost[:, joint] = True
            continue
        edges = np.flatnonzero(np.diff(gap, prepend=False, append=False))
        for begin, end in edges.reshape(-1, 2).tolist():
            lost[begin:end, joint] = end - begin > longest
        seen, wanted = frames[~gap], frames[gap]
        at = np.searchsorted(seen, wanted)
        before, after = seen[(at - 1).clip(0)], seen[at.clip(max=len(seen) - 1)]
        share = ((wanted - before) / np.maximum(after - before, 1)).clip(0, 1)
        share = share[:, None].astype(np.float32)
        joints[gap, joint] = joints[before, joint] * (1 - share) + joints[after, joint] * share
    return joints, lost


def filled(joints: FloatArray) -> FloatArray:
    """Joints (T, J, 3) with a place for what is NaN: on a line between the frames around it, at
    the ends the nearest frame's; a joint that is never there stands in the middle of the others."""
    gone: BoolArray = np.isnan(joints[..., 0])
    nobody: BoolArray = np.all(gone, axis=1)
    middle = np.nanmean(np.where(nobody[:, None, None], 0, joints), axis=1, dtype=np.float64)
    joints, _ = interpolated(joints, gone, np.inf)
    joints[:, np.all(gone, axis=0)] = np.asarray(middle)[:, None]
    return joints


def fill_gaps(
    positions: FloatArray,
    names: tuple[str, ...],
    fps: float,
    where: str,
    confidence: FloatArray | None = None,
    zeros_are_gaps: bool = True,
) -> tuple[FloatArray, tuple[str, ...], FloatArray | None, tuple[str, ...]]:
    """Fill short gaps; drop empty frames at the ends, and joints that nothing reads and that are
    mostly missing.

    Args:
        positions: (T, J, 3); a joint that is NaN, infinite or exactly zero is a gap.
        names: J joint names.
        fps: frames per second.
        where: the file, for messages.
        confidence: (T, J) or None; 0 afterwards where a gap was filled.
        zeros_are_gaps: False where (0, 0, 0) is a position like any other.

    Returns:
        Positions, NaN where a joint was not seen for more than `LONGEST_GAP`; the remaining joint
        names, the confidence, notes for people.

    Raises:
        ClipError: too little was seen to recognise anything by, or the whole body is out of sight
            for more than a second.
    """
    missing = missing_joints(positions, zeros_are_gaps)
    if not missing.any():
        return positions, names, confidence, ()
    needed = sorted({at for columns in default_columns(names).values() for at in columns})
    needed = np.setdiff1d(needed or range(len(names)), _roots(positions, names)).tolist()
    _check_enough(missing, names, needed, where)
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
    # A hand counts in the frames in which it is seen.
    fingers = [at for at, name in enumerate(names) if name in HAND_JOINTS]
    unseen[[*_roots(positions, names), *needed]] = False
    unseen[fingers] = missing[:, fingers].all(axis=0)
    if unseen.any():
        notes.append(f"joints mostly missing, dropped: {_some(list(compress(names, unseen)))}")
        positions, missing = positions[:, ~unseen], missing[:, ~unseen]
        confidence = None if confidence is None else confidence[:, ~unseen]
        names = tuple(compress(names, ~unseen))
    missing[:, _roots(positions, names)] = False
    if missing.any():
        positions, lost = interpolated(positions, missing, LONGEST_GAP * fps)
        positions[lost] = np.nan
        if confidence is None and lost.any():
            confidence = np.ones(missing.shape, np.float32)
        if confidence is not None:
            confidence = np.where(missing, np.float32(0), confidence)
        short = missing & ~lost
        if short.any():
            notes.append(f"gaps filled: {short.mean():.1%} of the joint positions")
        if lost.any():
            shares = zip(names, lost.mean(axis=0).tolist(), strict=True)
            named = [f"{name} in {share:.0%}" for name, share in shares if share]
            notes.append(f"not seen: {_some(named)} of the frames")
    return positions, names, confidence, tuple(notes)


def _some(names: list[str]) -> str:
    more = f" and {len(names) - 6} more" if len(names) > 6 else ""
    return ", ".join(names[:6]) + more


def _roots(positions: FloatArray, names: tuple[str, ...]) -> list[int]:
    """Columns of the origin of a clip that is centred on the body."""
    bare = ["".join(filter(str.isalnum, name.lower())) for name in names]
    # A root that is NaN throughout is missing like any other joint.
    return [at for at, name in enumerate(bare) if name in _ROOTS and not positions[:, at].any()]


def _check_enough(
    missing: BoolArray, names: tuple[str, ...], needed: list[int], where: str
) -> None:
    """Refuse a body of which mostly neither shoulders nor hips, or no whole limb, is seen.

    Raises:
        ClipError: names what is missing.
    """
    columns = default_columns(names)

    def seen(*joints: str) -> bool:
        group = [at for joint in joints for at in columns.get(joint, ())]
        return bool(group) and bool(missing[:, group].any(axis=1).mean() <= _MOST_MISSING)

    if not columns or (
        (seen("lsho", "rsho") or seen("lhip", "rhip"))
        and any(seen(*limb) for limb in LIMBS.values())
    ):
        return
    lost = {at: missing[:, at].mean() for at in needed}
    figures = [f"{names[at]} in {lost[at]:.0%}" for at in lost if lost[at] > _MOST_MISSING]
    raise ClipError(
        f"{where}: too little was seen to recognise anything by: over {len(missing)} frames "
        f"{missing[:, needed].mean():.0%} of the joint positions are missing (NaN or zero): "
        f"{', '.join(figures) or 'all now and then'}; record the action again with shoulders or "
        "hips, and an arm or a leg, in view."
    )
