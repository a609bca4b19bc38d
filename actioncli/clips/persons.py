"""Several people in one file: follow each, take the one that moves most."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from actioncli.clips.clip import FloatArray
from actioncli.clips.gaps import BoolArray, missing_joints
from actioncli.clips.recording import Recording
from actioncli.errors import ClipError

# Two people are not told apart where exchanging them takes less than this times the way, or their
# joints are this share of half a body's height from each other.
_OPEN, _NEAR = 1.5, 0.1


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
    order, doubt = _follow(recording.positions, missing)
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
    if (share := float(doubt[span, best].mean())) > 0:
        text = f"two people are too near to be told apart in {share:.1%} of the frames"
        notes.append(f"{text}; record one alone")
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


def _follow(
    positions: FloatArray, missing: BoolArray
) -> tuple[NDArray[np.intp], NDArray[np.bool_]]:
    """Which column holds each person in each frame, and whom the frames leave open.

    A person is who goes the shortest way from frame to frame, joint by joint: so bodies are told
    apart by where they are and by what they look like, also where they pass each other.

    Returns:
        (T, P) columns, and (T, P) whether a person could as well be in another's column.
    """
    frames, people = missing.shape[:2]
    order = np.tile(np.arange(people), (frames, 1))
    doubt = np.zeros((frames, people), np.bool_)
    there = np.logical_not(missing)
    seen: BoolArray = np.logical_or.reduce(there, axis=2)
    if not seen.any():
        return order, doubt
    weight = there[..., None] / np.maximum(there.sum(axis=2), 1)[..., None, None]
    places = np.where(missing[..., None], np.nan, positions).astype(np.float64)
    centre = (np.nan_to_num(places) * weight).sum(axis=2)
    spread = np.linalg.norm(places - centre[:, :, None], axis=-1)
    # From the middle of a body to its joints it is a quarter of its height.
    reach = 2 * float(np.median(spread[there]))

    def meet(by: int) -> NDArray[np.bool_]:
        """Whether a body is where the one `by` columns before was in the last frame."""
        step = centre[1:] - np.roll(centre, by, axis=1)[:-1]
        return np.asarray(np.linalg.norm(step, axis=2) <= reach)

    if seen.all() and meet(0).all() and not any(meet(by).any() for by in range(1, people)):
        return order, doubt
    last = np.full(places.shape[1:], np.nan)
    for frame in range(frames):
        here = np.flatnonzero(seen[frame])
        ways = _ways(last, places[frame], reach)
        own, near = ways[here, here], np.isfinite(ways[:, here]).any(axis=0)
        if ((own > reach) | (np.isnan(own) & near)).any():
            order[frame] = _assign(ways, here, reach)
        stay, swap = _exchanges(ways, order[frame])
        if (swap < stay).any():
            order[frame] = _assign(ways, here, reach)
            stay, swap = _exchanges(ways, order[frame])
        # Rounding must not exchange them back.
        while (swap < 0.999 * stay).any():
            one, other = np.unravel_index(np.nanargmax(stay - swap), stay.shape)
            order[frame, [one, other]] = order[frame, [other, one]]
            stay, swap = _exchanges(ways, order[frame])
        open_: BoolArray = swap < np.maximum(_OPEN * stay, 2 * _NEAR * reach)
        doubt[frame] = (open_ & ~np.eye(people, dtype=bool)).any(axis=1)
        for who in range(people):
            if seen[frame, order[frame, who]]:
                last[who] = places[frame, order[frame, who]]
    return order, doubt


def _exchanges(
    ways: NDArray[np.float64], order: NDArray[np.intp]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """How far each two people (P, P) go together: as they are ordered, and exchanged."""
    ways = ways[:, order]
    return ways.diagonal()[:, None] + ways.diagonal(), ways + ways.T


def _ways(last: NDArray[np.float64], now: NDArray[np.float64], reach: float) -> NDArray[np.float64]:
    """How far each person (P, J, 3) is from the body in each column: (P, P); NaN for nobody.

    Where it may matter, the mean over the joints that both have; else from middle to middle.
    """
    with np.errstate(invalid="ignore"):
        middles = [np.nansum(each, 1) / np.isfinite(each).sum(axis=1) for each in (last, now)]
        ways: NDArray[np.float64] = np.linalg.norm(middles[0][:, None] - middles[1], axis=2)
        one, other = np.nonzero(ways < 2 * reach)
        steps = np.linalg.norm(last[one] - now[other], axis=2)
        both = np.isfinite(steps)
        mean = np.where(both, steps, 0).sum(axis=1) / both.sum(axis=1)
    ways[one, other] = np.where(both.any(axis=1), mean, ways[one, other])
    return ways


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
