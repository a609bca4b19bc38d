"""`extract`: write the skeletons of videos to files."""

from __future__ import annotations

import os
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from actioncli.cli.answer import notes_of, short_names
from actioncli.cli.command import Settings, command
from actioncli.cli.common import check_output
from actioncli.cli.options import ForceOption, VideoReading, file_named
from actioncli.cli.output import plural, printable, say, write_json
from actioncli.cli.reading import read_each, report_bad_clip
from actioncli.cli.video import video_progress
from actioncli.errors import ClipError, UsageError

if TYPE_CHECKING:
    from actioncli.clips.clip import Clip


@command
def extract(
    settings: Settings,
    videos: Annotated[
        list[Path],
        typer.Argument(
            metavar="VIDEO...", help="Videos, folders of them, or patterns.", parser=file_named
        ),
    ],
    *,
    output: Annotated[
        Path,
        typer.Option(
            "--output", "-o", metavar="FILE", help="File to write; for several videos, a folder."
        ),
    ],
    format: Annotated[
        str | None,
        typer.Option(
            metavar="npz|json|trc|csv",
            help="[default: what the name of the file says, else npz]",
            show_default=False,
        ),
    ] = None,
    force: ForceOption = False,
    options: VideoReading,
) -> None:
    """Write the skeleton in a video to a file.

    What is written, enroll and classify read. The part in which the person moves is taken;
    --start 0 takes the whole video. Where two videos of one name come from several folders, their
    files stand in such folders too. A video that cannot be used is reported and left out, and
    the exit code is 3.

    \b
    Examples:
      actioncli extract wave.mp4 -o wave.npz
      actioncli extract recordings/ -o skeletons/ --format json
      actioncli extract squat.mp4 -o squat.trc --start 1.5 --end 4

    \b
    JSON keys:
      clips, written, failed
      clips[]: source, file, frames, fps, seconds, notes, error
      clips[].error: type, message, exit_code
    """
    from actioncli.clips.read import find_clips
    from actioncli.clips.write import write_clip
    from actioncli.pose import VIDEO_SUFFIXES, ReadOptions
    from actioncli.pose.read import read_person

    paths = find_clips(videos, tuple(VIDEO_SUFFIXES))
    targets = _targets(paths, output, format, force)

    def read(path: Path, options: ReadOptions, shown: bool) -> Clip:
        with video_progress(path, shown=shown) as progress:
            return read_person(path, options, progress)[0]

    entries: list[dict[str, object]] = []
    failed = 0
    clips = read_each(paths, options, shown=not settings.quiet, read=read)
    with notes_of(settings, short_names(paths)) as add_notes:
        for (path, clip), target in zip(clips, targets, strict=True):
            try:
                if isinstance(clip, ClipError):
                    raise clip
                target.parent.mkdir(parents=True, exist_ok=True)
                write_clip(target, clip, format or (None if target == output else "npz"))
            except ClipError as error:
                failed += 1
                entries.append(report_bad_clip(path, error))
                continue
            entries.append(
                {
                    "source": str(path),
                    "file": str(target),
                    "frames": len(clip),
                    "fps": clip.fps,
                    "seconds": clip.duration,
                    "notes": list(clip.notes),
                }
            )
            if not settings.json:
                add_notes(path, clip.notes)
                if not settings.quiet:
                    say(
                        f"{printable(target)}: {plural(len(clip), 'frame')}, "
                        f"{clip.duration:.1f} s, of {printable(path)}"
                    )
    if settings.json:
        write_json({"clips": entries, "written": len(entries) - failed, "failed": failed})
    if failed:
        raise typer.Exit(ClipError.exit_code)


def _targets(paths: list[Path], output: Path, format: str | None, force: bool) -> list[Path]:
    """The file to write for each video.

    Raises:
        UsageError: the format is unknown, there is no such folder, or a file stands there.
    """
    from actioncli.clips.write import WRITERS

    if format is not None and format not in WRITERS:
        raise UsageError(f"--format is one of {', '.join(WRITERS)}, not {format!r}.")
    if len(paths) == 1 and not output.is_dir():
        if format is None and output.suffix.lower().removeprefix(".") not in WRITERS:
            raise UsageError(
                f"{output}: its name does not say how to write it; end it in "
                f"{', '.join('.' + kind for kind in WRITERS)}, or give --format."
            )
        check_output(output, paths, force)
        return [output]
    try:
        output.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise UsageError(
            f"{output}: several videos are written to a folder, and this is none: {error.strerror}."
        ) from error
    above = os.path.commonpath([path.absolute().parent for path in paths])
    below = [output / path.absolute().relative_to(above) for path in paths]
    # By the plainest names that are different, also on drives that ignore case.
    named: list[Path] = []
    for named in (
        [output / path.stem for path in paths],
        [path.with_suffix("") for path in below],
        below,
    ):
        if len({str(name).casefold() for name in named}) == len(paths):
            break
    targets = [name.with_name(f"{name.name}.{format or 'npz'}") for name in named]
    for target in targets:
        if target.parent.is_dir():
            check_output(target, paths, force)
    return targets
