"""`calibrate --background`: the threshold by which an ordinary day is taken for no action."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from actioncli.cli.answer import event_line
from actioncli.cli.output import plural, printable, say, table, write_json
from actioncli.cli.video import video_progress
from actioncli.errors import UsageError
from actioncli.pose import without_password
from actioncli.pose.read import is_video, read_any

if TYPE_CHECKING:
    from actioncli.cli.command import Settings
    from actioncli.clips.clip import Clip
    from actioncli.live.background import Background
    from actioncli.live.watching import Stream
    from actioncli.pose import ReadOptions
    from actioncli.recognition.recognizer import Recognizer

# Minutes of what has no end.
_MINUTES = 10.0


def calibrate_background(
    settings: Settings,
    options: ReadOptions,
    recognizer: Recognizer,
    source: str,
    minutes: float | None,
    target: float,
    dry_run: bool,
) -> None:
    """Count, tell, and keep a threshold and negatives.

    Raises:
        ClipError: there is nothing to count on.
        UsageError: an option that means nothing for this source.
    """
    from actioncli.calibration.enrolment import enrol
    from actioncli.live.background import negatives_of, watch_background
    from actioncli.pose.video import DEFAULT_QUALITY, Progress
    from actioncli.recognition.support import SupportSet
    from actioncli.recognition.threshold import DEFAULT_TAU, Threshold, keep_threshold
    from actioncli.store.names import NEGATIVES

    shown, name = _source(source, options), without_password(source)
    if minutes is None:
        minutes = math.inf if is_video(source) or not isinstance(shown, str) else _MINUTES
    checksum = recognizer.weights.checksum
    with settings.open_store() as store:
        support = SupportSet.load(store, recognizer)
        support.require_actions()
        with video_progress(Path(name), shown=not settings.quiet) as progress:
            frames = 0

            def on_frame(now: float, _: Stream) -> None:
                nonlocal frames
                frames += 1
                if progress is not None:
                    progress(Progress(frames, now, 60 * minutes if minutes < math.inf else 0))

            found = watch_background(
                shown,
                support,
                60 * minutes,
                quality=options.quality or DEFAULT_QUALITY,
                hands=options.hands,
                note=lambda line: settings.tell(f"note: {printable(name)}: {printable(line)}"),
                on_frame=on_frame,
            )
        tau = found.tau(target)
        clips = negatives_of(found, name)
        if not settings.json:
            _print(settings, found, tau, len(clips), dry_run)
        examples = []
        if not dry_run:
            if tau is not None:
                keep_threshold(store, Threshold(tau, checksum))
            examples = [
                one.example
                for one in enrol(
                    store, recognizer, "", clips, "background", negative=True, keep_tau=True
                )
            ]
    notes = found.notes(target)
    if examples:
        numbers = ", ".join(map(str, examples))
        notes.append(
            f"Kept as negatives: {plural(len(examples), 'example')} ({numbers}). If one shows an "
            f"action, take it out: actioncli remove {NEGATIVES} --example N."
        )
    if settings.json:
        document: dict[str, Any] = {
            "tau": DEFAULT_TAU if tau is None else tau,
            "measured": tau is not None,
        }
        document |= {"kept": tau is not None and not dry_run, "weights": checksum}
        document |= {"source": name, "target_events": target, **found.to_json()}
        write_json({**document, "negatives": examples, "notes": notes})
        return
    for line in notes:
        settings.tell(f"note: {printable(line)}")
    use = "not kept" if dry_run else "kept, watch and classify use it unless --tau is given"
    say("the threshold stays as it was" if tau is None else f"tau {tau:g}: {use}")


def _source(source: str, options: ReadOptions) -> str | Clip:
    """What is watched: a file of joints is read.

    Raises:
        ClipError: it cannot be.
        UsageError: an option that means nothing for this source.
    """
    from actioncli.pose.camera import is_device

    path = Path(source)
    stream = source.isdecimal() or "://" in source or is_device(path) or is_video(path)
    if not stream:
        return read_any(path, options)
    for name in ("layout", "fps", "unit", "up"):
        if getattr(options, name) is not None:
            raise UsageError(f"{without_password(source)}: --{name} is for files of joints.")
    return source


def _print(
    settings: Settings, found: Background, tau: float | None, negatives: int, dry_run: bool
) -> None:
    if settings.quiet:
        return
    rows = [
        (
            f"{row['tau']:g}",
            found.events[row["tau"]],
            f"{row['an_hour']:.1f}",
            f"{row['high']:.1f}",
            "<- recommended" if row["tau"] == tau else "",
        )
        for row in found.rates()
    ]
    say(f"{found.seconds / 60:.1f} minutes in which somebody was seen")
    say(table(("tau", "false events", "an hour", "at most (95 %)", ""), rows))
    say()
    for event, _ in found.nearest:
        say(event_line(replace(event, repetitions=1)))
    if negatives:
        what = "would be" if dry_run else "is"
        say(f"What came nearest, {plural(negatives, 'clip')}, {what} kept as negatives.")
        say()
