"""`calibrate`: find the threshold that suits a support set."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from actioncli.cli.answer import notes_of, short_names
from actioncli.cli.command import Settings, command
from actioncli.cli.options import FileReading, WeightsOption
from actioncli.cli.output import plural, printable, progress, say, table, write_json
from actioncli.cli.reading import read_each, usable
from actioncli.errors import ClipError, UsageError
from actioncli.pose.read import ReadOptions, find_any

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
        float, typer.Option(metavar="RATE", help="Wanted rate of false accepts.")
    ] = 0.05,
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
    weights: WeightsOption = None,
    options: FileReading,
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

    \b
    Examples:
      actioncli calibrate
      actioncli calibrate --negatives everyday/ --target-far 0.02 --dry-run
      actioncli calibrate --report calibration
      actioncli calibrate --reset

    \b
    JSON keys:
      tau, measured, kept, target_far, weights, table, unknown, actions, notes, failed
      table[]: tau, false_accepts, false_rejects, misnamed
      unknown[]: kind, false_accepts
      actions[]: label, examples, tau, false_accepts, false_rejects
      .false_accepts, .false_rejects, .misnamed: count, of, motions, rate, low, high
    With --reset: tau, kept
    """
    from actioncli.recognition.threshold import DEFAULT_TAU, Threshold, keep_threshold

    if reset:
        if negatives or per_action or dry_run or report:
            raise UsageError(
                "--reset only forgets: no --negatives, --per-action, --dry-run or --report."
            )
        with settings.open_store() as store:
            keep_threshold(store, None)
        if settings.json:
            write_json({"tau": DEFAULT_TAU, "kept": False})
        elif not settings.quiet:
            say(f"No threshold is kept; classify uses tau {DEFAULT_TAU:g} unless --tau is given.")
        return
    if not 0 < target_far < 1:
        raise UsageError(f"--target-far must lie between 0 and 1, not {target_far:g}.")
    if report is not None:
        from actioncli.report.figures import check_folder

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
        for path, clip in usable(given, recognizer):
            if isinstance(clip, dict):
                failed += 1
            else:
                add_notes(path, clip.notes)
                embeddings.append(recognizer.embed([clip]))
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
