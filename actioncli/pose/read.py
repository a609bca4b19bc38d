"""Read a clip from whatever shows a person: a file of joints or a video."""

from __future__ import annotations

import os
import re
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import TYPE_CHECKING

from actioncli.errors import ClipError, UsageError
from actioncli.pose import VIDEO_SUFFIXES, ReadOptions, without_password

if TYPE_CHECKING:
    from actioncli.clips.clip import Clip
    from actioncli.pose.poses import Poses
    from actioncli.pose.video import Progress


def find_any(paths: Iterable[str | Path]) -> list[Path]:
    """The clips and videos that files, folders and patterns name, see `find_clips`.

    What names no file stays as it is: reading it tells what is wrong with it.
    """
    from actioncli.clips.read import CLIP_SUFFIXES, find_clips

    return find_clips(paths, (*CLIP_SUFFIXES, *VIDEO_SUFFIXES))


def is_video(path: str | Path) -> bool:
    """Whether the file's name says that it is a video."""
    return Path(path).suffix.lower() in VIDEO_SUFFIXES


def read_clip(
    path: str | Path,
    layout: str | None = None,
    fps: float | None = None,
    unit: str | float | None = None,
    up: str | None = None,
    *,
    start: float | None = None,
    end: float | None = None,
    quality: str | None = None,
    person: int | None = None,
    cache: bool = True,
    hands: bool | None = None,
    progress: Callable[[Progress], None] | None = None,
) -> Clip:
    """Read one person's clip from a file of joints or a video, whichever its name says.

    Args:
        path: the file.
        layout, fps, unit, up: of files of joints: names the joints in column order, frames a
            second, unit of length (m, cm, mm, in, or metres per unit), axis that points up. They
            win over what the file states.
        start, end: of videos, seconds between which the action is; found from the motion where
            they are not given.
        quality: pose network for videos, "fast" or "accurate".
        person: whom to follow in a video, 1 is the leftmost; whoever moves most where None.
        cache: keep poses of videos for the next time.
        hands: look for hands in videos; None: where legs are out of view.
        progress: called now and then while a video is read.

    Raises:
        ClipError: the file cannot be read or does not hold a clip.
        AmbiguousClipError: an option must say what the file does not.
        UsageError: an option has an impossible value, or means nothing for this kind of file.
        WeightsError: a pose network is missing or damaged.
    """
    options = ReadOptions(layout, fps, unit, up, start, end, quality, person, cache, hands)
    return read_any(path, options, progress)


# For videos alone there was another function.
read_video_clip = read_clip


def read_any(
    path: str | Path,
    options: ReadOptions | None = None,
    progress: Callable[[Progress], None] | None = None,
) -> Clip:
    """Read a clip from a file of joints or a video, whichever its name says.

    Args:
        options: what only says how to look at a video (`quality`, `cache`, `hands`, `metrabs`)
            means nothing for files of joints.
        progress: called now and then while a video is read.

    Raises:
        UsageError: an option that would change nothing, such as `fps` for a video.
        ClipError: see `read_clip`.
    """
    return read_with_poses(path, options, progress)[0]


def read_with_poses(
    path: str | Path,
    options: ReadOptions | None = None,
    progress: Callable[[Progress], None] | None = None,
) -> tuple[Clip, Poses | None]:
    """As `read_any`; and of a video the poses that were seen, of which the clip may be a part."""
    from actioncli.clips.checks import noted
    from actioncli.clips.read import CLIP_SUFFIXES, CONVERTERS
    from actioncli.clips.read import read_clip as read_joints

    options = options or ReadOptions()
    file = Path(path)
    _refuse_address(file)
    video = is_video(file)
    for name in ("fps", "layout", "unit", "up") if video else ("end", "person", "start"):
        if getattr(options, name) is not None:
            kind = "a video" if video else "a file of joints"
            raise UsageError(f"{path}: --{name} means nothing for {kind}.")
    if video:
        clip, poses = read_person(file, options, progress)
        return noted(clip), poses
    converted = file.suffix.lower() in CONVERTERS
    if file.suffix.lower() not in CLIP_SUFFIXES and not converted and os.path.lexists(file):
        wrong = "is a folder and holds none" if file.is_dir() else "has a name of neither kind"
        raise ClipError(
            f"{file}: {wrong}; clips end in {', '.join(CLIP_SUFFIXES)}, videos in "
            f"{', '.join(sorted(VIDEO_SUFFIXES))}."
        )
    return noted(read_joints(file, options.layout, options.fps, options.unit, options.up)), None


def read_person(
    path: Path, options: ReadOptions, progress: Callable[[Progress], None] | None = None
) -> tuple[Clip, Poses]:
    """Read a person's clip from a video, whatever its name, and the poses that were seen.

    Raises:
        ClipError, UsageError, WeightsError: see `read_clip`.
    """
    from actioncli.pose.video import clip_of, read_poses

    _refuse_address(path)
    poses = read_poses(path, options, progress)
    return clip_of(poses, path, options.whole), poses


def _refuse_address(path: Path) -> None:
    """Say what to do with one instead.

    Raises:
        ClipError: it is one.
    """
    # A path has lost one of the slashes.
    if address := re.match(r"([a-z]{3,5}):/+", str(path)):
        whole = without_password(f"{address[1]}://{str(path)[address.end() :]}")
        raise ClipError(
            f"{whole}: is an address, and clips are read from files: download it first, or watch "
            f"it: actioncli watch {whole}"
        )
