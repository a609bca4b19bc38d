"""`watch`: one event per action performed before a camera, or in a video."""

from __future__ import annotations

import contextlib
import os
import shlex
import shutil
import subprocess
import sys
import time
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from actioncli.cli.command import Settings, command
from actioncli.cli.common import load_support
from actioncli.cli.options import QualityOption, TauOption, WeightsOption, checked_quality
from actioncli.cli.output import note, printable, say
from actioncli.errors import ClipError, UsageError
from actioncli.files import json_text

if TYPE_CHECKING:
    from actioncli.live.events import Event, Spotter
    from actioncli.live.recorder import Recorder
    from actioncli.live.stream import PoseStream
    from actioncli.pose.camera import LiveSource
    from actioncli.pose.frames import Frame, VideoFile

# Commands of --exec that may run at once; what comes meanwhile is told and left out.
_MOST_RUNNING = 8
_LAST_SECONDS = 5.0


@command
def watch(
    settings: Settings,
    source: Annotated[str, typer.Argument(metavar="CAMERA|VIDEO|URL", help="What to watch.")] = "0",
    tau: TauOption = None,
    execute: Annotated[
        str | None,
        typer.Option(
            "--exec",
            metavar="CMD",
            help="Run at every event, without a shell, with ACTIONCLI_LABEL, "
            "ACTIONCLI_CONFIDENCE, ACTIONCLI_START and ACTIONCLI_END in its environment.",
        ),
    ] = None,
    record: Annotated[
        Path | None,
        typer.Option(
            metavar="FOLDER",
            help="Keep the skeletons of events and near misses there, for `actioncli review`.",
            show_default=False,
        ),
    ] = None,
    quality: QualityOption = None,
    weights: WeightsOption = None,
) -> None:
    """Tell every enrolled action that somebody performs.

    Windows of several lengths slide over the poses of one person; one performance is one event,
    told when it is over. A camera's frames that come too late are dropped. A video gives the same
    events every time. Ctrl-C ends watching. With --json, every event is a document on a line of
    its own.

    \b
    Examples:
      actioncli watch
      actioncli watch training.mp4 --json
      actioncli watch 0 --exec 'notify-send moved'
      actioncli watch 0 --record seen

    \b
    JSON keys:
      label, start, end, confidence
    """
    from actioncli.live.events import Spotter
    from actioncli.live.recorder import Recorder
    from actioncli.recognition.recognizer import Recognizer

    run = _Runner(execute) if execute is not None else None
    network = checked_quality(quality)
    recognizer = Recognizer(weights)
    with settings.open_store() as store:
        support = load_support(settings, store, recognizer, tau)
    spotter = Spotter(support)
    recorder = Recorder(record, support.threshold, source) if record is not None else None
    try:
        for event in _events(settings, source, spotter, network, recorder):
            _tell(settings, event)
            if run is not None:
                run(event)
    finally:
        if run is not None:
            run.wait()


def _events(
    settings: Settings, source: str, spotter: Spotter, quality: str, recorder: Recorder | None
) -> Iterator[Event]:
    """Look at the stream every `STRIDE` seconds; what its end or Ctrl-C cuts off is told as well.

    Raises:
        ClipError: the stream is lost; after the last event.
    """
    from actioncli.live.events import STRIDE
    from actioncli.live.stream import PoseStream

    poses = PoseStream(quality, seconds=max(spotter.windows) + 1)
    looked = -STRIDE
    count = seen = 0
    lost: ClipError | None = None
    with _frames(source) as (frames, origin), _view(settings) as view:
        try:
            for frame in frames:
                poses.add(frame)
                count += 1
                seen += poses.body is not None
                if frame.time - looked >= STRIDE:
                    looked = frame.time
                    clip = poses.clip()
                    over = spotter.look(clip, frame.time)
                    yield from over
                    if recorder is not None:
                        busy = spotter.current is not None
                        recorder.look(clip, frame.time, spotter.ranking, over, busy)
                view.show(frame, poses, spotter, origin)
            _tell_end(settings, source, origin, count, seen)
            if count and frame.time < min(spotter.windows):
                settings.tell(
                    f"note: {printable(source)}: {frame.time:.1f} s are less than the "
                    f"{min(spotter.windows):.1f} s that the quickest performance would take"
                )
        except KeyboardInterrupt:
            pass
        except ClipError as error:
            lost = error
        over = spotter.finish()
        yield from over
        if recorder is not None:
            recorder.finish(over)
    if lost is not None:
        raise lost


def _tell_end(
    settings: Settings, source: str, origin: VideoFile | LiveSource, count: int, seen: int
) -> None:
    """What is to be told at the end: `count` frames came, and `seen` of them showed somebody.

    Raises:
        ClipError: there was nothing to watch.
    """
    from actioncli.pose.frames import VideoFile

    if isinstance(origin, VideoFile):
        if count < 2:
            frames = "one frame" if count else "no frame that can be decoded"
            raise ClipError(f"{source}: {frames}; an action needs a moving sequence.")
        shortfall = origin.shortfall()
        if shortfall is not None:
            settings.tell(f"note: {printable(source)}: {shortfall}")
    else:
        settings.tell(f"note: {printable(source)}: the stream has ended")
    if not seen:
        settings.tell(f"note: {printable(source)}: nobody was seen in any of {count} frames")


