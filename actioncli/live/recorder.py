"""Clips of what a stream showed, kept for review: events, and what nearly was one."""

from __future__ import annotations

import contextlib
import json
import math
import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from actioncli.errors import ClipError, UsageError
from actioncli.files import replacing

if TYPE_CHECKING:
    from actioncli.clips.clip import Clip
    from actioncli.live.events import Candidate, Event
    from actioncli.recognition.threshold import Threshold

# A look with a confidence this far from tau, or less, is near.
NEAR = 0.1

# Characters; a description has a few hundred.
_LONGEST_DESCRIPTION = 10_000

# A near miss is over after so many looks that are not near.
_LOOKS_TO_END = 3


@dataclass(frozen=True, slots=True)
class Kept:
    """A clip that waits for review; beside `file` lies its description as JSON.

    Attributes:
        file: the clip.
        label: of the nearest action.
        confidence: the highest that was reached.
        tau: the threshold of that action.
        event: whether it was reported as an event; else it was a near miss.
        start, end: seconds of the stream.
        source: the stream.
    """

    file: Path
    label: str
    confidence: float
    tau: float
    event: bool
    start: float
    end: float
    source: str

    @property
    def origin(self) -> str:
        """Which part of which stream it was, for people."""
        return f"{self.source} {self.start:.1f} s to {self.end:.1f} s"

    def to_json(self) -> dict[str, object]:
        """As plain values."""
        return {**asdict(self), "file": str(self.file)}

    def clip(self) -> Clip:
        """Read the clip.

        Raises:
            ClipError: it cannot be read.
        """
        from actioncli.clips.read import read_clip

        # As it was written: a body in a stream may look unlike a standing person.
        return read_clip(self.file, unit="m", up="y")

    def forget(self) -> None:
        """Delete the clip and its description.

        Raises:
            UsageError: they cannot be deleted.
        """
        try:
            # The description last: without the clip it is not found any more.
            self.file.unlink(missing_ok=True)
            self.file.with_suffix(".json").unlink(missing_ok=True)
        except OSError as error:
            raise UsageError(f"{self.file}: cannot be deleted: {error.strerror}.") from error


class Recorder:
    """Keeps the clip of every event, and of every near miss, in a folder, for its owner only.

    A near miss is a stretch in which the surest action stays within `NEAR` of its threshold
    without becoming an event; its clip is the window that came nearest. What leads up to an event
    or follows it is no near miss.

    Attributes:
        threshold: of the actions; it may change.
    """

    def __init__(self, folder: Path, threshold: Threshold, source: str) -> None:
        """Make the folder.

        Raises:
            UsageError: it cannot be made.
        """
        try:
            folder.mkdir(mode=0o700, parents=True, exist_ok=True)
        except OSError as error:
            raise UsageError(f"{folder}: cannot be made: {error.strerror}.") from error
        self._folder, self.threshold, self._source = folder, threshold, source
        self._seen: tuple[Clip, float] | None = None
        self._near: tuple[Candidate, tuple[Clip, float] | None] | None = None
        self._quiet = 0
        self._event_end = float("-inf")

    def update(
        self,
        clip: Clip | None,
        now: float,
        ranking: Sequence[Candidate],
        events: Sequence[Event],
        busy: bool,
    ) -> None:
        """Take in one look at the stream.

        Args:
            clip: the last seconds, ending at `now`; None while nobody is seen.
            now: seconds of the stream.
            ranking: what the look said, surest first.
            events: those that it ended.
            busy: whether an event is going on.

        Raises:
            ClipError: a clip cannot be written.
        """
        if clip is not None:
            self._seen = clip, now
        for event in events:
            self._keep_event(event)
        if busy:
            self._near = None
            return
        best = ranking[0] if ranking and clip is not None else None
        if (
            best is not None
            and best.start >= self._event_end
            and abs(best.confidence - self.threshold.of(best.label)) <= NEAR
        ):
            self._quiet = 0
            if self._near is None or best.confidence > self._near[0].confidence:
                self._near = best, self._seen
        elif self._near is not None:
            self._quiet += 1
            if self._quiet >= _LOOKS_TO_END:
                self._keep_near()

    def finish(self, events: Sequence[Event]) -> None:
        """Keep what the end of the stream cuts off.

        Raises:
            ClipError: a clip cannot be written.
        """
        for event in events:
            self._keep_event(event)
        self._keep_near()

    def _keep_event(self, event: Event) -> None:
        self._event_end, self._near = event.end, None
        self._keep(event, self._seen, event.end)

    def _keep_near(self) -> None:
        if self._near is not None:
            (best, seen), self._near = self._near, None
            self._keep(best, seen)

    def _keep(
        self, found: Event | Candidate, seen: tuple[Clip, float] | None, end: float | None = None
    ) -> None:
        """Write what was seen of an event until its end, or of a near miss until then."""
        part = seen and part_of(*seen, found.start, seen[1] if end is None else end)
        if seen is None or part is None:
            return
        from actioncli.clips.write import write_clip

        file = self._new_file(re.sub(r"[^\w-]+", "_", found.label)[:40])
        description = {
            "label": found.label,
            "confidence": found.confidence,
            "tau": self.threshold.of(found.label),
            "event": end is not None,
            "start": found.start,
            "end": seen[1] if end is None else end,
            "source": self._source,
        }
        try:
            write_clip(file, part, private=True)
            with replacing(file.with_suffix(".json"), private=True) as text:
                text.write_text(f"{json.dumps(description, indent=1)}\n", encoding="utf-8")
        except BaseException as error:
            file.unlink(missing_ok=True)
            if isinstance(error, OSError):
                raise ClipError(f"{file}: cannot be written: {error.strerror}.") from error
            raise

    def _new_file(self, name: str) -> Path:
        """An empty file with the next number, which is nobody else's: others may record here.

        Raises:
            ClipError: it cannot be made.
        """
        try:
            number = max((_number(file) for file in self._folder.iterdir()), default=0)
            while True:
                number += 1
                file = self._folder / f"{number:04d}_{name}.npz"
                with contextlib.suppress(FileExistsError):
                    file.touch(mode=0o600, exist_ok=False)
                    return file
        except OSError as error:
            raise ClipError(f"{self._folder}: cannot be written: {error.strerror}.") from error


