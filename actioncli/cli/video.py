"""What the commands that read videos share: progress with frame rate and time left, drawing."""

from __future__ import annotations

import contextlib
import time
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from actioncli.cli.output import steps
from actioncli.errors import UsageError

if TYPE_CHECKING:
    from actioncli.pose.poses import Poses
    from actioncli.pose.video import Progress
    from actioncli.recognition.decision import Decision


@contextlib.contextmanager
def video_progress(path: Path, *, shown: bool) -> Iterator[Callable[[Progress], None] | None]:
    """Show how far a video has been read, on standard error, if someone is there to see it."""
    begun = time.monotonic()
    with steps(shown=shown) as step:

        def show(progress: Progress) -> None:
            assert step is not None
            rate = progress.frames / max(time.monotonic() - begun, 1e-3)
            step(f"{path.name}  {rate:.0f} frames/s", progress.seconds, progress.total or None)

        yield None if step is None else show


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
