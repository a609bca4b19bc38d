"""`classify`: say which action a clip shows, or that it shows none."""

from __future__ import annotations

import functools
import os
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import closing
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from actioncli.cli.command import Settings, command
from actioncli.cli.common import load_support, tell_notes
from actioncli.cli.explain import check_explanation, explain_decision
from actioncli.cli.options import (
    ClipArguments,
    ClipReading,
    TauOption,
    WeightsOption,
    checked_tau,
)
from actioncli.cli.output import (
    error_entry,
    printable,
    progress,
    say,
    steps,
    table,
    write_json,
)
from actioncli.cli.processes import cores, in_processes
from actioncli.cli.reading import named_clips, or_error, report_bad_clip, sharing
from actioncli.cli.video import check_annotation, write_annotation
from actioncli.errors import ClipError

if TYPE_CHECKING:
    from actioncli.clips.clip import Clip
    from actioncli.pose.poses import Poses
    from actioncli.recognition.decision import Decision

# Files of joints that are classified together, at most.
_BATCH = 64


@command
def classify(
    settings: Settings,
    clips: ClipArguments,
    *,
    tau: TauOption = None,
    top: Annotated[int, typer.Option(metavar="N", min=0, help="Length of the ranking.")] = 5,
    weights: WeightsOption = None,
    reading: ClipReading,
    explain: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE.html",
            help="Write a page that shows why one clip is accepted or rejected.",
            show_default=False,
        ),
    ] = None,
    annotate: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE.mp4", help="Write the video with skeleton, label and confidence drawn."
        ),
    ] = None,
) -> None:
    """Name the action that clips show, or reject them.

    The nearest action is accepted if its confidence is above the threshold tau. Beside it stand
    the N nearest actions with their distance, their probability among all enrolled actions, and
    the confidence that the clip shows them whatever else is enrolled. A clip that is nearer to a
    negative (`enroll --negative`) than to every action is rejected, whatever its confidence. A
    clip that cannot be used is reported, and the others are still classified.

    In a clip that lasts 1.5 times as long as the enrolled ones or longer, windows of about their
    length compete with the whole; the part that shows an action best is told.

    \b
    Examples:
      actioncli classify query.mp4
      actioncli classify query.mp4 --annotate seen.mp4
      actioncli classify query.mp4 --explain why.html
      actioncli classify recordings/ --tau 0.7 --top 3
      actioncli classify 'day2/*.npy' --json

    \b
    JSON keys:
      tau, actions, clips, accepted, rejected, failed
      clips[]: source, label, accepted, confidence, tau, nearest, nearest_negative, ranking
      clips[]: part, ms, notes, error
      clips[].part: start, end
      clips[].ranking[]: label, distance, probability, confidence
      clips[].error: type, message, exit_code
    """
    # Many files are shared by processes, which threads of their own would only disturb, and single
    # matrices are small. Read when numpy is imported.
    os.environ["OPENBLAS_NUM_THREADS"] = "1"
    from actioncli.recognition.recognizer import Recognizer

    if tau is not None:
        checked_tau(tau)
    if annotate is not None:
        check_annotation(clips, annotate, reading.metrabs is not None)
    if explain is not None:
        check_explanation(clips, explain)
    recognizer = Recognizer(weights)
    with settings.open_store() as store:
        support = load_support(settings, store, recognizer, tau)
    # Where --start or --end name the part, no other is looked for.
    cut_out = reading.start is not None or reading.end is not None

    entries: list[dict[str, object]] = []
    failed = rejected = 0
    streams = not settings.json and sys.stdout.isatty()
    paths = named_clips(clips)

    def decide(clips: Sequence[Clip]) -> list[Decision]:
        # One clip can last hours; of many, their number shows how far the work is.
        with steps(shown=len(paths) == 1 and not settings.quiet) as step:
            compared = None if step is None else functools.partial(step, "Comparing")
            return support.classify_all(clips, cut_out, compared)

    seen: dict[Path, Poses] = {}

    def read(path: Path, shown: bool) -> Clip:
        if annotate is None:
            return reading.read(path, shown)
        from actioncli.pose.video import clip_of

        # The video is looked at once, for the decision and for the drawing.
        seen[path] = reading.poses(path)
        return clip_of(seen[path], path, whole=cut_out)

    shown = not (streams or settings.quiet)
    drawn = annotate is not None or explain is not None
    together = sharing(paths, reading.metrabs)
    for path, outcome, milliseconds in _decided(paths, read, decide, together, shown, drawn):
        if isinstance(outcome, ClipError):
            failed += 1
            report_bad_clip(outcome)
            entries.append({"source": str(path), "error": error_entry(outcome, outcome.exit_code)})
            continue
        clip, decision = outcome
        if annotate is not None:
            write_annotation(path, annotate, seen[path], decision, shown=reading.shown)
        if explain is not None and clip is not None:
            explain_decision(settings, recognizer, clip, decision, explain)
        rejected += not decision.accepted
        if settings.json:
            told = {"source": str(path), "ms": milliseconds}
            entries.append({**told, **decision.to_json(top)})
        else:
            tell_notes(settings, path, decision.notes)
            _print(str(path), decision, 0 if settings.quiet else top, milliseconds)
    if settings.json:
        write_json(
            {
                "tau": support.threshold.tau,
                "actions": len(support.actions),
                "clips": entries,
                "accepted": len(entries) - rejected - failed,
                "rejected": rejected,
                "failed": failed,
            }
        )
    if failed:
        raise typer.Exit(ClipError.exit_code)
    if rejected:
        raise typer.Exit(1)


