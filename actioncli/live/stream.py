"""Poses of one person as they come: from a camera, an address or a file."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from actioncli.clips.clip import Clip
from actioncli.errors import ClipError
from actioncli.pose.detector import PersonDetector
from actioncli.pose.frames import Frame, VideoFile
from actioncli.pose.landmarks import LANDMARK_COUNT, Body, LandmarkEstimator
from actioncli.pose.poses import LONGEST_GAP, Poses
from actioncli.pose.tracker import Tracker
from actioncli.pose.video import SAMPLING_RATE


class PoseStream:
    """Follows one person and remembers the last seconds.

    Attributes:
        size: width and height of the last frame.
        body: what was seen in the last frame; None if nobody.
    """

    def __init__(self, quality: str, seconds: float) -> None:
        """Load the networks.

        Args:
            quality: "fast" or "accurate".
            seconds: how much to remember.
        """
        self._tracker = Tracker(PersonDetector(), LandmarkEstimator(quality), most=1)
        self._seconds = seconds
        self._frames: list[float] = []
        self.size = (0, 0)
        self.body: Body | None = None

    def add(self, frame: Frame) -> None:
        """Take in a frame."""
        self.size = frame.image.shape[1], frame.image.shape[0]
        seen = self._tracker(frame.image, frame.time)
        self.body = seen[0].bodies[-1] if seen else None
        self._frames.append(frame.time)
        oldest = frame.time - self._seconds
        while self._frames[0] < oldest:
            del self._frames[0]
        for track in self._tracker.tracks:
            while track.times and track.times[0] < oldest:
                del track.times[0], track.bodies[0]

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
        bodies = track.bodies[first:]
        looked = np.array(self._frames)
        poses = Poses(
            times=times[first:],
            world=np.stack([body.world for body in bodies]),
            visibility=np.stack([body.visibility for body in bodies]),
            points=np.stack([body.points[:LANDMARK_COUNT] for body in bodies]),
            frames=looked[looked >= times[first]],
            size=self.size,
        )
        try:
            return poses.to_clip("stream")
        except ClipError:  # the picture has not moved at all
            return None


def file_frames(video: VideoFile) -> Iterator[Frame]:
    """Frames of a video file at the rate that recognition needs; the same on every run."""
    return video.frames(rate=SAMPLING_RATE)
