"""What the commands that read videos share: options, and progress with frame rate and time left."""

from __future__ import annotations

import contextlib
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from actioncli.errors import UsageError

if TYPE_CHECKING:
    from actioncli.cli.reading import Reading
    from actioncli.pose.metrabs import PoseModel
    from actioncli.pose.video import Progress
    from actioncli.recognizer import Decision

StartOption = Annotated[
    float | None,
    typer.Option(
        "--start",
        metavar="SECONDS",
        help="Where the action begins in a video.  [default: found from the motion]",
        show_default=False,
    ),
]
EndOption = Annotated[
    float | None,
    typer.Option(
        "--end",
        metavar="SECONDS",
        help="Where it ends.  [default: found from the motion]",
        show_default=False,
    ),
]
QualityOption = Annotated[
    str | None,
    typer.Option(
        "--quality",
        metavar="fast|accurate",
        help="Pose network for videos.  [default: fast]",
        show_default=False,
    ),
]
PersonOption = Annotated[
    int | None,
    typer.Option(
        "--person",
        metavar="N",
        help="Whom to follow in a video, 1 is the leftmost.  [default: who moves most]",
        show_default=False,
    ),
]
CacheOption = Annotated[
    bool, typer.Option("--cache/--no-cache", help="Keep poses of videos for the next time.")
]

PoseOption = Annotated[
    str,
    typer.Option("--pose", metavar="blazepose|metrabs", help="Pose estimator for videos."),
]
PoseModelOption = Annotated[
    Path | None,
    typer.Option(
        "--pose-model",
        metavar="FOLDER",
        help="MeTRAbs model that you have downloaded; its weights are for non-commercial use.",
    ),
]

# Reading that is over sooner needs no progress line.
_PATIENCE_SECONDS = 1.0


def checked_quality(quality: str | None) -> str:
    """The quality to use.

    Raises:
        UsageError: there is no such one.
    """
    from actioncli.pose.networks import LANDMARKS
    from actioncli.pose.video import DEFAULT_QUALITY

    if quality is not None and quality not in LANDMARKS:
        raise UsageError(f"--quality is {' or '.join(LANDMARKS)}, not {quality!r}.")
    return quality or DEFAULT_QUALITY


def chosen_pose_model(pose: str, path: Path | None) -> PoseModel | None:
    """The MeTRAbs model to use; None for BlazePose.

    Raises:
        UsageError: the two options do not fit.
        WeightsError: the model cannot be loaded.
    """
    if pose not in ("blazepose", "metrabs"):
        raise UsageError(f"--pose is blazepose or metrabs, not {pose!r}.")
    if (pose == "metrabs") != (path is not None):
        raise UsageError(
            "--pose metrabs and --pose-model FOLDER belong together: the model is not part of "
            "actioncli."
        )
    if path is None:
        return None
    from actioncli.pose.metrabs import load_model

    return load_model(path)


@contextlib.contextmanager
def video_progress(path: Path, *, shown: bool) -> Iterator[Callable[[Progress], None] | None]:
    """Show how far a video has been read, on standard error, if someone is there to see it."""
    if not (shown and sys.stderr.isatty()):
        yield None
        return
    from rich.console import Console
    from rich.progress import BarColumn, TextColumn, TimeRemainingColumn
    from rich.progress import Progress as Bar

    bar = Bar(
        TextColumn("{task.description}", markup=False),
        BarColumn(),
        TextColumn("{task.fields[rate]:.0f} frames/s"),
        TimeRemainingColumn(),
        console=Console(stderr=True),
        transient=True,
        redirect_stdout=False,
    )
    start = time.monotonic()
    task = bar.add_task(path.name, total=None, rate=0.0)

    def show(progress: Progress) -> None:
        passed = time.monotonic() - start
        if passed > _PATIENCE_SECONDS:
            bar.start()
        bar.update(
            task,
            completed=progress.seconds,
            total=progress.total or None,
            rate=progress.frames / max(passed, 1e-3),
        )

    try:
        yield show
    finally:
        bar.stop()


def check_annotation(clips: Sequence[Path], output: Path, metrabs: bool) -> None:
    """Refuse, before anything is read, what --annotate cannot do.

    Raises:
        UsageError: not one video, or a file that is no new MP4.
    """
    from actioncli.media import is_video

    if len(clips) != 1 or not is_video(clips[0]):
        raise UsageError("--annotate draws on one video: name one, and no other clip.")
    if metrabs:
        raise UsageError("--annotate draws what BlazePose sees; leave out --pose metrabs.")
    if output.suffix.lower() != ".mp4":
        raise UsageError(f"--annotate writes MP4: let {output} end in .mp4.")
    if output.resolve() == clips[0].resolve():
        raise UsageError(f"{output}: is the video itself; it is not written over.")
    check_place(output)


def check_place(output: Path) -> None:
    """Refuse, before a video is read, to write where no file can be.

    Raises:
        UsageError: there is no such folder, or a folder has this name.
    """
    if output.is_dir():
        raise UsageError(f"{output}: is a folder; name a file in it.")
    if not output.parent.is_dir():
        raise UsageError(f"{output}: there is no folder {output.parent}.")


def write_annotation(reading: Reading, video: Path, output: Path, decision: Decision) -> None:
    """Draw skeleton, label, confidence and tau on a video that was just classified.

    Raises:
        ClipError: the file cannot be written.
    """
    from actioncli.pose.annotate import annotate_video
    from actioncli.pose.video import read_poses

    sign = ">" if decision.confidence > decision.tau else "<="
    verdict = (
        f"rejected (nearest: {decision.nearest})" if decision.label is None else decision.label
    )
    lines = [verdict, f"confidence {decision.confidence:.2f} {sign} tau {decision.tau:.2f}"]
    quality = checked_quality(reading.quality)
    asked = (reading.start, reading.end, quality, reading.person, reading.cache)
    with video_progress(video, shown=reading.shown) as progress:
        poses = read_poses(video, *asked, progress)
    with video_progress(output, shown=reading.shown) as progress:
        annotate_video(video, output, poses, lines, progress)
