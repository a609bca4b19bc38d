"""Performed actions in a stream of poses: sliding windows, and the best of those that overlap.

A window whose nearest action is one of about its length, surer than the threshold, is a match. Who
looks at a stream again and again has many chances of a false one, so its odds count `ODDS` times
less than those of a clip; what was just done is often done again, and counts `AGAIN` times less.
What remains the best for `_UNBEATEN` seconds is an event, its bounds are those of the motion in its
window, and the next one begins where it ended: every repetition is an event. Averages over
neighbouring windows and looks told no more at as many false events an hour.
"""

from __future__ import annotations

import contextlib
import math
from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace

import numpy as np

from actioncli.clips.active import active_part
from actioncli.clips.checks import is_still
from actioncli.clips.clip import Clip, FloatArray
from actioncli.clips.edit import cut
from actioncli.clips.view import faces_sensor
from actioncli.errors import ClipError
from actioncli.recognition.support import SupportSet
from actioncli.recognition.windows import FASTER, SLOWER, window_lengths

# Seconds between looks at the stream.
STRIDE = 0.2
# Fitted by `tools/measure_live.py` on classes that the model had not seen: at a threshold of 0.5,
# fewer than five false events an hour among other exercises.
ODDS = 4.0
# Fitted on classes of the training: more repetitions told, and no more false events at 0.5.
AGAIN = 2.0
# Seconds of the longest window: the stream is not kept for longer.
_LONGEST = 8.0
_UNBEATEN = 0.4
# How much of a window may lie before the end of the last event.
_OVERLAP = 0.25
# Log odds of a window that cannot be compared.
_NEVER = -12.0
# A window may begin in the motion before: standing still for longer than this parts the two.
_PAUSE = 0.8
# Events of one action follow each other in a set where the rest between them is no longer than
# the last one, or than this many seconds.
_REST = 2.0


@dataclass(frozen=True, slots=True)
class Event:
    """One performed action.

    Attributes:
        label: which.
        start, end: seconds of the stream.
        confidence: the highest that was reached.
        repetitions: how often in a row it was done, this one included.
    """

    label: str
    start: float
    end: float
    confidence: float
    repetitions: int = 1

    @property
    def counted(self) -> str:
        """The label, and how often in a row it was done where that is more than once."""
        return self.label + (f" x{self.repetitions}" if self.repetitions > 1 else "")

    def to_json(self) -> dict[str, object]:
        """As plain values."""
        return asdict(self)


@dataclass(frozen=True, slots=True)
class Candidate:
    """What one look says about one action: the best window's confidence, and its beginning."""

    label: str
    confidence: float
    start: float


