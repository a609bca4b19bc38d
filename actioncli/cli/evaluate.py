"""`evaluate`: measure a model, or a baseline, on collections of recordings."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from actioncli.cli.command import Settings, command
from actioncli.cli.common import check_place, tell_notes
from actioncli.cli.figures import say_acceptance, say_figures
from actioncli.cli.options import WeightsOption, checked_tau
from actioncli.cli.output import printable, progress, say, steps, write_json
from actioncli.errors import UsageError
from actioncli.files import json_text

if TYPE_CHECKING:
    from actioncli.clips.collection import Collection
    from actioncli.evaluation.acceptance import Acceptance
    from actioncli.evaluation.result import Evaluation
    from actioncli.evaluation.scorer import Scorer
    from actioncli.evaluation.splits import Splits

PROTOCOLS = ("cross-person", "personal")
BASELINES = ("exp", "dtw", "dtw-cohort", "always-reject", "random")
_WAYS = (5, 10, 15)


@command
def evaluate(
    settings: Settings,
    collections: Annotated[
        list[Path] | None,
        typer.Argument(
            metavar="COLLECTION...",
            help="Collections (.npz), or folders label/clip.*.",
            show_default=False,
        ),
    ] = None,
    ways: Annotated[
        str | None,
        typer.Option(
            metavar="K,...",
            help="Numbers of enrolled actions; all but two where a collection has too few.  "
            "[default: 5,10,15; with --ntu 5 to 15]",
            show_default=False,
        ),
    ] = None,
    shots: Annotated[int, typer.Option(metavar="N", min=1, help="Clips per enrolled action.")] = 1,
    episodes: Annotated[
        int, typer.Option(metavar="N", min=1, help="Draws per collection and number of ways.")
    ] = 100,
    protocol: Annotated[
        str,
        typer.Option(
            metavar="|".join(PROTOCOLS),
            help="Whether other people than the enrolled ones ask the queries, or the same one.",
        ),
    ] = "cross-person",
    tau: Annotated[
        float, typer.Option(metavar="0..1", help="Accept where the confidence is above it.")
    ] = 0.5,
    splits: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE",
            help="Draw from its benchmark classes only.  [default: all classes]",
            show_default=False,
        ),
    ] = None,
    seed: Annotated[int, typer.Option(metavar="N", min=0, help="Of the episodes.")] = 0,
    baseline: Annotated[
        list[str] | None,
        typer.Option(
            metavar="NAME",
            help=f"Measure a baseline instead of the model, or beside it in a --report: "
            f"{', '.join(BASELINES)}; may be repeated.",
            show_default=False,
        ),
    ] = None,
    weights: WeightsOption = None,
    acceptance: Annotated[
        bool,
        typer.Option("--acceptance", help="Also enrol each action alone and ask all queries."),
    ] = False,
    ntu: Annotated[
        Path | None,
        typer.Option(
            metavar="FOLDER",
            help="Run the one-shot protocol of NTU RGB+D 120 on its .skeleton files instead.",
            show_default=False,
        ),
    ] = None,
    report: Annotated[
        Path | None,
        typer.Option(
            metavar="FOLDER",
            help="Also write a page of plots, confusions and their clips, with the figures as CSV "
            "and JSON; includes --acceptance.",
            show_default=False,
        ),
    ] = None,
    as_json: Annotated[
        Path | None,
        typer.Option(
            "--json",
            metavar="FILE",
            help="Also write one JSON document to a file; - prints it instead of tables.",
            show_default=False,
        ),
    ] = None,
) -> None:
    """Measure recognition of actions, and rejection of the rest.

    An episode enrols some actions of a collection and asks as many queries of these actions as
    of others. Figures are mean and standard deviation over episodes; the mean over collections
    counts those with at least four actions. The episodes follow from the seed alone, so models
    and baselines answer the same ones. Baselines prepare clips as the weights say; exp also
    takes their distances, and dtw-cohort normalises by clips of the train classes of --splits.

    \b
    FSOS-ACC     queries answered rightly: named if known, rejected if unknown
    reject       the same figure of rejecting everything
    closed set   known queries whose nearest action is the right one
    AUROC        known queries that outscore unknown ones
    OSCR         the same, counting only known queries that are named rightly
    FPR95        unknown queries accepted where 95 % of the known ones are

    \b
    Examples:
      actioncli evaluate recordings/*.npz --splits splits.json --ways 5 --json figures.json
      actioncli evaluate kard.npz --protocol personal --baseline dtw
      actioncli evaluate kard.npz --baseline exp --baseline dtw --report kard_report
      actioncli evaluate --ntu nturgb+d_skeletons --acceptance

    \b
    JSON keys:
      scorer, weights, protocol, shots, episodes, tau, seed, results, means, skipped, acceptance,
        others
      results[], means[]: collection, ways, ways_used, classes, queries_per_episode, metrics,
        expected_calibration_error, reliability; means[] also collections
      .metrics: fsos_accuracy, always_reject_fsos_accuracy, closed_set_accuracy, auroc, oscr,
        fpr_at_95_tpr, false_accept_rate, false_reject_rate; each with mean and std
      .reliability[]: share, confidence, accuracy
      skipped[]: collection, reason
      acceptance[]: collection, classes, rate, asked
      others[]: the same keys, for every further baseline
    """
    checked_tau(tau)
    numbers = _numbers(ways)
    if protocol not in PROTOCOLS:
        raise UsageError(f"unknown protocol {protocol!r}; there are {', '.join(PROTOCOLS)}.")
    baselines: list[str | None] = list(dict.fromkeys(baseline or ()))
    for name in baselines:
        if name not in BASELINES:
            raise UsageError(f"unknown baseline {name!r}; there are {', '.join(BASELINES)}.")
    # None stands for the model itself.
    scorers = baselines if baselines and report is None else [None, *baselines]
    if bool(collections) == (ntu is not None):
        raise UsageError("give collections to measure on, or --ntu FOLDER.")
    if ntu is not None and (splits or shots != 1 or protocol != PROTOCOLS[0]):
        raise UsageError("--ntu is a protocol of its own: no --splits, --shots or --protocol.")
    to_stdout = settings.json or as_json == Path("-")
    if as_json is not None and not to_stdout:
        if str(as_json).startswith("-"):
            raise UsageError("--json needs a file here, or - for standard output.")
        check_place(as_json)

    if report is not None:
        from actioncli.report.figures import check_folder

        check_folder(report)

    read, parts = _read(settings, collections or [], splits)
    runs: list[Run] = []
    for name in scorers:
        scorer, checksum = _scorer(name, weights, seed, read, parts)
        # A report's matrices are those of its first scorer.
        wanted = acceptance or (report is not None and not runs)
        with steps(shown=not settings.quiet) as step:
            if ntu is not None:
                from actioncli.evaluation.ntu import WAYS, evaluate_ntu

                ran = evaluate_ntu(
                    scorer,
                    ntu,
                    ways=numbers or WAYS,
                    episodes=episodes,
                    tau=tau,
                    seed=seed,
                    progress=step,
                )
                runs.append(Run(ran.evaluation, checksum, (ran.acceptance,) if wanted else ()))
                continue
            from actioncli.evaluation import acceptance as matrix
            from actioncli.evaluation import protocol as protocols
            from actioncli.evaluation.episodes import Protocol

            chosen: dict[str, Any] = {
                "shots": shots,
                "episodes": episodes,
                "protocol": Protocol(protocol),
                "tau": tau,
                "seed": seed,
                "splits": parts,
                "progress": step,
            }
            found = protocols.evaluate(scorer, read, ways=numbers or _WAYS, **chosen)
            tables = matrix.acceptance(scorer, read, **chosen) if wanted else ()
            runs.append(Run(found, checksum, tables))

    for skip in runs[0].found.skipped:
        settings.tell(f"note: left out: {printable(skip.reason)}")
    first, *others = (run.document() for run in runs)
    document = {**first, "others": others}
    if to_stdout:
        write_json(document)
    else:
        for place, run in enumerate(runs):
            if place:
                say()
            say_figures(run.found)
            for each in run.acceptance if acceptance else ():
                say_acceptance(each, tau)
    if as_json is not None and not to_stdout:
        _write_document(as_json, document)
    if report is not None:
        from actioncli.report.evaluation import Report, write_report

        told = Report([run.found for run in runs], runs[0].acceptance, read, document)
        settings.tell(f"report: {printable(write_report(report, told))}")


@dataclass(frozen=True, slots=True)
class Run:
    """What one scorer gave."""

    found: Evaluation
    weights: str | None
    acceptance: Sequence[Acceptance]

    def document(self) -> dict[str, Any]:
        """As JSON has it, without the other scorers."""
        return {
            **self.found.as_json(),
            "weights": self.weights,
            "acceptance": [each.as_json() for each in self.acceptance],
        }


def _numbers(ways: str | None) -> tuple[int, ...]:
    try:
        numbers = tuple(dict.fromkeys(int(word) for word in ways.split(","))) if ways else ()
    except ValueError:
        numbers = (0,)
    if numbers and min(numbers) < 1:
        raise UsageError(f"--ways must be numbers from 1 such as 5,10,15, not {ways!r}.")
    return numbers


def _write_document(file: Path, document: Mapping[str, object]) -> None:
    from actioncli.files import replacing

    try:
        with replacing(file) as part:
            part.write_text(json_text(document) + "\n", encoding="utf-8")
    except OSError as error:
        raise UsageError(f"{file}: cannot be written: {error.strerror}.") from error


def _read(
    settings: Settings, paths: Sequence[Path], splits: Path | None
) -> tuple[list[Collection], Splits | None]:
    from actioncli.clips.collection import read_collection
    from actioncli.evaluation.splits import read_splits

    parts = read_splits(splits) if splits else None
    read = []
    for path in progress(paths, "Reading", shown=not settings.quiet):
        read.append(read_collection(path))
        tell_notes(settings, path, read[-1].notes)
    return read, parts


def _scorer(
    baseline: str | None,
    weights: Path | None,
    seed: int,
    read: Sequence[Collection],
    parts: Splits | None,
) -> tuple[Scorer, str | None]:
    """What is measured, and the checksum of the weights behind it."""
    from actioncli.evaluation import baselines
    from actioncli.recognition.recognizer import Recognizer

    if baseline == "always-reject":
        return baselines.AlwaysReject(), None
    if baseline == "random":
        return baselines.Random(seed), None
    recognizer = Recognizer(weights)
    checksum = recognizer.weights.checksum
    if baseline is None:
        return recognizer, checksum
    if baseline == "exp":
        return baselines.Exp(recognizer), checksum
    cohort = []
    if baseline == "dtw-cohort":
        if parts is None:
            raise UsageError("dtw-cohort takes its cohort from the train classes of --splits FILE.")
        cohort = baselines.cohort_clips(read, parts)
    return baselines.Dtw(recognizer.weights.config.preparation, cohort), checksum