def kept_clips(folder: Path) -> list[Kept]:
    """The clips of a folder that wait for review, in the order of recording.

    Raises:
        UsageError: there is no such folder, or a description in it is damaged.
    """
    if not folder.is_dir():
        raise UsageError(f"{folder}: no such folder; `actioncli watch --record FOLDER` fills one.")
    found = []
    for description in sorted(filter(_number, folder.glob("*.json")), key=_in_order):
        clip = description.with_suffix(".npz")
        if not clip.is_file():
            continue
        try:
            with description.open(encoding="utf-8") as file:
                document = json.loads(file.read(_LONGEST_DESCRIPTION))
            values = {name: kind(document[name]) for name, kind in _DESCRIPTION.items()}
            found.append(Kept(clip, **values))
        except (OSError, ValueError, TypeError, KeyError, RecursionError) as error:
            raise UsageError(
                f"{description}: damaged ({type(error).__name__}: {error}); delete it and its clip."
            ) from error
    return found


def _finite(number: Any) -> float:
    # JSON of Python's can hold `NaN`, which nobody wrote here and no page could show.
    value = float(number)
    if not math.isfinite(value):
        raise ValueError(f"{value} is no finite number")
    return value


_DESCRIPTION: Mapping[str, Callable[[Any], Any]] = {
    **dict.fromkeys(("label", "source"), str),
    **dict.fromkeys(("confidence", "tau", "start", "end"), _finite),
    "event": bool,
}


def _number(file: Path) -> int:
    """From 1, as the name of a clip and its description begins; 0 for any other file."""
    digits = re.match(r"([0-9]{4,18})_", file.name)
    return int(digits[1]) if digits else 0


def _in_order(file: Path) -> tuple[int, str]:
    return _number(file), file.name


def part_of(clip: Clip, now: float, start: float, end: float) -> Clip | None:
    """What the stream showed from `start` to `end`, as far as `clip`, which ends at `now`, goes
    back; None where nothing moved."""
    from actioncli.clips.edit import cut

    before = now - clip.duration
    try:
        part = cut(clip, max(start - before, 0.0), end - before)
    except ClipError:
        return None
    return replace(part, source="", notes=(), start=0.0)
