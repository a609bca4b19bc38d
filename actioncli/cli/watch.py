"""`watch`: one event per action performed before a camera, or in a video."""

from __future__ import annotations

import contextlib
import math
import os
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from actioncli.cli.answer import event_line
from actioncli.cli.command import Settings, command
from actioncli.cli.common import check_output, load_support
from actioncli.cli.options import (
    ForceOption,
    HandsOption,
    QualityOption,
    TauOption,
    WeightsOption,
)
from actioncli.cli.output import OutputError, note, printable, say
from actioncli.cli.video import check_annotation, video_progress
from actioncli.errors import ActionCliError, UsageError
from actioncli.files import json_text, user_settings
from actioncli.pose import RETRY_SECONDS, without_password
from actioncli.pose.read import is_video

if TYPE_CHECKING:
    from rich.live import Live

    from actioncli.live.events import EventDetector
    from actioncli.live.reactions import Reaction
    from actioncli.live.watching import Stream
    from actioncli.recognition.followed import FollowedSupport
    from actioncli.recognition.support import SupportSet


@command
def watch(
    settings: Settings,
    source: Annotated[
        str,
        typer.Argument(
            metavar="SOURCE",
            help="A camera's number or device (/dev/video0), a video, or the address of a stream "
            "or a video.",
        ),
    ] = "0",
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
    mqtt: Annotated[
        str | None,
        typer.Option(
            metavar="URL",
            envvar="ACTIONCLI_MQTT",
            help="Publish events to a broker, mqtt://[user:password@]host[:port]/topic, and "
            "describe each action to Home Assistant as a sensor. Needs the extra mqtt.",
        ),
    ] = None,
    webhook: Annotated[
        str | None,
        typer.Option(
            metavar="URL", envvar="ACTIONCLI_WEBHOOK", help="Post every event there, as JSON."
        ),
    ] = None,
    beep: Annotated[
        bool, typer.Option("--beep", help="Ring the terminal's bell at every event.")
    ] = False,
    each: Annotated[
        bool,
        typer.Option(
            "--each/--sets",
            help="Tell each repetition of an action when it ends, or a set of them, counted, once "
            "nothing follows.",
        ),
    ] = True,
    facing: Annotated[
        bool,
        typer.Option(
            "--facing",
            help="Only what is done while facing the camera counts: shoulders and hips turned "
            "from it by at most 45 degrees.",
        ),
    ] = False,
    table: Annotated[
        Path | None,
        typer.Option("--csv", metavar="FILE.csv", help="Write every event into a table, too."),
    ] = None,
    subtitles: Annotated[
        Path | None,
        typer.Option("--srt", metavar="FILE.srt", help="Write every event as a subtitle, too."),
    ] = None,
    annotate: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE.mp4", help="Of a video, write it with skeleton and events drawn."
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
    page: Annotated[
        bool,
        typer.Option(
            "--page",
            help="Show picture, skeleton, ranking, events and counts on a page in the browser, "
            "large enough to be read across a room. Needs the extra studio.",
        ),
    ] = False,
    retry: Annotated[
        float,
        typer.Option(
            metavar="SECONDS",
            min=0,
            help="How long a camera or a stream that breaks is opened again, with growing pauses.",
        ),
    ] = RETRY_SECONDS,
    quality: QualityOption = None,
    hands: HandsOption = None,
    weights: WeightsOption = None,
    force: ForceOption = False,
) -> None:
    """Tell every enrolled action that somebody performs.

    Windows of several lengths slide over the poses of one person; every repetition is an event,
    told when it is over, with how many it makes in a row. Many looks are many chances of a false
    match, so confidences are lower than those of `classify` for the same clip. A camera's frames
    that come too late are dropped. A video gives the same events every time, from an address too.
    A camera or a stream that breaks is told, and opened again; where it stays away, watching ends
    with exit code 3. Ctrl-C ends it. With --json, every event is a document on a line of its own.

    What is enrolled, removed or calibrated meanwhile counts at once. --page is the page of
    `actioncli studio --camera SOURCE`, and does nothing else at events.

    What --mqtt and --webhook send are those documents with the time of day, `time`. A server that
    does not answer is told, and never keeps watching waiting: events are dropped until it works
    again, and none is sent late.

    \b
    Examples:
      actioncli watch
      actioncli watch --page
      actioncli watch training.mp4 --json
      actioncli watch rtsp://192.168.1.20/stream --retry 600
      actioncli watch 0 --facing --exec 'notify-send moved'
      actioncli watch --beep --mqtt mqtt://192.168.1.5/home/gestures
      actioncli watch 0 --record seen
      actioncli watch training.mp4 --sets --csv sets.csv --annotate told.mp4

    \b
    JSON keys:
      label, start, end, confidence, repetitions, weights
    """
    from actioncli.live import timeline
    from actioncli.live.film import Film
    from actioncli.live.recorder import Recorder
    from actioncli.live.watching import DEFAULT_QUALITY
    from actioncli.live.watching import watch as events_of
    from actioncli.recognition.followed import FollowedSupport
    from actioncli.recognition.recognizer import Recognizer

    if math.isnan(retry):  # neither less nor more than the option's bound
        raise UsageError("--retry must be a number of seconds.")
    if page:
        from actioncli.cli.studio import serve

        # A broker that is set once and for all is none that was asked for here.
        broker = None if mqtt == user_settings().get("mqtt") else mqtt
        given: dict[str, object]
        given = {"exec": execute, "mqtt": broker, "webhook": webhook, "beep": beep, "csv": table}
        given |= {"srt": subtitles, "annotate": annotate, "record": record, "facing": facing}
        given |= {"sets": not each, "tau": tau, "hands": hands, "weights": weights}
        for option, value in given.items():
            if value not in (None, False):
                raise UsageError(f"--page shows what is told, and takes no --{option}.")
        serve(settings, camera=source)
        return
    name = without_password(source)
    view = _View(sys.stderr.isatty() and not settings.quiet)
    inputs = [Path(source)] if is_video(source) else []
    for file in (table, subtitles, annotate):
        if file is not None:
            check_output(file, inputs, force)
    if annotate is not None:
        check_annotation(inputs, annotate, metrabs=False)
    reactions = _reactions(view, execute, mqtt, webhook, beep)
    reactions += [timeline.table(table)] if table is not None else []
    reactions += [timeline.subtitles(subtitles)] if subtitles is not None else []
    film = Film()
    reactions += [film] if annotate is not None else []
    silent = True

    def tell(line: str) -> None:
        nonlocal silent
        silent = False
        if not settings.quiet:
            view.note(f"note: {name}: {line}")

    def frame(now: float, stream: Stream, detector: EventDetector) -> None:
        view.draw(now, stream, detector)
        if annotate is not None:
            film.add(now, stream)

    try:
        recognizer, store = Recognizer(weights), settings.open_store()
        support = load_support(settings, store, recognizer, tau)
        follow = _Following(FollowedSupport(store, recognizer, tau), reactions, tell)
        recorder = Recorder(record, support.threshold, name) if record is not None else None
        with view.live or contextlib.nullcontext():
            for event in events_of(
                source,
                follow,
                each=each,
                facing=facing,
                quality=quality or DEFAULT_QUALITY,
                retry=retry,
                hands=hands,
                recorder=recorder,
                on_frame=frame,
                note=tell,
            ):
                silent = False
                document = {**event.to_json(), "weights": recognizer.weights.checksum}
                view.say(json_text(document, indent=None) if settings.json else event_line(event))
                for react in reactions:
                    react(event)
        if inputs and silent:
            tell("no event; a second example, or a lower --tau, tells more")
        if annotate is not None:
            with video_progress(annotate, shown=not settings.quiet) as progress:
                film.write(inputs[0], annotate, progress)
            settings.tell(f"drawn in {printable(annotate)}")
    finally:
        for react in reactions:
            react.close()


