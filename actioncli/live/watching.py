"""Watching: the events of a camera, a video or an address, or of a clip as if one had sent it."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from contextlib import closing
from pathlib import Path
from typing import TYPE_CHECKING, Protocol

from actioncli.clips.clip import Clip
from actioncli.clips.edit import cut
from actioncli.errors import ClipError
from actioncli.live.events import STRIDE, Event, EventDetector, Sets
from actioncli.pose import RETRY_SECONDS
from actioncli.recognition.support import SupportSet
from actioncli.recognition.windows import is_long

if TYPE_CHECKING:
    from actioncli.live.recorder import Recorder

DEFAULT_QUALITY = "fast"


class Stream(Protocol):
    """A source of poses over time.

    Attributes:
        seen: whether somebody was in the last frame.
    """

    seen: bool

    def times(self) -> Iterator[float]:
        """Seconds of each frame, as it comes.

        Raises:
            ClipError: the stream is lost.
        """

    def clip(self) -> Clip | None:
        """The last seconds, ending with the last frame; None while nobody is followed."""

    def remember(self, seconds: float) -> None:
        """Keep so many seconds from now on, at least."""

    def state(self, now: float) -> str:
        """How the stream is doing, for people."""

    def end(self, frames: int) -> str | None:
        """What is to be said of how it ended, after so many frames.

        Raises:
            ClipError: there was nothing to watch.
        """
        return None

    def close(self) -> None:
        """Let go of the camera or the file."""


def watch(
    source: int | str | Path | Clip,
    support: SupportSet | Callable[[], SupportSet],
    tau: float | None = None,
    *,
    each: bool = True,
    facing: bool = False,
    quality: str = DEFAULT_QUALITY,
    hands: bool | None = None,
    retry: float = RETRY_SECONDS,
    recorder: Recorder | None = None,
    on_frame: Callable[[float, Stream, EventDetector], None] | None = None,
    note: Callable[[str], None] | None = None,
) -> Iterator[Event]:
    """Tell every enrolled action that somebody performs, one event for each repetition.

    Looks at the stream every `events.STRIDE` seconds. What the end of the stream, or Ctrl-C, cuts
    off is an event as well.

    Args:
        source: number of a camera, a video file, the address of a stream, or a clip, whose joints
            are taken as if they came one frame after another.
        support: what is enrolled; or what gives it, such as a `FollowedSupport`, and is asked at
            each look: what is enrolled, removed or calibrated meanwhile counts at once.
        tau: accept where the confidence is above it, instead of the threshold of `support`.
        each: tell each repetition when it ends; else a set of them, once nothing follows.
        facing: only what is done while facing the camera counts.
        quality: pose network, "fast" or "accurate".
        hands: look for hands; None: see `hands.hand_finder`.
        retry: seconds for which a camera or a stream that breaks is opened again.
        recorder: keeps the clips of events and near misses.
        on_frame: called after each frame, with its time.
        note: called with what a person should know.

    Raises:
        ClipError: the source cannot be opened, or is lost; after the last event.
        UsageError: an address of a kind that sends no pictures.
        SupportError: no action is enrolled.
    """
    follow = support if callable(support) else (lambda: support)
    enrolled = follow()
    enrolled.require_actions()
    detector = EventDetector(enrolled if tau is None else enrolled.with_tau(tau), facing)
    stream = open_stream(source, detector, quality, hands, retry, note)
    sets, now = Sets(), 0.0
    lost: ClipError | None = None
    with closing(stream):
        try:
            for now, look in frames_of(stream, detector, note):
                if look:
                    if (changed := follow()) is not enrolled:
                        enrolled = changed
                        current = enrolled if tau is None else enrolled.with_tau(tau)
                        detector.follow(current)
                        stream.remember(max(detector.windows) + 1)
                        if recorder is not None:
                            recorder.threshold = current.threshold
                    # Where nothing is enrolled any more, nobody can do it.
                    clip = stream.clip() if enrolled.actions else None
                    over = detector.update(clip, now)
                    yield from over if each else sets.update(over, now)
                    if recorder is not None:
                        busy = detector.current is not None
                        recorder.update(clip, now, detector.ranking, over, busy)
                if on_frame is not None:
                    on_frame(now, stream, detector)
        except KeyboardInterrupt:
            pass
        except ClipError as error:
            lost = error
        except GeneratorExit:  # who took the events has enough, or was interrupted
            if recorder is not None:
                recorder.finish(detector.finish())
            raise
        over = detector.finish()
        yield from over if each else sets.update(over, now) + sets.finish()
        if recorder is not None:
            recorder.finish(over)
    if lost is not None:
        raise lost


def events_in(clip: Clip, support: SupportSet) -> list[Event]:
    """All that is done in a clip that is much longer than the enrolled ones; nothing in another.

    Raises:
        SupportError: no action is enrolled.
    """
    return list(watch(clip, support)) if is_long(clip, support.durations.values()) else []


def open_stream(
    source: int | str | Path | Clip,
    detector: EventDetector,
    quality: str = DEFAULT_QUALITY,
    hands: bool | None = None,
    retry: float = RETRY_SECONDS,
    note: Callable[[str], None] | None = None,
) -> Stream:
    """A source, of which so much is remembered as the detector looks at; the rest is as in `watch`.

    Raises:
        ClipError, UsageError: as `watch`.
    """
    seconds = max(detector.windows) + 1
    if isinstance(source, Clip):
        return _ClipStream(source, seconds)
    from actioncli.live.stream import VideoStream

    return VideoStream(source, quality, seconds, hands, retry, note or (lambda line: None))


def frames_of(
    stream: Stream, detector: EventDetector, note: Callable[[str], None] | None = None
) -> Iterator[tuple[float, bool]]:
    """Seconds of each frame, and whether it is time to look at the stream.

    Args:
        note: hears at the end what is to be said of a stream that is over.

    Raises:
        ClipError: the stream is lost, or there was nothing to watch.
    """
    looked, frames, seen, now = -math.inf, 0, 0, 0.0
    for now in stream.times():
        frames += 1
        seen += stream.seen
        look = now - looked >= STRIDE
        looked = now if look else looked
        yield now, look
    lines = [stream.end(frames)]
    if not seen:
        lines.append(f"nobody was seen in any of {frames} frames")
    if frames and now < (shortest := min(detector.windows)):
        lines.append(
            f"{now:.1f} s are less than the {shortest:.1f} s that the quickest performance would "
            "take"
        )
    for line in lines:
        if note is not None and line is not None:
            note(line)


class _ClipStream(Stream):
    """A recorded clip, frame by frame; see `Stream`."""

    seen = True

    def __init__(self, clip: Clip, seconds: float) -> None:
        """Remember so many seconds at a time."""
        self._clip, self._seconds, self._now = clip, seconds, 0.0

    def times(self) -> Iterator[float]:
        """At the clip's rate."""
        for frame in range(len(self._clip)):
            self._now = frame / self._clip.fps
            yield self._now

    def clip(self) -> Clip | None:
        """As far as it has come."""
        try:
            return cut(self._clip, max(self._now - self._seconds, 0.0), self._now)
        except ClipError:  # nothing has moved
            return None

    def remember(self, seconds: float) -> None:
        """Keep so many seconds from now on, at least."""
        self._seconds = max(self._seconds, seconds)

    def state(self, now: float) -> str:
        """How much is left."""
        return f"{self._clip.duration - now:.0f} s left"

    def close(self) -> None:
        """Nothing to let go of."""
