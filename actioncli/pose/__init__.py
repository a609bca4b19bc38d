"""Frames from video or camera, and pose estimators."""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path

# What `actioncli.pose.read` takes for a video; decoding decides whether it is one.
VIDEO_SUFFIXES = frozenset(
    {".3gp", ".avi", ".gif", ".m4v", ".mkv", ".mov", ".mp4", ".mpeg", ".mpg", ".ogv", ".ts",
     ".webm", ".wmv"}
)  # fmt: skip
# Seconds for which a camera or a stream that breaks is opened again: a router, or a camera in the
# network, that starts anew takes a minute or two.
RETRY_SECONDS = 120.0


def without_password(address: object) -> str:
    """The name of a source, or an address, as it may be shown and kept."""
    return re.sub(r"(://)[^/@]*@", r"\1", str(address))


@dataclass(frozen=True, slots=True)
class ReadOptions:
    """What files leave open.

    Attributes:
        layout, fps, unit, up: of files of joints, see `read.read_clip`.
        start, end, quality, person, cache, hands: of videos, see there too.
        metrabs: folder of a MeTRAbs model that looks at videos instead of BlazePose.
    """

    layout: str | None = None
    fps: float | None = None
    unit: str | float | None = None
    up: str | None = None
    start: float | None = None
    end: float | None = None
    quality: str | None = None
    person: int | None = None
    cache: bool = True
    hands: bool | None = None
    metrabs: Path | None = None

    @property
    def whole(self) -> bool:
        """Whether the part of a video that is the action is named, and not looked for."""
        return self.start is not None or self.end is not None
