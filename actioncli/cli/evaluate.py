"""`evaluate`: measure a model, or a baseline, on collections of recordings."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from actioncli.cli.command import Settings, command
from actioncli.cli.common import check_output, tell_notes
from actioncli.cli.options import ForceOption, WeightsOption
from actioncli.cli.output import printable, progress, say, steps, table, write_json
from actioncli.errors import UsageError

if TYPE_CHECKING:
    from actioncli.clips.collection import Collection
    from actioncli.evaluation.result import Evaluation, Result
    from actioncli.evaluation.splits import Splits
    from actioncli.evaluation.task import Scorer


PROTOCOLS = ("cross-person", "personal")
BASELINES = ("exp", "dtw", "dtw-cohort", "always-reject", "random")
_WAYS = (5, 10, 15)


@command
def evaluate(
    settings: Settings,
    collections: Annotated[
        list[Path],
        typer.Argument(
            metavar="COLLECTION...",
            help="Collections (.npz), or folders label/clip.* of joints or videos.",
        ),
    ],
    ways: Annotated[
        str | None,
        typer.Option(
            metavar="K,...",
            help="Numbers of enrolled actions; all but two where a collection has too few.  "
            "[default: 5,10,15]",
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
    ] = PROTOCOLS[0],
    splits: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE",
            help="Draw from its benchmark classes only.  [default: all classes]",
            show_default=False,
        ),
    ] = None,
    baseline: Annotated[
        list[str] | None,
        typer.Option(
            metavar="NAME",
            help=f"Measure a baseline instead of the model: {', '.join(BASELINES)}; may be "
            "repeated.",
            show_default=False,
        ),
    ] = None,
    either_side: Annotated[
        bool,
        typer.Option("--either-side", help="Enrol every example with its mirror image."),
    ] = False,
    changed: Annotated[
        bool,
        typer.Option(
            "--changed",
            help="Ask clips made of the enrolled ones: backwards, shuffled, a limb frozen, ...",
        ),
    ] = False,
    weights: WeightsOption = None,
    force: ForceOption = False,
    json: Annotated[
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
    counts those with at least four actions. The episodes are the same in every run, so models
    and baselines answer the same ones. Baselines prepare clips as the weights say; exp also
    takes their distances, and dtw-cohort normalises by clips of the train classes of --splits.

    \b
    FSOS-ACC     queries answered rightly: named if enrolled, rejected if not
    reject       the same figure of rejecting everything
    closed set   queries of enrolled actions whose nearest action is the right one
    AUROC        queries of enrolled actions that outscore others
    OSCR         the same, counting only those that are named rightly
    FPR95        other queries accepted where 95 % of the enrolled actions' are

    \b
    Examples:
      actioncli evaluate recordings/*.npz --splits splits.json --ways 5 --json figures.json
      actioncli evaluate kard.npz --protocol personal --baseline dtw
      actioncli evaluate kard.npz --baseline exp --baseline dtw --json -
      actioncli evaluate kard.npz --changed

    \b
    JSON keys:
      scorer, weights, protocol, shots, episodes, tau, seed, results, means, skipped, others
      results[], means[]: collection, ways, ways_used, classes, queries_per_episode, metrics,
        expected_calibration_error, reliability; means[] also collections
      .metrics: fsos_accuracy, always_reject_fsos_accuracy, closed_set_accuracy, auroc, oscr,
        fpr_at_95_tpr, false_accept_rate, false_reject_rate; each with mean and std
      .reliability[]: share, confidence, accuracy
      with --changed: scorer, weights, tau, accepted; accepted[]: kind, share, of
      skipped[]: collection, reason
      others[]: the same keys, for every further baseline
    """
    from actioncli.evaluation.episodes import Protocol
    from actioncli.evaluation.protocol import evaluate as run
    from actioncli.evaluation.splits import read_splits

    numbers = _numbers(ways)
    if protocol not in PROTOCOLS:
        raise UsageError(f"unknown protocol {protocol!r}; there are {', '.join(PROTOCOLS)}.")
    # None stands for the model itself.
    scorers: list[str | None] = list(dict.fromkeys(baseline or ())) or [None]
    for name in scorers:
        if name not in (None, *BASELINES):
            raise UsageError(f"unknown baseline {name!r}; there are {', '.join(BASELINES)}.")
    to_stdout = settings.json or json == Path("-")
    if json is not None and not to_stdout:
        if str(json).startswith("-"):
            raise UsageError("--json needs a file here, or - for standard output.")
        check_output(json, collections, force, _is_document)

    parts = read_splits(splits) if splits else None
    read = _read(settings, collections)
    if changed:
        _changed(settings, read, parts, weights, None if to_stdout else json, to_stdout)
        return
    runs: list[tuple[Evaluation, str | None]] = []
    for name in scorers:
        scorer, checksum = _scorer(name, weights, read, parts, either_side)
        with steps(shown=not settings.quiet) as step:
            found = run(
                scorer,
                read,
                ways=numbers,
                shots=shots,
                episodes=episodes,
                protocol=Protocol(protocol),
                splits=parts,
                progress=step,
            )
        runs.append((found, checksum))
    for skip in runs[0][0].skipped:
        settings.tell(f"note: left out: {printable(skip.reason)}")
    first, *others = ({**found.to_json(), "weights": checksum} for found, checksum in runs)
    document = {**first, "others": others}
    if to_stdout:
        write_json(document)
        return
    for place, (found, _) in enumerate(runs):
        if place:
            say()
        _say_figures(found)
    if json is not None:
        _write_document(json, document)


