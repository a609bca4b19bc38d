"""`watch`: one event per action performed before a camera, or in a video."""

from __future__ import annotations

import contextlib
import os
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from actioncli.cli.command import Settings, command
from actioncli.cli.common import load_support
from actioncli.cli.options import QualityOption, TauOption, WeightsOption
from actioncli.cli.output import note, printable, say
from actioncli.files import json_text

if TYPE_CHECKING:
    from rich.live import Live

    from actioncli.live.events import Event, EventDetector
    from actioncli.live.watching import Stream


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
      label, start, end, confidence, weights
    """
    from actioncli.live.commands import CommandRunner
    from actioncli.live.recorder import Recorder
    from actioncli.live.watching import DEFAULT_QUALITY
    from actioncli.live.watching import watch as events_of
    from actioncli.recognition.recognizer import Recognizer

    run = CommandRunner(execute, _note) if execute is not None else None
    recognizer = Recognizer(weights)
    with settings.open_store() as store:
        support = load_support(settings, store, recognizer, tau)
    recorder = Recorder(record, support.threshold, source) if record is not None else None
    try:
        with _view(settings) as view:
            for event in events_of(
                source,
                support,
                quality=quality or DEFAULT_QUALITY,
                recorder=recorder,
                on_frame=view.show,
                note=lambda line: settings.tell(f"note: {printable(source)}: {line}"),
            ):
                view.say(_line(settings, event, recognizer.weights.checksum))
                if run is not None:
                    run(event)
    finally:
        if run is not None:
            run.wait()


def _note(line: str) -> None:
    note(printable(line))


def _line(settings: Settings, event: Event, weights: str) -> str:
    if settings.json:
        return json_text({**event.to_json(), "weights": weights}, indent=None)
    return (
        f"{event.start:8.1f} s  to {event.end:8.1f} s  {printable(event.label)}  "
        f"(confidence {event.confidence:.2f})"
    )


class _Nothing:
    """Where nobody looks, or standard error is a file."""

    def show(self, *_: Any) -> None:
        """Nothing."""

    def say(self, line: str) -> None:
        """An event, to standard output."""
        say(line)


class _Screen(_Nothing):
    """Frame rate, time left, whether the body is in view, and the ranking, on standard error."""

    def __init__(self, live: Live) -> None:
        self._live = live
        self._times: list[float] = []

    def show(self, now: float, stream: Stream, detector: EventDetector) -> None:
        """Draw; rich limits how often that reaches the terminal."""
        from rich.text import Text

        self._times = [*self._times[-30:], time.monotonic()]
        rate = (len(self._times) - 1) / max(self._times[-1] - self._times[0], 1e-3)
        who = "following" if stream.seen else "nobody in view"
        lines = [f"{now:7.1f} s   {rate:4.1f} frames/s   {stream.state(now)}   {who}"]
        lines += [
            f"  {printable(seen.label):<24} {seen.confidence:4.2f} "
            f"{'#' * round(20 * seen.confidence)}"
            for seen in detector.ranking[:5]
        ]
        if detector.current is not None:
            lines.append(f"  now: {printable(detector.current.label)}")
        self._live.update(Text("\n".join(lines)))

    def say(self, line: str) -> None:
        """An event. On a terminal that shows both streams, what goes past the view is drawn over by
        it: the view itself puts the line above."""
        if sys.stdout.isatty() and os.ttyname(1) == os.ttyname(2):
            self._live.console.print(
                line, markup=False, emoji=False, highlight=False, soft_wrap=True
            )
        else:
            say(line)


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
