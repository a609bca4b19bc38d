"""False events: what `watch` would tell of an ordinary day, in which no action is done."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from contextlib import closing
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from actioncli.clips.clip import Clip
from actioncli.errors import ClipError
from actioncli.live.events import Event, EventDetector
from actioncli.live.recorder import part_of
from actioncli.live.watching import DEFAULT_QUALITY, Stream, frames_of, open_stream
from actioncli.recognition.support import SupportSet

# Thresholds that are tried: that a quiet day says nothing against a lower one than the usual
# does not speak for it.
TAUS = tuple(step / 20 for step in range(10, 20))
# The surest false events are as many negatives; every look takes time for each of them.
MOST_NEGATIVES = 20
# Seconds between looks that count: what a camera did not show for longer was not seen.
_BREAK = 1.0


@dataclass(frozen=True, slots=True, eq=False)
class Background:
    """How often an ordinary day is taken for an action.

    Attributes:
        seconds: in which somebody was seen.
        events: false events by threshold, for each of `TAUS`.
        nearest: the events of the lowest of these, surest first, with their clips.
    """

    seconds: float
    events: Mapping[float, int]
    nearest: tuple[tuple[Event, Clip], ...]

    def rates(self) -> list[dict[str, float]]:
        """Events over tau: how many, how many that is an hour, and `high`, the upper end of the
        95 % interval of that."""
        hours = self.seconds / 3600
        return [
            {"tau": tau, "events": n, "an_hour": n / hours, "high": at_most(n) / hours}
            for tau, n in self.events.items()
        ]

    def tau(self, target: float) -> float | None:
        """The lowest threshold from which on there are at most `target` events an hour."""
        allowed = target * self.seconds / 3600
        kept = None
        for tau in reversed(TAUS):
            if self.events[tau] > allowed:
                break
            kept = tau
        return kept

    def notes(self, target: float) -> list[str]:
        """What the figures cannot tell; sentences."""
        found = []
        tau = self.tau(target)
        if tau is None:
            found.append(
                f"No threshold up to {TAUS[-1]:g} holds {target:g} false events an hour. Keep what "
                "came nearest as negatives, and try another recording; or enrol an action that "
                "everyday motion resembles less."
            )
        high = at_most(self.events[TAUS[-1] if tau is None else tau]) / self.seconds * 3600
        if tau is not None and high > target:
            hours = at_most(0) / target
            found.append(
                f"{self.seconds / 60:.1f} minutes are few: it may be up to {high:.1f} events an "
                f"hour. {hours:.1f} hours without an event would show that it is at most "
                f"{target:g}."
            )
        return found

    def to_json(self) -> dict[str, Any]:
        """As plain values."""
        told = [event.to_json() for event, _ in self.nearest]
        return {"minutes": self.seconds / 60, "rates": self.rates(), "events": told}


def watch_background(
    source: int | str | Path | Clip,
    support: SupportSet,
    seconds: float = math.inf,
    *,
    quality: str = DEFAULT_QUALITY,
    hands: bool | None = None,
    note: Callable[[str], None] | None = None,
    on_frame: Callable[[float, Stream], None] | None = None,
) -> Background:
    """Count events of a source in which no enrolled action is done, under every threshold at once.

    Args:
        source, quality, hands, note: as in `watching.watch`.
        support: what is enrolled.
        seconds: how much of the source to look at.
        on_frame: called after each frame, with its time.

    Raises:
        ClipError: the source cannot be opened or is lost, or nobody was seen.
        UsageError: an address of a kind that sends no pictures.
        SupportError: no action is enrolled.
    """
    support.require_actions()
    detectors = {tau: EventDetector(support.with_tau(tau)) for tau in TAUS}
    lowest = detectors[TAUS[0]]
    counts = dict.fromkeys(TAUS, 0)
    nearest: list[tuple[Event, Clip]] = []
    last: tuple[Clip, float] | None = None
    looked, spent = -math.inf, 0.0

    def count(tau: float, over: list[Event]) -> None:
        counts[tau] += len(over)
        if tau != TAUS[0] or last is None:
            return
        parts = [(event, part_of(*last, event.start, event.end)) for event in over]
        nearest.extend((event, part) for event, part in parts if part is not None)

    with closing(open_stream(source, lowest, quality, hands, note=note)) as stream:
        for now, look in frames_of(stream, lowest, note):
            if look:
                spent += now - looked if stream.seen and now - looked < _BREAK else 0
                looked, clip = now, stream.clip()
                last = last if clip is None else (clip, now)
                odds = lowest.look(clip)
                for tau, detector in detectors.items():
                    count(tau, detector.take(odds, clip, now))
            if on_frame is not None:
                on_frame(now, stream)
            if now >= seconds:
                break
    for tau, detector in detectors.items():
        count(tau, detector.finish())
    if not spent:
        name = source.source if isinstance(source, Clip) else source
        raise ClipError(f"{name}: nobody was seen, so that false events cannot be counted.")
    nearest.sort(key=lambda each: -each[0].confidence)
    return Background(spent, counts, tuple(nearest))


def negatives_of(found: Background, name: str) -> list[Clip]:
    """The clips of the surest false events, for `enrol`, named after their source."""
    return [
        replace(clip, source=f"{name} {event.start:.1f} s to {event.end:.1f} s")
        for event, clip in found.nearest[:MOST_NEGATIVES]
    ]


def at_most(events: int) -> float:
    """The upper end of the exact 95 % interval of how many are expected where so many came.

    F. Garwood: Fiducial Limits for the Poisson Distribution, 1936.
    """

    def share(mean: float) -> float:
        """How probable so many, or fewer, are."""
        logs = (n * math.log(mean) - mean - math.lgamma(n + 1) for n in range(events + 1))
        return math.fsum(map(math.exp, logs))

    low, high = events + 0.5, events + 5 * math.sqrt(events + 1) + 5
    while high - low > 1e-6:
        middle = (low + high) / 2
        low, high = (middle, high) if share(middle) > 0.025 else (low, middle)
    return high
