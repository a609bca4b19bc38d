"""`calibrate`: find the threshold that suits a support set."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from actioncli.cli.answer import notes_of, short_names
from actioncli.cli.command import Settings, command
from actioncli.cli.options import StreamReading, WeightsOption
from actioncli.cli.output import plural, printable, progress, say, table, write_json
from actioncli.cli.reading import read_each, usable
from actioncli.errors import ClipError, UsageError
from actioncli.pose import ReadOptions
from actioncli.pose.read import find_any

if TYPE_CHECKING:
    from collections.abc import Sequence

    from actioncli.calibration.threshold import Calibration
    from actioncli.clips.clip import FloatArray
    from actioncli.recognition.recognizer import Recognizer

_KINDS = {
    "actions": "your examples, to the other actions",
    "negatives": "your negatives",
    "cohort": "other people's motions",
}


@command
def calibrate(
    settings: Settings,
    *,
    negatives: Annotated[
        list[Path] | None,
        typer.Option(
            metavar="PATH",
            help="Clips, or a folder of them, that show none of the actions; may be repeated.",
        ),
    ] = None,
    target_far: Annotated[
        float | None,
        typer.Option(metavar="RATE", help="Wanted rate of false accepts.  [default: 0.05]"),
    ] = None,
    per_action: Annotated[
        bool, typer.Option("--per-action", help="Give each action a threshold of its own.")
    ] = False,
    dry_run: Annotated[
        bool, typer.Option("--dry-run", help="Tell the threshold without keeping it.")
    ] = False,
    reset: Annotated[
        bool, typer.Option("--reset", help="Forget the kept threshold; measure nothing.")
    ] = False,
    report: Annotated[
        Path | None,
        typer.Option(
            metavar="FOLDER",
            help="Also write a page of plots and tables, with the figures as CSV and JSON.",
        ),
    ] = None,
    background: Annotated[
        str | None,
        typer.Option(
            metavar="VIDEO|CAMERA|FILE",
            help="Count false events of `watch` instead, on an ordinary day in which none of the "
            "actions is done.",
        ),
    ] = None,
    minutes: Annotated[
        float | None,
        typer.Option(
            metavar="MINUTES",
            help="How much of it.  [default: 10 of a camera or an address, all of a file]",
        ),
    ] = None,
    target_events: Annotated[
        float | None,
        typer.Option(metavar="RATE", help="Wanted false events an hour.  [default: 0.5]"),
    ] = None,
    weights: WeightsOption = None,
    options: StreamReading,
) -> None:
    """Measure which threshold suits the support set.

    False rejects are counted on enrolled examples, each against the support set without it;
    that takes two examples of an action. False accepts are counted on clips that show none of
    the enrolled actions: each example against the other actions, the negatives (`enroll
    --negative`, --negatives), and motions of other people that came with the weights. Each rate
    stands with its 95 % interval, for which examples of one action count as one motion.

    The smallest threshold that holds the wanted rate of false accepts is kept in the support
    set, and `classify` uses it unless --tau is given. Where there are too few motions to tell,
    none is kept, and `classify` uses 0.5.

    With --background, a recording of ordinary life is watched under several thresholds, from 0.5
    on. The lowest that holds the wanted number of false events an hour is kept, as above; how
    many there may be is told with the upper end of a 95 % interval, since ten minutes show
    little. What came nearest, up to 20 clips of events at 0.5, is kept as negatives (`enroll
    --negative`); the threshold is chosen without them. --dry-run keeps neither.

    \b
    Examples:
      actioncli calibrate
      actioncli calibrate --negatives everyday/ --target-far 0.02 --dry-run
      actioncli calibrate --report calibration
      actioncli calibrate --background 0 --minutes 60
      actioncli calibrate --background kitchen.mp4 --target-events 0.2 --dry-run
      actioncli calibrate --reset

    \b
    JSON keys:
      tau, measured, kept, target_far, weights, table, unknown, actions, notes, failed
      table[]: tau, false_accepts, false_rejects, misnamed
      unknown[]: kind, false_accepts
      actions[]: label, examples, tau, false_accepts, false_rejects
      .false_accepts, .false_rejects, .misnamed: count, of, motions, rate, low, high
    With --reset: tau, kept
    With --background: tau, measured, kept, weights, source, target_events, minutes, rates, events
    With --background: negatives, notes
      rates[]: tau, events, an_hour, high
      events[]: label, start, end, confidence, repetitions
    """
    from actioncli.recognition.threshold import DEFAULT_TAU, Threshold, keep_threshold

    if background is None and not (minutes is None and target_events is None):
        raise UsageError("--minutes and --target-events belong to --background.")
    if background is not None:
        if reset or negatives or per_action or report or target_far is not None:
            raise UsageError(
                "--background counts events: no --negatives, --target-far, --per-action, --report "
                "or --reset."
            )
        target_events = 0.5 if target_events is None else target_events
        for name, value in (("minutes", minutes), ("target-events", target_events)):
            if value is not None and not value > 0:
                raise UsageError(f"--{name} must be above 0, not {value:g}.")
        from actioncli.cli.background import calibrate_background
        from actioncli.recognition.recognizer import Recognizer

        recognizer = Recognizer(weights)
        calibrate_background(
            settings, options, recognizer, background, minutes, target_events, dry_run
        )
        return
    target_far = 0.05 if target_far is None else target_far
    if reset:
        if negatives or per_action or dry_run or report:
            raise UsageError(
                "--reset only forgets: no --negatives, --per-action, --dry-run or --report."
            )
        with settings.open_store() as store:
            keep_threshold(store, None)
        line = f"No threshold is kept; classify uses tau {DEFAULT_TAU:g} unless --tau is given."
        settings.answer({"tau": DEFAULT_TAU, "kept": False}, line)
        return
    if not 0 < target_far < 1:
        raise UsageError(f"--target-far must lie between 0 and 1, not {target_far:g}.")
    if report is not None:
        from actioncli.report.calibration import check_folder

        check_folder(report)
    from actioncli.calibration import threshold as calibration
    from actioncli.recognition.recognizer import Recognizer
    from actioncli.recognition.support import SupportSet

    recognizer = Recognizer(weights)
    checksum = recognizer.weights.checksum
    with settings.open_store() as store:
        support = SupportSet.load(store, recognizer)
        support.require_actions()
        others, failed = _read(settings, options, recognizer, negatives or [])
        found = calibration.calibrate(
            support,
            others,
            target_far,
            per_action,
            lambda steps: progress(steps, "Comparing", shown=not settings.quiet),
        )
        kept = Threshold(found.tau, checksum, found.actions) if found.measured else None
        if not dry_run:
            keep_threshold(store, kept)
    own = f", and {plural(len(found.actions), 'action')} one of its own" if found.actions else ""
    outcome = f"tau {found.tau:g}, as without calibration: nothing else can be told"
    if found.measured:
        use = "not kept" if dry_run else "kept, classify uses it unless --tau is given"
        outcome = f"tau {found.tau:g}{own}: {use}"
    ending = {"kept": found.measured and not dry_run, "weights": checksum, "failed": failed}
    document = {**found.to_json(), **ending}
    if report is not None:
        from actioncli.report.calibration import write_calibration

        page = write_calibration(report, found, outcome, document)
        settings.tell(f"report: {printable(page)}")
    if settings.json:
        write_json(document)
    else:
        if not settings.quiet:
            _print(found, per_action)
        for line in found.notes:
            settings.tell(f"note: {printable(line)}")
        say(outcome)
    if failed:
        raise typer.Exit(ClipError.exit_code)


def _read(
    settings: Settings, options: ReadOptions, recognizer: Recognizer, paths: Sequence[Path]
) -> tuple[FloatArray, int]:
    """Embeddings of the clips that can be used, and how many cannot."""
    import numpy as np

    embeddings = [recognizer.embed([])]
    failed = 0
    files = find_any(paths)
    given = read_each(files, options, shown=not settings.quiet)
    with notes_of(settings, short_names(files)) as add_notes:
        for path, found in usable(given, recognizer):
            if isinstance(found, dict):
                failed += 1
            else:
                add_notes(path, found.clip.notes)
                embeddings.append(found.embedding[None])
    return np.concatenate(embeddings), failed


def _print(found: Calibration, per_action: bool) -> None:
    figures = found.figures()
    header = ("tau", "false accepts", "false rejects", "misnamed", "")
    rows = []
    for row in figures["table"]:
        tau, *rates = row.values()
        mark = "<- recommended" if found.measured and tau == found.tau else ""
        rows.append((f"{tau:g}", *rates, mark))
    say(table(header, rows))
    say()
    kinds = [(_KINDS[row["kind"]], row["false_accepts"]) for row in figures["unknown"]]
    say(table((f"clips that show none, tau {found.tau:g}", "false accepts"), kinds))
    if per_action:
        rows = [tuple(row.values()) for row in figures["actions"]]
        rows = [(label, examples, f"{tau:g}", *rates) for label, examples, tau, *rates in rows]
        say()
        say(table(("action", "examples", "tau", "false accepts", "false rejects"), rows))
    say()
