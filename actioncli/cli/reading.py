"""Reading the clips that a command names, one after another or many videos at a time."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import closing
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, TypeVar

from actioncli.cli.output import note, printable, progress
from actioncli.cli.processes import cores, in_processes
from actioncli.errors import ClipError

if TYPE_CHECKING:
    from actioncli.clips.clip import Clip
    from actioncli.pose.metrabs import PoseModel
    from actioncli.pose.poses import Poses

T = TypeVar("T")
U = TypeVar("U")

# Videos that are read at the same time: one in 4K takes up to half a gigabyte.
_MOST_VIDEOS = 8


@dataclass(frozen=True, slots=True)
class Reading:
    """How to read files that leave something open, and videos; see `read_any`."""

    layout: str | None = None
    unit: str | None = None
    up: str | None = None
    fps: float | None = None
    start: float | None = None
    end: float | None = None
    quality: str | None = None
    person: int | None = None
    cache: bool = True
    metrabs: PoseModel | None = None
    shown: bool = False

    def read(self, path: Path, shown: bool = True) -> Clip:
        """Read one clip.

        Args:
            shown: whether a video may show how far it is read.

        Raises:
            ClipError: it cannot be read or is unsuitable.
        """
        from actioncli.cli.video import video_progress
        from actioncli.pose.media import is_video, read_any

        with video_progress(path, shown=shown and self.shown and is_video(path)) as progress:
            return read_any(
                path,
                layout=self.layout,
                fps=self.fps,
                unit=self.unit,
                up=self.up,
                start=self.start,
                end=self.end,
                quality=self.quality,
                person=self.person,
                cache=self.cache,
                metrabs=self.metrabs,
                progress=progress,
            )

    def poses(self, path: Path) -> Poses:
        """What `read` makes the clip of a video of, BlazePose having seen it.

        Raises:
            ClipError: it cannot be read.
        """
        from actioncli.cli.video import video_progress
        from actioncli.pose.video import DEFAULT_QUALITY, read_poses

        quality = self.quality or DEFAULT_QUALITY
        with video_progress(path, shown=self.shown) as progress:
            return read_poses(
                path, self.start, self.end, quality, self.person, self.cache, progress
            )


def named_clips(arguments: Sequence[Path]) -> list[Path]:
    """The files that clip arguments name, each once.

    What names no file stays as it is: reading it tells what is wrong with it.
    """
    from actioncli.clips.read import CLIP_SUFFIXES, find_clips
    from actioncli.pose import VIDEO_SUFFIXES

    return find_clips(arguments, (*CLIP_SUFFIXES, *VIDEO_SUFFIXES))


def sharing(paths: Sequence[Path], model: PoseModel | None = None) -> int:
    """In how many processes to read clips.

    A pose network gains little by a second core, so that videos are read one on each core where
    there are enough of them; a few take all cores one after another. A `model` of MeTRAbs has
    threads of its own, which are lost in another process.
    """
    from actioncli.pose.media import is_video

    videos = sum(map(is_video, paths))
    together = min(cores(), _MOST_VIDEOS)
    return together if videos >= together and model is None else 1


def read_each(
    paths: Sequence[Path],
    read: Callable[[Path, bool], Clip],
    what: str,
    *,
    shown: bool,
    processes: int = 1,
) -> Iterator[tuple[Path, Clip | ClipError]]:
    """Read clips in their order: each with what was read, or what is wrong with it.

    Args:
        read: reads a clip; the second argument says whether a video may show how far it is read.
        what: a word for the progress bar.
        shown: whether to show progress.
        processes: see `sharing`.
    """
    from actioncli.pose.media import is_video

    one_by_one = processes == 1

    def outcome(number: int) -> Clip | ClipError:
        return or_error(lambda path: read(path, shown and one_by_one), paths[number])

    # Read one by one, a video has a progress bar of its own.
    own = one_by_one and any(map(is_video, paths))
    outcomes = in_processes(outcome, len(paths), processes, pinned=True)
    with closing(outcomes):
        for path in progress(paths, what, shown=shown and not own):
            yield path, next(outcomes)


def or_error(work: Callable[[T], U], item: T) -> U | ClipError:
    """What `work` makes of an item, or what is wrong with its clip."""
    try:
        return work(item)
    except ClipError as unusable:
        return unusable


def report_bad_clip(error: ClipError) -> None:
    """Tell that a clip is left out; what was asked for goes on with the others."""
    note(f"error: {printable(str(error))}")
