"""Poses of one person as they come: from a camera, an address or a file."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np

from actioncli.clips.clip import Clip
from actioncli.errors import ClipError
from actioncli.pose import RETRY_SECONDS
from actioncli.pose.camera import LiveSource, open_source
from actioncli.pose.detector import PersonDetector
from actioncli.pose.frames import Frame, VideoFile
from actioncli.pose.hands import hand_finder
from actioncli.pose.landmarks import Body, LandmarkEstimator
from actioncli.pose.poses import LONGEST_GAP, Poses
from actioncli.pose.tracker import Tracker
from actioncli.pose.video import SAMPLING_RATE


class PoseStream:
    """Follows one person and remembers the last seconds.

    Attributes:
        size: width and height of the last frame.
        body: what was seen in the last frame; None if nobody.
    """

    def __init__(self, quality: str, seconds: float, hands: bool | None = None) -> None:
        """Load the networks.

        Args:
            quality: "fast" or "accurate".
            seconds: how much to remember.
            hands: look for hands; None: see `hands.hand_finder`.
        """
        finder = hand_finder(hands)
        self._networks = PersonDetector(), LandmarkEstimator(quality), 1, finder
        self._tracker = Tracker(*self._networks)
        self._seconds = seconds
        self._frames: list[float] = []
        self.size = (0, 0)
        self.body: Body | None = None

    def add(self, frame: Frame) -> None:
        """Take in a frame."""
        size = frame.image.shape[1], frame.image.shape[0]
        if size != self.size:  # where people were means nothing any more
            self.size, self._frames = size, []
            self._tracker = Tracker(*self._networks)
        seen = self._tracker(frame.image, frame.time)
        self.body = seen[0].bodies[-1] if seen else None
        self._frames.append(frame.time)
        oldest = frame.time - self._seconds
        while self._frames[0] < oldest:
            del self._frames[0]
        for track in self._tracker.tracks:
            while track.times and track.times[0] < oldest:
                del track.times[0], track.bodies[0]

    def remember(self, seconds: float) -> None:
        """From now on so much, where that is more."""
        self._seconds = max(self._seconds, seconds)

    def lose(self) -> None:
        """There is no picture: nobody is seen."""
        self.body = None

    def clip(self) -> Clip | None:
        """The remembered seconds as far back as the person was followed without a break.

        Returns:
            A clip that ends with the last frame; None while nobody is followed.
        """
        if self.body is None:
            return None
        (track,) = self._tracker.tracks
        times = np.array(track.times)
        breaks = np.flatnonzero(np.diff(times) > LONGEST_GAP)
        first = int(breaks[-1]) + 1 if len(breaks) else 0
        if track.jumps:
            first = max(first, int(np.searchsorted(times, track.jumps[-1])))
        if len(times) - first < 2:
            return None
        looked = [frame for frame in self._frames if frame >= times[first]]
        poses = Poses.of(track.times[first:], track.bodies[first:], looked, self.size)
        try:
            return poses.to_clip("stream")
        except ClipError:  # the picture has not moved at all
            return None


class VideoStream:
    """A camera, an address or a file, with the person in it; see `watching.Stream`.

    Attributes:
        poses: the person, in the last seconds.
    """

    seen = False

    def __init__(
        self,
        source: int | str | Path,
        quality: str,
        seconds: float,
        hands: bool | None = None,
        retry: float = RETRY_SECONDS,
        note: Callable[[str], None] = lambda line: None,
    ) -> None:
        """Open the source, see `open_source`; of it so many seconds are remembered.

        Raises:
            ClipError: it cannot be opened.
            UsageError: it is no kind of source.
        """
        self._source = open_source(source, retry, note)
        self.poses, self._begun = PoseStream(quality, seconds, hands), time.monotonic()

    def times(self) -> Iterator[float]:
        """As frames come."""
        source = self._source
        frames = source.frames() if isinstance(source, LiveSource) else file_frames(source)
        for frame in frames:
            if isinstance(frame, Frame):
                self.poses.add(frame)
            else:
                self.poses.lose()
            self.seen = self.poses.body is not None
            yield frame.time if isinstance(frame, Frame) else frame

    def clip(self) -> Clip | None:
        """The last seconds."""
        return self.poses.clip()

    def remember(self, seconds: float) -> None:
        """Keep so many seconds from now on, at least."""
        self.poses.remember(seconds)

    def state(self, now: float) -> str:
        """The time left in a file, or the frames that a camera dropped."""
        source = self._source
        if isinstance(source, LiveSource):
            return "no picture" if source.silent else f"{source.dropped} dropped"
        spent = time.monotonic() - self._begun
        left = spent * max(source.duration / max(now, 1e-3) - 1, 0)
        return f"{left:.0f} s left" if source.duration else ""

    def end(self, frames: int) -> str | None:
        """What a file lacks; a camera has no end.

        Raises:
            ClipError: not even two frames.
        """
        source = self._source
        if isinstance(source, LiveSource):
            return None
        if frames < 2:
            shown = "one frame" if frames else "no frame that can be decoded"
            raise ClipError(f"{source.path}: {shown}; an action needs a moving sequence.")
        return source.shortfall()

    def close(self) -> None:
        """Release a camera."""
        if isinstance(self._source, LiveSource):
            self._source.close()


def file_frames(video: VideoFile) -> Iterator[Frame]:
    """Frames of a video file at the rate that recognition needs; the same on every run."""
    return video.frames(rate=SAMPLING_RATE)