class _Following:
    """What is enrolled now; changes are told, and a store that cannot be read ends nothing."""

    def __init__(
        self, read: FollowedSupport, reactions: list[Reaction], tell: Callable[[str], None]
    ) -> None:
        self._read, self._reactions, self._tell = read, reactions, tell
        self._support: SupportSet | None = None
        self._wrong = ""

    def __call__(self) -> SupportSet:
        before = self._support
        try:
            self._support = self._read()
            self._wrong = ""
        except ActionCliError as error:
            if before is None:
                raise
            if str(error) != self._wrong:
                self._tell(f"{error} What was enrolled before counts until then.")
            self._wrong = str(error)
        assert self._support is not None
        if self._support is not before:
            for react in self._reactions:
                react.enrolled(self._support.actions)
            if before is not None:
                labels = ", ".join(sorted(self._support.actions)) or "nothing"
                self._tell(f"the support set has changed; enrolled now: {labels}")
        return self._support


def _reactions(
    view: _View, execute: str | None, mqtt: str | None, webhook: str | None, beep: bool
) -> list[Reaction]:
    """What is done at events.

    Raises:
        UsageError: one of them cannot be.
    """
    from actioncli.live.commands import CommandRunner
    from actioncli.live.mqtt import Mqtt
    from actioncli.live.reactions import Bell, Webhook

    def note(line: str) -> None:
        # Not the main thread: that nobody hears it is noticed there.
        with contextlib.suppress(OutputError, BrokenPipeError):
            view.note(line)

    if beep and not sys.stderr.isatty():
        raise UsageError("--beep rings the bell of a terminal, and standard error is none.")
    reactions: list[Reaction] = [Bell(view.ring)] if beep else []
    if execute is not None:
        reactions.append(CommandRunner(execute, note, note if view.live else None))
    if webhook is not None:
        reactions.append(Webhook(webhook, note))
    if mqtt is not None:
        reactions.append(Mqtt(mqtt, note))
    return reactions


class _View:
    """Events and notes as lines; below them, on a terminal, frame rate, time left, whether the body
    is in view, and the ranking.

    What else goes to the same terminal would be drawn over: the view itself puts it above.

    Attributes:
        live: what is redrawn; None where nobody looks, or standard error is a file.
    """

    def __init__(self, shown: bool) -> None:
        self.live: Live | None = None
        self._times: list[float] = []
        if shown:
            from rich.console import Console
            from rich.live import Live

            self.live = Live(
                console=Console(stderr=True),
                refresh_per_second=8,
                transient=True,
                redirect_stdout=False,
                redirect_stderr=False,
            )

    def draw(self, now: float, stream: Stream, detector: EventDetector) -> None:
        """A frame; rich limits how often that reaches the terminal."""
        if self.live is None:
            return
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
        self.live.update(Text("\n".join(lines)))

    def say(self, line: str) -> None:
        """An event, to standard output."""
        if self.live and sys.stdout.isatty() and os.ttyname(1) == os.ttyname(2):
            self._above(line)
        else:
            say(line)

    def note(self, line: str) -> None:
        """What a person should know, to standard error."""
        (self._above if self.live else note)(printable(line))

    def ring(self) -> None:
        """The terminal's bell."""
        typer.echo("\a", nl=False, err=True)

    def _above(self, line: str) -> None:
        assert self.live is not None
        self.live.console.print(line, markup=False, emoji=False, highlight=False, soft_wrap=True)
