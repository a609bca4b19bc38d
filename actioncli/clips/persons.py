"""Several people in one file: follow each, take the one that moves most."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from actioncli.clips.clip import FloatArray
from actioncli.clips.gaps import BoolArray, missing_joints
from actioncli.clips.recording import Recording
from actioncli.errors import ClipError


def most_active(recording: Recording, where: str) -> Recording:
    """The recording of the one person who moves most, cut to the frames that show them.

    Detectors list people in any order, so that one column may hold several of them in turn;
    people are followed by their place first.

    Returns:
        The same recording with P = 1 and, where there was a choice, a note of it.

    Raises:
        ClipError: nobody is in it.
    """
    people = recording.positions.shape[1]
    if people == 1:
        return recording
    missing = missing_joints(recording.positions, recording.zeros_are_gaps)
    order = _follow(recording.positions, missing)
    rows = np.arange(len(order))[:, None]
    positions, missing = recording.positions[rows, order], missing[rows, order]
    moved = [activity(positions[:, who], missing[:, who]) for who in range(people)]
    there = [who for who in range(people) if not missing[:, who].all()]
    if not there:
        raise ClipError(f"{where}: nobody is in it ({len(positions)} frames without a body).")
    best = max(there, key=lambda who: moved[who])
    seen = np.flatnonzero(~missing[:, best].all(axis=1))
    span = slice(int(seen[0]), int(seen[-1]) + 1)
    notes = list(recording.notes)
    if len(there) > 1:
        names = recording.people or tuple(f"person {who + 1}" for who in range(people))
        second = max(moved[who] for who in there if who != best)
        notes.append(
            f"{len(there)} people in the file: took {names[best]}, who moves most "
            f"({moved[best]:.3g} against {second:.3g}), frames {span.start + 1} to {span.stop}"
        )
    confidence = recording.confidence
    if confidence is not None:
        confidence = confidence[rows, order][span, best : best + 1]
    return replace(
        recording,
        positions=positions[span, best : best + 1],
        confidence=confidence,
        people=(),
        notes=tuple(notes),
    )


def activity(positions: FloatArray, missing: BoolArray) -> float:
    """How much one person moves: the mean over joints of the standard deviation of its place,
    times the share of frames in which the joint is seen. (T, J, 3), (T, J) to a length."""
    seen = np.logical_not(missing)
    count = np.maximum(seen.sum(axis=0), 1)[:, None]
    places = np.where(seen[..., None], positions, 0).astype(np.float64)
    mean = places.sum(axis=0) / count
    variance = (np.where(seen[..., None], places - mean, 0) ** 2).sum(axis=0) / count
    return float((np.sqrt(variance.sum(axis=1)) * seen.mean(axis=0)).mean())


def _follow(positions: FloatArray, missing: BoolArray) -> NDArray[np.intp]:
    """Which column holds each person in each frame: (T, P) indices.

    A person stays in their column unless they jump by more than half a body's height there,
    or somebody appears; then that frame is assigned anew, nearest first.
    """
    frames, people = missing.shape[:2]
    order = np.tile(np.arange(people), (frames, 1))
    there = np.logical_not(missing)
    seen: BoolArray = np.logical_or.reduce(there, axis=2)
    weight = there[..., None] / np.maximum(there.sum(axis=2), 1)[..., None, None]
    places = np.where(missing[..., None], 0, positions).astype(np.float64)
    centre = (places * weight).sum(axis=2)
    if not seen.any():
        return order
    spread = np.linalg.norm(places - centre[:, :, None], axis=-1)
    # From the middle of a body to its joints it is a quarter of its height.
    reach = 2 * float(np.median(spread[there]))
    jumps = np.linalg.norm(np.diff(centre, axis=0), axis=2) > reach
    if not (jumps | ~seen[1:] | ~seen[:-1]).any():
        return order
    last = np.full((people, 3), np.nan)
    for frame in range(frames):
        here = np.flatnonzero(seen[frame])
        distance = np.linalg.norm(last[:, None] - centre[frame][None], axis=2)
        own, near = distance[here, here], np.isfinite(distance[:, here]).any(axis=0)
        if ((own > reach) | (np.isnan(own) & near)).any():
            order[frame] = _assign(distance, here, reach)
        for who in range(people):
            if seen[frame, order[frame, who]]:
                last[who] = centre[frame, order[frame, who]]
    return order


def _assign(
    distance: NDArray[np.float64], here: NDArray[np.intp], reach: float
) -> NDArray[np.intp]:
    """Columns to people, nearest pair first: (P, P) distances to P indices."""
    people = len(distance)
    order = np.full(people, -1)
    free = set(here.tolist())
    # Somebody not met before (NaN) takes what is left over.
    cost = np.where(np.isnan(distance), np.inf, distance)
    for flat in np.argsort(cost, axis=None):
        who, column = divmod(int(flat), people)
        if order[who] < 0 and column in free and cost[who, column] <= reach:
            order[who] = column
            free.discard(column)
    rest = [column for column in range(people) if column not in order]
    # Who was not met before takes the new bodies, best that of their own column.
    waiting = np.flatnonzero(order < 0).tolist()
    for who in sorted(waiting, key=lambda who: bool(np.isfinite(distance[who]).any())):
        offered = [column for column in rest if column in free] or rest
        column = who if who in offered else offered[0]
        order[who] = column
        rest.remove(column)
        free.discard(column)
    return order