@contextlib.contextmanager
def _frames(source: str) -> Iterator[tuple[Iterator[Frame], VideoFile | LiveSource]]:
    """Frames of a file, or of a live source that is closed at the end."""
    from actioncli.live.stream import file_frames
    from actioncli.pose.camera import LiveSource
    from actioncli.pose.frames import VideoFile

    if not (source.isdecimal() or "://" in source):
        video = VideoFile(Path(source))
        yield file_frames(video), video
        return
    live = LiveSource(int(source) if source.isdecimal() else source)
    try:
        yield live.frames(), live
    finally:
        live.close()


def _tell(settings: Settings, event: Event) -> None:
    if settings.json:
        say(json_text(event.to_json(), indent=None))
    else:
        say(
            f"{event.start:8.1f} s  to {event.end:8.1f} s  {printable(event.label)}  "
            f"(confidence {event.confidence:.2f})"
        )


@dataclass
class _Runner:
    """Runs the user's command for events, and never a shell."""

    line: str
    words: list[str] = field(init=False)
    running: list[subprocess.Popen[bytes]] = field(default_factory=list)

    def __post_init__(self) -> None:
        try:
            self.words = shlex.split(self.line)
        except ValueError as error:
            raise UsageError(f"--exec {self.line!r} is no command: {error}.") from error
        if not self.words or shutil.which(self.words[0]) is None:
            raise UsageError(f"--exec {self.line!r}: there is no such program.")

    def __call__(self, event: Event) -> None:
        self.running = [process for process in self.running if process.poll() is None]
        if len(self.running) >= _MOST_RUNNING:
            note(f"note: {_MOST_RUNNING} commands still run; not run again.")
            return
        told = {
            "ACTIONCLI_LABEL": event.label,
            "ACTIONCLI_CONFIDENCE": f"{event.confidence:.3f}",
            "ACTIONCLI_START": f"{event.start:.3f}",
            "ACTIONCLI_END": f"{event.end:.3f}",
        }
        # Its output goes to standard error: standard output belongs to the events.
        environment = {**os.environ, **told}
        try:
            running = subprocess.Popen(
                self.words, env=environment, stdin=subprocess.DEVNULL, stdout=2
            )
        except OSError as error:  # such as a script whose first line names no program
            note(f"error: --exec {printable(self.line)}: cannot be run: {error.strerror}.")
        else:
            self.running.append(running)

    def wait(self) -> None:
        """Give commands that still run a little time; they are not ended."""
        deadline = time.monotonic() + _LAST_SECONDS
        for process in self.running:
            with contextlib.suppress(subprocess.TimeoutExpired):
                process.wait(max(deadline - time.monotonic(), 0))


class _Nothing:
    def show(self, *_: Any) -> None:
        """Nobody looks."""


class _Screen:
    """Frame rate, time left, whether the body is in view, and the ranking, on standard error."""

    def __init__(self, live: Any) -> None:
        self._live = live
        self._start = time.monotonic()
        self._times: list[float] = []

    def show(
        self, frame: Frame, poses: PoseStream, spotter: Spotter, origin: VideoFile | LiveSource
    ) -> None:
        """Draw; rich limits how often that reaches the terminal."""
        from rich.text import Text

        from actioncli.pose.frames import VideoFile

        now = time.monotonic()
        self._times = [*self._times[-30:], now]
        rate = (len(self._times) - 1) / max(now - self._times[0], 1e-3)
        if isinstance(origin, VideoFile):
            left = (now - self._start) * max(origin.duration / max(frame.time, 1e-3) - 1, 0)
            told = f"{left:.0f} s left" if origin.duration else ""
        else:
            told = f"{origin.dropped} dropped"
        who = "following" if poses.body is not None else "nobody in view"
        lines = [f"{frame.time:7.1f} s   {rate:4.1f} frames/s   {told}   {who}"]
        lines += [
            f"  {printable(seen.label):<24} {seen.confidence:4.2f} "
            f"{'#' * round(20 * seen.confidence)}"
            for seen in spotter.ranking[:5]
        ]
        if spotter.current is not None:
            lines.append(f"  now: {printable(spotter.current.label)}")
        self._live.update(Text("\n".join(lines)))


@contextlib.contextmanager
def _view(settings: Settings) -> Iterator[_Screen | _Nothing]:
    if settings.quiet or not sys.stderr.isatty():
        yield _Nothing()
        return
    from rich.console import Console
    from rich.live import Live

    with Live(
        console=Console(stderr=True), refresh_per_second=8, transient=True, redirect_stdout=False
    ) as live:
        yield _Screen(live)
