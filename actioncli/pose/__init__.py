"""Frames from video or camera, and pose estimators."""

import re

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
