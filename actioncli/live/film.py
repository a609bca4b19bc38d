"""A video that was watched, with the skeleton and what was told drawn on it."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from actioncli.errors import ClipError
from actioncli.live.events import Event
from actioncli.live.reactions import Reaction
from actioncli.live.stream import VideoStream
from actioncli.live.watching import Stream
from actioncli.pose.annotate import annotate_video
from actioncli.pose.landmarks import Body
from actioncli.pose.poses import Poses
from actioncli.pose.video import Progress

# An event stays on the picture for at least so long.
_LEAST_SECONDS = 1.0


class Film(Reaction):
    """Keeps what is seen of the person, and what is told, while a video is watched."""

    def __init__(self) -> None:
        """Nothing was seen yet."""
        self._events: list[Event] = []
        self._frames: list[float] = []
        self._seen: list[tuple[float, Body]] = []
        self._size = (0, 0)

    def __call__(self, event: Event) -> None:
        """Keep what was told."""
        self._events.append(event)

    def add(self, now: float, stream: Stream) -> None:
        """Keep the body in the last frame."""
        if isinstance(stream, VideoStream):
            self._frames.append(now)
            self._size = stream.poses.size
            if stream.poses.body is not None:
                self._seen.append((now, stream.poses.body))

    def lines(self, now: float) -> list[str]:
        """What is told of the events at a time, seconds."""
        return [
            f"✓ {event.counted} {event.confidence:.2f}"
            for event in self._events
            if event.start <= now <= max(event.end, event.start + _LEAST_SECONDS)
        ]

    def write(self, video: Path, output: Path, progress: Callable[[Progress], None] | None) -> None:
        """Draw.

        Raises:
            ClipError: nobody was seen, or the file cannot be written.
        """
        if not self._seen:
            raise ClipError(f"{video}: nobody is seen in it; there is nothing to draw.")
        times, bodies = zip(*self._seen, strict=True)
        poses = Poses.of(times, bodies, self._frames, self._size)
        annotate_video(video, output, poses, self.lines, progress)
