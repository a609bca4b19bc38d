"""Windows of a long clip: where in it an action may be.

A clip is compared as a whole, which is right where it holds one performance. In a clip much longer
than the enrolled ones the performance is a part, so windows of about their length compete with the
whole. More windows are more chances of a false match; therefore a window's odds against a match
are multiplied by the number of windows to the power of `CHANCES`. The constants were chosen on
classes that the model had not seen (`tools/measure_windows.py`): with this power about as many
unknown queries are accepted in long clips as in clips of one performance.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from math import inf

import numpy as np

from actioncli.clips.axes import median
from actioncli.clips.clip import Clip
from actioncli.clips.edit import cut
from actioncli.errors import ClipError

# A clip is long if it lasts so many times as long as the median of the enrolled ones.
LONG = 1.5
# Windows follow each other at this share of their length.
STRIDE = 0.25
CHANCES = 0.15

# Windows are this much shorter and longer than the enrolled examples, so that fast and slow
# performances match; each is at most so many times as long as the one before.
FASTER, SLOWER, _GROWTH = 0.7, 1.4, 1.45
_SHORTEST = 0.8
# From frame to frame of a window; fewer show no action, however slowly frames came.
_FEWEST_STEPS = 3


def mean_durations(examples: Iterable[tuple[str, float]]) -> dict[str, float]:
    """Of each action the mean duration of its examples, seconds, from labels and durations: what
    windows are cut by."""
    by_label: dict[str, list[float]] = {}
    for label, seconds in examples:
        by_label.setdefault(label, []).append(seconds)
    return {label: sum(seconds) / len(seconds) for label, seconds in by_label.items()}


def window_lengths(durations: Iterable[float], longest: float = inf) -> tuple[float, ...]:
    """Lengths of windows, seconds, for actions of these durations."""
    clipped = np.clip(list(durations), _SHORTEST, longest)
    low = max(FASTER * float(clipped.min()), _SHORTEST)
    high = min(SLOWER * float(clipped.max()), longest)
    count = max(1, int(np.ceil(np.log(high / low) / np.log(_GROWTH))))
    return tuple(np.geomspace(low, high, count + 1).tolist())


def windows(clip: Clip, durations: Iterable[float]) -> Iterator[Clip]:
    """The parts of a long clip that compete with the whole; none where it is not long.

    There can be ten thousand in an hour, so they are cut out as they are asked for.

    Args:
        clip: a query.
        durations: of the enrolled actions, seconds; none where they are not known.
    """
    for seconds, count in _counts(clip, durations):
        for start in np.linspace(0, clip.duration - seconds, count).tolist():
            try:
                yield cut(clip, start, start + seconds)
            except ClipError:  # nothing moves in this window
                continue


def most_windows(clip: Clip, durations: Iterable[float]) -> int:
    """How many `windows` are cut, those included in which nothing moves."""
    return sum(count for _, count in _counts(clip, durations))


def is_long(clip: Clip, durations: Iterable[float]) -> bool:
    """Whether a clip is so much longer than the enrolled ones that an action may be a part of it;
    not where their durations, seconds, are not known."""
    seconds = np.array(list(durations))
    return bool(len(seconds)) and clip.duration > LONG * float(median(seconds))


def _counts(clip: Clip, durations: Iterable[float]) -> Iterator[tuple[float, int]]:
    """Length, seconds, and number of the windows of a long clip."""
    seconds_of_actions = list(durations)
    if not is_long(clip, seconds_of_actions):
        return
    for seconds in window_lengths(seconds_of_actions):
        room = clip.duration - seconds
        if room > 0 and seconds * clip.fps >= _FEWEST_STEPS:
            yield seconds, int(np.ceil(room / (STRIDE * seconds))) + 1


def odds_factor(count: int) -> float:
    """The factor on the odds against a match, if it is the best of `count` windows."""
    return float(max(count, 1) ** CHANCES)