class EventDetector:
    """Finds events in a stream.

    Attributes:
        windows: lengths of the windows, seconds.
        ranking: what the last look said of each action, surest first.
        current: the match that becomes an event if nothing beats it.
    """

    ranking: tuple[Candidate, ...] = ()
    current: Event | None = None
    # When the current match was the best, and the last event.
    _matched = 0.0
    _last: Event | None = None

    def __init__(self, support: SupportSet, facing: bool = False) -> None:
        """Prepare; a window that is nearest to a negative shows no action.

        Args:
            facing: only what is done while facing the sensor counts.
        """
        self._facing = facing
        self.follow(support)

    def follow(self, support: SupportSet) -> None:
        """What is enrolled has changed.

        A match that becomes an event still does, but one of an action which is no more.
        """
        self._recognizer, self._threshold = support.recognizer, support.threshold
        # Each negative competes like an action, under a name that no label can have.
        negatives = {f"\n{n}": one[np.newaxis] for n, one in enumerate(support.negatives)}
        self._support = {**support.actions, **negatives}
        if support.durations:
            self.windows = window_lengths(support.durations.values(), _LONGEST)
        # An action is looked for in windows of about its length.
        usual = np.array([support.durations[label] for label in support.actions])
        lengths = np.array(self.windows)[:, None]
        usual = usual.clip(lengths[0] / FASTER, lengths[-1] / SLOWER)
        self._fits = (lengths > 0.99 * FASTER * usual) & (lengths < 1.01 * SLOWER * usual)
        if self.current is not None and self.current.label not in support.actions:
            self.current = None

    def update(self, clip: Clip | None, now: float) -> list[Event]:
        """Look at the stream as it is now.

        Args:
            clip: the last seconds, ending at `now`; None while nobody is seen.

        Returns:
            Events that are over.
        """
        return self.take(self.look(clip), clip, now)

    def look(self, clip: Clip | None) -> FloatArray:
        """Compare what the stream shows.

        Returns:
            (windows, actions and negatives) log odds, at least `_NEVER`.
        """
        odds = np.full((len(self.windows), len(self._support)), _NEVER, np.float32)
        parts, rows = [], []
        for row, seconds in enumerate(self.windows):
            if clip is None or seconds > clip.duration + 0.5 / clip.fps:  # as are all that follow
                break
            with contextlib.suppress(ClipError):  # no motion at all in this window
                parts.append(cut(clip, clip.duration - seconds, clip.duration))
                rows.append(row)
        if parts:
            sure = self._recognizer.compare(parts, self._support).confidence
            odds[rows] = np.log(sure.clip(1e-6)) - np.log1p(-sure.clip(None, 1 - 1e-6))
        return odds.clip(_NEVER)

    def take(self, odds: FloatArray, clip: Clip | None, now: float) -> list[Event]:
        """What `look` said of `clip` at `now`, see `update`."""
        candidates = self._candidates(odds, now)
        best: dict[str, Candidate] = {}
        for seen in candidates:
            best.setdefault(seen.label, seen)
        self.ranking = tuple(best.values())
        since = self._last.end if self._last is not None else -math.inf
        over = []
        for seen in candidates:
            if seen.confidence <= self._threshold.of(seen.label):
                continue
            room = _OVERLAP * (now - seen.start)
            if seen.start < since - room or clip is None:
                continue
            shown = _window(seen, clip, now)
            if is_still(shown) or (self._facing and not faces_sensor(shown)):
                continue
            match = self.current
            if match is None or seen.start >= match.end - room:
                over += self._tell()
            elif seen.confidence <= match.confidence:
                continue
            # The motion in the window bounds the event.
            start, end = active_part(shown, _PAUSE)
            self.current = Event(seen.label, seen.start + start, seen.start + end, seen.confidence)
            self._matched = now
            break
        if self.current is not None and now - self._matched > _UNBEATEN - STRIDE / 2:
            over += self._tell()
        return over

    def finish(self) -> list[Event]:
        """The match that the end of the stream cuts off, if there is one."""
        return self._tell()

    def _tell(self) -> list[Event]:
        event, self.current = self.current, None
        if event is None:
            return []
        last = self._last
        if last is not None:
            event = replace(event, start=max(event.start, last.end))
            if self._repeats(event.label, event.start):
                event = replace(event, repetitions=last.repetitions + 1)
        self._last = event
        return [event]

    def _repeats(self, label: str, start: float) -> bool:
        """Whether an action that begins then is one of a set with the last event."""
        last = self._last
        if last is None or last.label != label:
            return False
        return start - last.end <= max(_REST, last.end - last.start)

    def _candidates(self, odds: FloatArray, now: float) -> list[Candidate]:
        """Windows whose nearest is an action that they fit, surest first."""
        labels, found = list(self._support), []
        for row, of_row in enumerate(odds):
            nearest = int(of_row.argmax()) if labels else -1
            fits = 0 <= nearest < self._fits.shape[1] and self._fits[row, nearest]
            if fits and of_row[nearest] > _NEVER:
                label, start = labels[nearest], now - self.windows[row]
                price = AGAIN if self._repeats(label, start) else ODDS
                sure = 1 / (1 + price * math.exp(-float(of_row[nearest])))
                found.append(Candidate(label, sure, start))
        return sorted(found, key=lambda seen: -seen.confidence)


def _window(seen: Candidate, clip: Clip, now: float) -> Clip:
    """What the stream, of which `clip` ends at `now`, showed from the candidate's beginning on."""
    return cut(clip, clip.duration - (now - seen.start), clip.duration)


class Sets:
    """Joins the repetitions of an action to one event, which is told when the set is over."""

    _set: Event | None = None
    _length = 0.0

    def update(self, over: Sequence[Event], now: float) -> list[Event]:
        """Take events as they are told; the sets that are over by now."""
        done = []
        for event in over:
            if event.repetitions == 1:
                done += self.finish()
                self._set = event
            elif self._set is not None:
                sure = max(self._set.confidence, event.confidence)
                self._set = replace(
                    self._set, end=event.end, confidence=sure, repetitions=event.repetitions
                )
            self._length = event.end - event.start
        # The next one may begin after a rest, and takes its time.
        if self._set is not None and now - self._set.end > _REST + 2 * max(self._length, _REST):
            done += self.finish()
        return done

    def finish(self) -> list[Event]:
        """The set that the end of the stream cuts off, if there is one."""
        found, self._set = self._set, None
        return [] if found is None else [found]


def sets_of(events: Sequence[Event]) -> list[Event]:
    """The sets of a recording's events."""
    sets = Sets()
    over = [done for event in events for done in sets.update([event], event.end)]
    return over + sets.finish()
