"""What the commands that read videos share: progress with frame rate and time left, drawing."""

from __future__ import annotations

import contextlib
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from actioncli.errors import UsageError

if TYPE_CHECKING:
    from actioncli.pose.poses import Poses
    from actioncli.pose.video import Progress
    from actioncli.recognition.decision import Decision

# Reading that is over sooner needs no progress line.
_PATIENCE_SECONDS = 1.0


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
    from actioncli.pose.read import is_video

    if len(clips) != 1 or not is_video(clips[0]):
        raise UsageError("--annotate draws on one video: name one, and no other clip.")
    if metrabs:
        raise UsageError("--annotate draws what BlazePose sees; leave out --pose metrabs.")
    if output.suffix.lower() != ".mp4":
        raise UsageError(f"--annotate writes MP4: let {output} end in .mp4.")


def write_annotation(
    video: Path, output: Path, poses: Poses, decision: Decision, *, shown: bool
) -> None:
    """Draw skeleton, label, confidence and tau on a video that was just classified.

    Args:
        shown: whether to show progress.

    Raises:
        ClipError: the file cannot be written.
    """
    from actioncli.pose.annotate import annotate_video

    label = decision.label
    verdict = f"✓ {label}" if label else f"✗ rejected (nearest: {decision.nearest})"
    nearer = decision.negative_is_nearer
    lines = [verdict, "a negative is nearer" if nearer else decision.comparison]
    with video_progress(output, shown=shown) as progress:
        annotate_video(video, output, poses, lambda _: lines, progress)
