"""`calibrate`: find the threshold that suits a support set."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from actioncli.cli.command import Settings, command
from actioncli.cli.common import tell_notes
from actioncli.cli.options import FileReading, WeightsOption
from actioncli.cli.output import plural, printable, progress, say, table, write_json
from actioncli.cli.reading import Reading, named_clips, read_each, report_bad_clip, sharing
from actioncli.errors import ClipError, UsageError

if TYPE_CHECKING:
    from collections.abc import Sequence

    from actioncli.calibration.threshold import Recommendation
    from actioncli.calibration.trials import Rate, Trials
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
            show_default=False,
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
            show_default=False,
        ),
    ] = None,
    weights: WeightsOption = None,
    reading: FileReading,
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
    if reset:
        if negatives or per_action or dry_run or report:
            raise UsageError(
                "--reset only forgets: no --negatives, --per-action, --dry-run or --report."
            )
        _forget(settings)
        return
    if not 0 < target_far < 1:
        raise UsageError(f"--target-far must lie between 0 and 1, not {target_far:g}.")
    if report is not None:
        from actioncli.report.figures import check_folder

        check_folder(report)
    from actioncli.calibration.threshold import recommend
    from actioncli.calibration.trials import run_trials
    from actioncli.recognition.recognizer import Recognizer
    from actioncli.recognition.support import SupportSet
    from actioncli.recognition.threshold import Threshold, keep_threshold

    recognizer = Recognizer(weights)
    checksum = recognizer.weights.checksum
    with settings.open_store() as store:
        support = SupportSet.load(store, recognizer)
        support.require_actions()
        others, failed = _read(settings, reading, recognizer, negatives or [])
        trials = run_trials(
            recognizer,
            support.actions,
            support.negatives,
            others,
            lambda steps: progress(steps, "Comparing", shown=not settings.quiet),
        )
        found = recommend(trials, target_far, per_action)
        notes = list(found.notes)
        if support.foreign_threshold is not None:
            last = support.foreign_threshold.tau
            notes.append(f"The kept threshold, {last:g}, was measured with other weights.")
        if not dry_run:
            keep_threshold(
                store, Threshold(found.tau, checksum, found.actions) if found.measured else None
            )

    document = {
        "tau": found.tau,
        "measured": found.measured,
        "kept": found.measured and not dry_run,
        "target_far": target_far,
        "weights": checksum,
        **_figures(trials, found),
        "notes": notes,
        "failed": failed,
    }
    if report is not None:
        from actioncli.report.calibration import write_calibration

        page = write_calibration(report, trials, found, _outcome(found, dry_run), document)
        settings.tell(f"report: {printable(page)}")
    if settings.json:
        write_json(document)
    else:
        if not settings.quiet:
            _print(trials, found, per_action)
        for line in notes:
            settings.tell(f"note: {printable(line)}")
        say(_outcome(found, dry_run))
    if failed:
        raise typer.Exit(ClipError.exit_code)


def _forget(settings: Settings) -> None:
    from actioncli.recognition.threshold import DEFAULT_TAU, keep_threshold

    with settings.open_store() as store:
        keep_threshold(store, None)
    if settings.json:
        write_json({"tau": DEFAULT_TAU, "kept": False})
    elif not settings.quiet:
        say(f"No threshold is kept; classify uses tau {DEFAULT_TAU:g} unless --tau is given.")


def _read(
    settings: Settings, reading: Reading, recognizer: Recognizer, paths: Sequence[Path]
) -> tuple[FloatArray, int]:
    """Embeddings of the clips that can be used, and how many cannot."""
    import numpy as np

    embeddings = [recognizer.embed([])]
    failed = 0
    files = named_clips(paths) if paths else []
    read = read_each(files, reading.read, "Reading", shown=reading.shown, processes=sharing(files))
    for path, clip in read:
        try:
            if isinstance(clip, ClipError):
                raise clip
            embeddings.append(recognizer.embed([clip]))
        except ClipError as unusable:
            failed += 1
            report_bad_clip(unusable)
        else:
            tell_notes(settings, path, clip.notes)
    return np.concatenate(embeddings), failed


def _rows(trials: Trials, found: Recommendation) -> list[tuple[float, Rate, Rate, Rate]]:
    """The table over tau: false accepts, false rejects, and what was named wrongly."""
    from actioncli.calibration.threshold import TAUS

    return [
        (tau, trials.false_accepts(tau), trials.false_rejects(tau), trials.misnamed(tau))
        for tau in sorted({*TAUS, found.tau})
    ]


def _thresholds(trials: Trials, found: Recommendation) -> list[float]:
    """The threshold of each action."""
    return [found.actions.get(label, found.tau) for label in trials.labels]


def _figures(trials: Trials, found: Recommendation) -> dict[str, object]:
    taus = _thresholds(trials, found)
    return {
        "table": [
            {
                "tau": tau,
                "false_accepts": accepts.to_json(),
                "false_rejects": rejects.to_json(),
                "misnamed": misnamed.to_json(),
            }
            for tau, accepts, rejects, misnamed in _rows(trials, found)
        ],
        "unknown": [
            {"kind": kind, "false_accepts": trials.false_accepts(taus, kind).to_json()}
            for kind in trials.unknown
        ],
        "actions": [
            {
                "label": label,
                "examples": trials.examples[action],
                "tau": taus[action],
                "false_accepts": trials.false_accepts(taus, action=action).to_json(),
                "false_rejects": trials.false_rejects(taus, action).to_json(),
            }
            for action, label in enumerate(trials.labels)
        ],
    }


def _print(trials: Trials, found: Recommendation, per_action: bool) -> None:
    header = ("tau", "false accepts", "false rejects", "misnamed", "")
    rows = [
        (
            f"{tau:g}",
            *map(_cell, rates),
            "<- recommended" if found.measured and tau == found.tau else "",
        )
        for tau, *rates in _rows(trials, found)
    ]
    say(table(header, rows))
    taus = _thresholds(trials, found)
    say()
    say(
        table(
            (f"clips that show none, tau {found.tau:g}", "false accepts"),
            [(what, _cell(trials.false_accepts(taus, kind))) for kind, what in _KINDS.items()],
        )
    )
    if per_action:
        say()
        say(
            table(
                ("action", "examples", "tau", "false accepts", "false rejects"),
                [
                    (
                        label,
                        trials.examples[action],
                        f"{taus[action]:g}",
                        _cell(trials.false_accepts(taus, action=action)),
                        _cell(trials.false_rejects(taus, action)),
                    )
                    for action, label in enumerate(trials.labels)
                ],
            )
        )
    say()


def _cell(rate: Rate) -> str:
    if not rate.of:
        return "none asked"
    low, high = rate.interval
    return f"{rate.count}/{rate.of} {rate.rate:4.0%} ({low * 100:.0f}-{high:.0%})"


def _outcome(found: Recommendation, dry_run: bool) -> str:
    own = f", and {plural(len(found.actions), 'action')} one of its own" if found.actions else ""
    if not found.measured:
        return f"tau {found.tau:g}, as without calibration: nothing else can be told"
    if dry_run:
        return f"tau {found.tau:g}{own}: not kept"
    return f"tau {found.tau:g}{own}: kept, classify uses it unless --tau is given"
