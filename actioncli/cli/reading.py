"""Reading the clips that a command names, one after another or many videos at a time."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import closing
from pathlib import Path
from typing import TYPE_CHECKING

from actioncli.archives.processes import cores, in_processes
from actioncli.cli.output import disk_is_full, error_entry, note, printable, progress
from actioncli.cli.video import video_progress
from actioncli.errors import ClipError
from actioncli.pose import ReadOptions
from actioncli.pose.read import is_video, read_any

if TYPE_CHECKING:
    from actioncli.calibration.enrolment import Examined
    from actioncli.clips.clip import Clip
    from actioncli.recognition.recognizer import Recognizer

# Videos that are read at the same time: one in 4K takes up to half a gigabyte.
_MOST_VIDEOS = 8


def read_shown(path: Path, options: ReadOptions, shown: bool) -> Clip:
    """Read one clip; a video shows how far it is read, if `shown`.

    Raises:
        ClipError: it cannot be read or is unsuitable.
    """
    with video_progress(path, shown=shown and is_video(path)) as report:
        return read_any(path, options, report)


def sharing(paths: Sequence[Path], options: ReadOptions) -> int:
    """In how many processes to read clips.

    A pose network gains little by a second core, so that videos are read one on each core where
    there are enough of them; a few take all cores one after another. MeTRAbs has threads of its
    own, which are lost in another process.
    """
    together = min(cores(), _MOST_VIDEOS)
    return together if sum(map(is_video, paths)) >= together and options.metrabs is None else 1


def read_each(
    paths: Sequence[Path],
    options: ReadOptions,
    *,
    shown: bool,
    read: Callable[[Path, ReadOptions, bool], Clip] = read_shown,
) -> Iterator[tuple[Path, Clip | ClipError]]:
    """Read clips in their order: each with what was read, or what is wrong with it.

    Args:
        shown: whether to show progress.
        read: reads a clip as `read_shown` does.
    """
    processes = sharing(paths, options)

    def outcome(number: int) -> Clip | ClipError:
        try:
            return read(paths[number], options, shown and processes == 1)
        except ClipError as unusable:
            return unusable

    # Read one by one, a video has a progress bar of its own.
    own = processes == 1 and any(map(is_video, paths))
    outcomes = in_processes(outcome, len(paths), processes, pinned=True)
    with closing(outcomes):
        for path in progress(paths, "Reading", shown=shown and not own):
            yield path, next(outcomes)


def usable(
    clips: Iterable[tuple[Path | str, Clip | ClipError]],
    recognizer: Recognizer | None,
    *,
    negative: bool = True,
) -> Iterator[tuple[Path | str, Examined | dict[str, object]]]:
    """The clips that can be enrolled; each other one is reported, and comes as its entry in JSON.
    Unless they are `negative`, they must show what moves."""
    from actioncli.calibration.enrolment import examined

    for path, clip in clips:
        try:
            if isinstance(clip, ClipError):
                raise clip
            found = examined(recognizer, clip, negative)
        except ClipError as error:
            yield path, report_bad_clip(path, error)
        else:
            yield path, found


def report_bad_clip(path: Path | str, error: ClipError) -> dict[str, object]:
    """Report that a clip is left out, and go on with the others; its entry in JSON.

    Raises:
        ClipError: this one, where a disk is full: so it would be for the others.
    """
    if disk_is_full(error):
        raise error
    note(f"error: {printable(str(error))}")
    return {"source": str(path), "error": error_entry(error, error.exit_code)}
