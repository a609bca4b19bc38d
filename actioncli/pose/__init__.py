"""Frames from video or camera, and pose estimators."""

# What `actioncli.pose.read` takes for a video; decoding decides whether it is one.
VIDEO_SUFFIXES = frozenset(
    {".3gp", ".avi", ".gif", ".m4v", ".mkv", ".mov", ".mp4", ".mpeg", ".mpg", ".ogv", ".ts",
     ".webm", ".wmv"}
)  # fmt: skip