def _decided(
    paths: Sequence[Path],
    read: Callable[[Path, bool], Clip],
    decide: Callable[[Sequence[Clip]], list[Decision]],
    together: int,
    shown: bool,
    with_clip: bool,
) -> Iterator[tuple[Path, tuple[Clip | None, Decision] | ClipError, float]]:
    """Read and decide, many files of joints at a time, in as many processes as there are cores.

    Args:
        read: reads a clip; the second argument says whether a video may show how far it is read.
        together: in how many processes to read videos.
        shown: whether to show a progress bar; a video that is read alone has one of its own.
        with_clip: whether the clips are wanted too, which are large to hand on.

    Returns:
        Path, clip and decision (or what is wrong), and its share of the time, milliseconds.
    """
    from actioncli.pose.media import is_video

    videos = any(map(is_video, paths))
    processes = together if videos else cores()
    size = 1 if videos else min(_BATCH, -(-len(paths) // processes) or 1)
    one_by_one = videos and processes == 1
    batches = [paths[at : at + size] for at in range(0, len(paths), size)]

    def of_batch(number: int) -> tuple[list[tuple[Clip | None, Decision] | ClipError], float]:
        begun = time.perf_counter()
        outcomes = [or_error(lambda path: read(path, one_by_one), path) for path in batches[number]]
        clips = [clip for clip in outcomes if not isinstance(clip, ClipError)]
        decisions: list[Decision | ClipError]
        try:
            decisions = [*decide(clips)] if clips else []
        except ClipError:
            # One of them lacks joints; the others are not to suffer for it.
            decisions = [or_error(lambda clip: decide([clip])[0], clip) for clip in clips]
        decided = iter(decisions)
        found: list[tuple[Clip | None, Decision] | ClipError] = []
        for clip in outcomes:
            if isinstance(clip, ClipError):
                found.append(clip)
                continue
            decision = next(decided)
            if not isinstance(decision, ClipError):
                found.append((clip if with_clip else None, decision))
            else:
                found.append(decision)
        return found, (time.perf_counter() - begun) * 1e3 / len(outcomes)

    results = in_processes(of_batch, len(batches), processes, pinned=videos)
    with closing(results):
        for batch in progress(batches, "Classifying", shown=shown and not one_by_one):
            outcomes, milliseconds = next(results)
            for path, outcome in zip(batch, outcomes, strict=True):
                yield path, outcome, milliseconds


def _print(source: str, decision: Decision, top: int, milliseconds: float) -> None:
    sign = ">" if decision.confidence > decision.tau else "<="
    but = ", but a negative is nearer" if decision.negative_is_nearer else ""
    say(
        f"{printable(source)}: "
        f"{'rejected' if decision.label is None else printable(decision.label)}"
        f"  (nearest {printable(decision.nearest)}, confidence {decision.confidence:.2f} "
        f"{sign} tau {decision.tau:.2f}{but}, {milliseconds:.0f} ms)"
    )
    if top:
        rows = [
            (ranked.label, ranked.distance, ranked.probability, ranked.confidence)
            for ranked in decision.ranking[:top]
        ]
        say(table(("action", "distance", "probability", "confidence"), rows, indent="    "))
