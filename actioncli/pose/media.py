"""Read a clip from whatever shows a person: a file of joints or a video."""

from __future__ import annotations

import os
from pathlib import Path
from typing import TYPE_CHECKING, Any

from actioncli.errors import ClipError, UsageError
from actioncli.pose import VIDEO_SUFFIXES

if TYPE_CHECKING:
    from actioncli.clips.clip import Clip

# Options that only one of the two kinds of file understands.
_SKELETON_OPTIONS = frozenset({"layout", "fps", "unit", "up"})
_VIDEO_OPTIONS = frozenset({"start", "end", "quality", "person", "cache", "progress", "metrabs"})
_FOR_METRABS = frozenset({"start", "end", "person", "progress"})
# Among files of joints they would change what is read, and nothing heeds them.
_MISLEADING = frozenset({"start", "end", "person"})


def is_video(path: str | Path) -> bool:
    """Whether the file's name says that it is a video."""
    return Path(path).suffix.lower() in VIDEO_SUFFIXES


def read_any(path: str | Path, **options: Any) -> Clip:
    """Read a clip with `read_video_clip` or `read_clip`, whichever fits the file's name.

    Args:
        options: of either function; those that are None count as not given. What only says how
            to look at a video (`quality`, `cache`, `progress`) is left out for files of joints.
            With `metrabs`, a `PoseModel`, that model looks at videos.

    Raises:
        UsageError: an option that would change nothing, such as `fps` for a video.
        ClipError: see the two functions.
    """
    given = {name: value for name, value in options.items() if value is not None}
    video = is_video(path)
    for name in sorted(given.keys() & (_SKELETON_OPTIONS if video else _MISLEADING)):
        kind = "a video" if video else "a file of joints"
        raise UsageError(f"{path}: --{name} means nothing for {kind}.")
    if video:
        model = given.pop("metrabs", None)
        if model is not None:
            from actioncli.pose.metrabs import read_metrabs_clip

            wanted = {name: value for name, value in given.items() if name in _FOR_METRABS}
            return read_metrabs_clip(path, model, **wanted)
        from actioncli.pose.video import read_video_clip

        return read_video_clip(path, **given)
    from actioncli.clips.read import CLIP_SUFFIXES, read_clip

    file = Path(path)
    if file.suffix.lower() not in CLIP_SUFFIXES and os.path.lexists(file):
        wrong = "is a folder and holds none" if file.is_dir() else "has a name of neither kind"
        raise ClipError(
            f"{file}: {wrong}; clips end in {', '.join(CLIP_SUFFIXES)}, videos in "
            f"{', '.join(sorted(VIDEO_SUFFIXES))}."
        )
    wanted = {name: value for name, value in given.items() if name not in _VIDEO_OPTIONS}
    return read_clip(file, **wanted)