def _changed(
    settings: Settings,
    read: Sequence[Collection],
    parts: Splits | None,
    weights: Path | None,
    file: Path | None,
    to_stdout: bool,
) -> None:
    """Ask clips made of enrolled ones."""
    from actioncli.evaluation.changed import changed
    from actioncli.recognition.recognizer import Recognizer
    from actioncli.recognition.threshold import DEFAULT_TAU

    recognizer = Recognizer(weights)
    settings.tell("Asking clips made of the enrolled ones.")
    found = changed(recognizer, read, parts, DEFAULT_TAU)
    document = {
        "scorer": recognizer.name,
        "weights": recognizer.weights.checksum,
        "tau": DEFAULT_TAU,
        "accepted": [asdict(each) for each in found],
    }
    if to_stdout:
        write_json(document)
        return
    say(table(("queries", "accepted", "asked"), [(e.kind, e.share, e.of) for e in found]))
    if file is not None:
        _write_document(file, document)


def _numbers(ways: str | None) -> tuple[int, ...]:
    if ways is None:
        return _WAYS
    try:
        numbers = tuple(dict.fromkeys(int(word) for word in ways.split(",")))
    except ValueError:
        numbers = (0,)
    if min(numbers) < 1:
        raise UsageError(f"--ways must be numbers from 1 such as 5,10,15, not {ways!r}.")
    return numbers


def _is_document(file: Path) -> bool:
    """Whether an evaluation was written there."""
    try:
        with file.open(encoding="utf-8", errors="replace") as text:
            return text.read(100).replace(" ", "").replace("\n", "").startswith('{"scorer":')
    except OSError:
        return False


def _write_document(file: Path, document: Mapping[str, object]) -> None:
    from actioncli.files import json_text, replacing

    with replacing(file, failure=UsageError) as part:
        part.write_text(json_text(document) + "\n", encoding="utf-8")


def _read(settings: Settings, paths: Sequence[Path]) -> list[Collection]:
    from actioncli.clips.collection import read_collection
    from actioncli.clips.read import CLIP_SUFFIXES
    from actioncli.pose import VIDEO_SUFFIXES
    from actioncli.pose.read import read_any

    read = []
    for path in progress(paths, "Reading", shown=not settings.quiet):
        read.append(read_collection(path, read_any, (*CLIP_SUFFIXES, *VIDEO_SUFFIXES)))
        tell_notes(settings, path, read[-1].notes)
    return read


def _scorer(
    baseline: str | None,
    weights: Path | None,
    read: Sequence[Collection],
    parts: Splits | None,
    either_side: bool,
) -> tuple[Scorer, str | None]:
    """What is measured, and the checksum of the weights behind it."""
    from actioncli.evaluation import baselines
    from actioncli.recognition.recognizer import Recognizer

    if baseline == "always-reject":
        return baselines.AlwaysReject(), None
    if baseline == "random":
        return baselines.Random(), None
    recognizer = Recognizer(weights)
    checksum = recognizer.weights.checksum
    if baseline is None:
        return baselines.EitherSide(recognizer) if either_side else recognizer, checksum
    if baseline == "exp":
        return baselines.Exp(recognizer), checksum
    cohort = []
    if baseline == "dtw-cohort":
        if parts is None:
            raise UsageError("dtw-cohort takes its cohort from the train classes of --splits FILE.")
        cohort = baselines.cohort_clips(read, parts)
    return baselines.Dtw(recognizer.weights.config.preparation, cohort), checksum


def _say_figures(found: Evaluation) -> None:
    """Print a row for each collection and number of ways, then how far tau is a good threshold."""
    say(
        f"{found.scorer}: {found.protocol}, shots {found.shots}, episodes {found.episodes}, "
        f"tau {found.tau:g}, seed {found.seed}; mean ± standard deviation over episodes"
    )
    say()
    metrics = {
        "fsos_accuracy": "FSOS-ACC",
        "closed_set_accuracy": "closed set",
        "auroc": "AUROC",
        "oscr": "OSCR",
        "fpr_at_95_tpr": "FPR95",
    }
    rows = [
        (
            _name(result),
            ways,
            f"{result['always_reject_fsos_accuracy'].mean:.3f}",
            *(f"{result[m].mean:.3f} ± {result[m].std:.3f}" for m in metrics),
        )
        for result, ways in _merged((*found.results, *found.means))
    ]
    say(table(("collection", "ways", "reject", *metrics.values()), rows))
    say()
    say(f"Where confidence above {found.tau:g} accepts:")
    rows_at_tau = [
        (
            _name(result),
            ways,
            f"{result['false_accept_rate'].mean:.3f}",
            f"{result['false_reject_rate'].mean:.3f}",
            f"{result.reliability.ece:.3f}",
        )
        for result, ways in _merged(found.means or found.results)
    ]
    headings = ("collection", "ways", "false accepts", "false rejects", "calibration error")
    say(table(headings, rows_at_tau))


def _name(result: Result) -> str:
    return f"mean of {len(result.collections)}" if result.collections else result.collection


def _merged(results: Sequence[Result]) -> list[tuple[Result, str]]:
    """Each different result once, with its ways: `5`, or `5,10 (4)` where only 4 could be drawn.

    Numbers of ways that come down to the same one for lack of classes have the same figures.
    """
    same: dict[tuple[str, int], list[Result]] = {}
    for result in results:
        # 0 stands for several numbers: such means differ from one another
        same.setdefault((result.collection, result.ways_used or -result.ways), []).append(result)
    merged = []
    for group in same.values():
        asked = ",".join(str(result.ways) for result in group)
        fewer = any(result.ways_used not in (0, result.ways) for result in group)
        merged.append((group[0], f"{asked} ({group[0].ways_used})" if fewer else asked))
    return merged
