"""Performed actions in a stream of poses: sliding windows, and hysteresis over their scores."""

from __future__ import annotations

from dataclasses import asdict, dataclass, replace

import numpy as np

from actioncli.clips.clip import Clip
from actioncli.errors import ClipError
from actioncli.recognition.support import SupportSet
from actioncli.recognition.windows import window_lengths

# Seconds between looks at the stream.
STRIDE = 0.25
# Seconds of the longest window: the stream is not kept for longer.
_LONGEST = 8.0
# An event begins after so many looks above tau in a row, and ends after so many below what holds.
_LOOKS_TO_BEGIN, _LOOKS_TO_END = 2, 3
# A confidence above this share of tau keeps an event going.
_HOLDS = 0.8


@dataclass(frozen=True, slots=True)
class Event:
    """One performed action: its label, when (seconds), and the highest confidence reached."""

    label: str
    start: float
    end: float
    confidence: float

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
        ranking: what the last look said, surest first.
    """

    ranking: tuple[Candidate, ...] = ()
    _event: Event | None = None
    # Looks above tau in a row, all at one action.
    _rising: tuple[Candidate, ...] = ()
    _quiet = 0
    _last_end = 0.0

    def __init__(self, support: SupportSet) -> None:
        """Prepare; a window that is nearest to a negative shows no action."""
        self.follow(support)

    def follow(self, support: SupportSet) -> None:
        """What is enrolled has changed.

        An event that is going on goes on; that of an action which is no more is forgotten.
        """
        self._recognizer, self._threshold = support.recognizer, support.threshold
        self._actions = frozenset(support.actions)
        # Each negative competes like an action, under a name that no label can have.
        negatives = {f"\n{n}": one[np.newaxis] for n, one in enumerate(support.negatives)}
        self._support = {**support.actions, **negatives}
        if support.durations:
            self.windows = window_lengths(support.durations.values(), _LONGEST)
        if self._event is not None and self._event.label not in self._actions:
            self._event = None
        self._rising = tuple(seen for seen in self._rising if seen.label in self._actions)

    @property
    def current(self) -> Event | None:
        """The event that is going on."""
        return self._event

    def update(self, clip: Clip | None, now: float) -> list[Event]:
        """Look at the stream as it is now.

        Args:
            clip: the last seconds, ending at `now`; None while nobody is seen.

        Returns:
            Events that are over.
        """
        self.ranking = self._candidates(clip, now) if clip is not None else ()
        best = self.ranking[0] if self.ranking else None
        if best is not None and best.confidence > self._threshold.of(best.label):
            same = self._rising and self._rising[-1].label == best.label
            self._rising = (*self._rising, best) if same else (best,)
        else:
            self._rising = ()
        begins = best if len(self._rising) >= _LOOKS_TO_BEGIN else None
        done = self._carry_on(self._event, begins, now) if self._event is not None else []
        if self._event is None and begins is not None:
            start = max(min(seen.start for seen in self._rising), self._last_end)
            sure = max(seen.confidence for seen in self._rising)
            self._event, self._quiet = Event(begins.label, start, now, sure), 0
        return done

    def finish(self) -> list[Event]:
        """The event that the end of the stream cuts off, if there is one."""
        return self._close() if self._event is not None else []

    def _carry_on(self, event: Event, begins: Candidate | None, now: float) -> list[Event]:
        held = [seen for seen in self.ranking if seen.label == event.label]
        challenged = begins is not None and begins.label != event.label
        holds = _HOLDS * self._threshold.of(event.label)
        if held and held[0].confidence > holds and not challenged:
            sure = max(event.confidence, held[0].confidence)
            self._event, self._quiet = replace(event, end=now, confidence=sure), 0
            return []
        self._quiet += 1
        return self._close() if challenged or self._quiet >= _LOOKS_TO_END else []

    def _close(self) -> list[Event]:
        assert self._event is not None
        event, self._event = self._event, None
        self._last_end = event.end
        return [event]

    def _candidates(self, clip: Clip, now: float) -> tuple[Candidate, ...]:
        """The best window of each action that is a window's nearest."""
        parts = []
        for seconds in self.windows:
            frames = round(seconds * clip.fps) + 1
            if frames > len(clip):  # as are all that follow
                break
            try:
                part = Clip(clip.joints[-frames:], clip.joint_names, clip.fps)
            except ClipError:  # no motion at all in this window
                continue
            parts.append((seconds, part))
        if not parts:
            return ()
        comparison = self._recognizer.compare([part for _, part in parts], self._support)
        best: dict[str, Candidate] = {}
        for row, (seconds, _) in enumerate(parts):
            nearest = int(comparison.distance[row].argmin())
            label = str(comparison.labels[nearest])
            sure = float(comparison.confidence[row, nearest])
            if label not in self._actions:
                continue
            if label not in best or sure > best[label].confidence:
                best[label] = Candidate(label, sure, now - seconds)
        return tuple(sorted(best.values(), key=lambda seen: -seen.confidence))
