"""`classify`: say which action a clip shows, or that it shows none."""

from __future__ import annotations

import functools
import os
import shlex
import sys
import time
from collections.abc import Iterator, Sequence
from contextlib import closing
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from actioncli.archives.processes import cores, in_processes
from actioncli.cli.answer import event_line, is_close, line_of, notes_of, short_names, verdict_width
from actioncli.cli.command import Settings, command
from actioncli.cli.common import check_output, load_support
from actioncli.cli.options import (
    ClipArguments,
    ClipReading,
    ForceOption,
    TauOption,
    WeightsOption,
)
from actioncli.cli.output import printable, progress, say, steps, table, write_json
from actioncli.cli.reading import report_bad_clip, sharing
from actioncli.cli.video import check_annotation, video_progress, write_annotation
from actioncli.errors import ClipError, UsageError
from actioncli.pose import ReadOptions
from actioncli.pose.read import find_any, is_video, read_with_poses

if TYPE_CHECKING:
    from actioncli.clips.clip import Clip
    from actioncli.live.events import Event
    from actioncli.pose.poses import Poses
    from actioncli.recognition.decision import Decision
    from actioncli.recognition.support import SupportSet

# Files of joints that are classified together, at most.
_BATCH = 64
# Actions that are ranked where no number is given.
_RANKED = 5
# Examples of an action that are read to say what a rejected clip lacks: more take long.
_MOST_EXPLAINED = 100


@command
def classify(
    settings: Settings,
    clips: ClipArguments,
    *,
    tau: TauOption = None,
    top: Annotated[
        int | None,
        typer.Option(
            metavar="N",
            min=0,
            help="Show the N nearest actions.  [default: 5 in JSON, else where it was close]",
        ),
    ] = None,
    weights: WeightsOption = None,
    options: ClipReading,
    explain: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE.html",
            help="Write a page that shows why one clip is accepted or rejected.",
        ),
    ] = None,
    annotate: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE.mp4", help="Write the video with skeleton, label and confidence drawn."
        ),
    ] = None,
    force: ForceOption = False,
) -> None:
    """Name the action that clips show, or reject them.

    The nearest action is accepted if its confidence is above the threshold tau: on the line of a
    clip stand the verdict, a bar with a mark at tau, both numbers, and where in the clip it was.
    With --top, or where another action came close, the nearest actions follow with their
    distance, their probability among all enrolled actions, and the confidence that the clip shows
    them whatever else is enrolled. Of one clip that is rejected, it is told what would have had to
    be alike. A clip that is nearer to a negative (`enroll --negative`) than to every action is
    rejected, whatever its confidence. A clip that cannot be used is reported, and the others are
    still classified.

    In a clip that lasts 1.5 times as long as the enrolled ones or longer, windows of about their
    length compete with the whole; the part that shows an action best is told, and below it all
    that is done in the clip, as `watch` would tell it.

    \b
    Examples:
      actioncli classify query.mp4
      actioncli classify query.mp4 --annotate seen.mp4
      actioncli classify query.mp4 --explain why.html
      actioncli classify recordings/ --tau 0.7 --top 3
      actioncli classify 'day2/*.mp4' --json

    \b
    JSON keys:
      tau, actions, weights, clips, accepted, rejected, failed
      clips[]: source, label, accepted, confidence, tau, nearest, nearest_negative, ranking
      clips[]: part, parts, ms, notes, error
      clips[].part: start, end
      clips[].parts[]: label, start, end, confidence, repetitions
      clips[].ranking[]: label, distance, probability, confidence
      clips[].error: type, message, exit_code
    """
    # Many files are shared by processes, which threads of their own would only disturb, and single
    # matrices are small. Read when numpy is imported.
    os.environ["OPENBLAS_NUM_THREADS"] = "1"
    from actioncli.live.events import sets_of
    from actioncli.recognition.recognizer import Recognizer

    paths = find_any(clips)
    if annotate is not None:
        check_annotation(paths, annotate, options.metrabs is not None)
        check_output(annotate, paths, force)
    if explain is not None:
        from actioncli.report.explanation import check_page

        check_page(explain)
        if len(paths) != 1:
            raise UsageError("--explain tells about one clip: name one file, and no other.")
        check_output(explain, paths, force)
    recognizer = Recognizer(weights)
    with settings.open_store() as store:
        support = load_support(settings, store, recognizer, tau)

    # Clip and poses that were read last, of which pictures are made: a video is looked at once.
    kept: list[Any] = []
    entries: list[dict[str, object]] = []
    failed = rejected = 0
    names, width = short_names(paths), verdict_width(support.actions)
    with notes_of(settings, names) as add_notes:
        decided = _decided(settings, paths, options, kept, support)
        for path, decision, events, milliseconds in decided:
            if isinstance(decision, ClipError):
                failed += 1
                entries.append(report_bad_clip(path, decision))
                continue
            rejected += not decision.accepted
            if settings.json:
                ranked = decision.to_json(_RANKED if top is None else top)
                parts = [event.to_json() for event in events]
                told = {"parts": parts, "ms": milliseconds}
                entries.append({"source": str(path), **ranked, **told})
            else:
                say(line_of(decision, names[path], width))
                if not settings.quiet:
                    for event in sets_of(events):
                        say(f"    {event_line(event)}")
                    close = _RANKED if is_close(decision) else 0
                    _print_ranking(decision, close if top is None else top)
                    if len(paths) == 1 and not decision.accepted:
                        _advise(settings, support, path, kept[0], decision)
                add_notes(path, decision.notes)
            if annotate is not None:
                write_annotation(path, annotate, kept[1], decision, shown=not settings.quiet)
                settings.tell(f"drawn in {printable(annotate)}")
            if explain is not None:
                _explain(settings, support, kept[0], decision, explain)
    if settings.json:
        enrolled = {"tau": support.threshold.tau, "actions": len(support.actions)}
        used = {"weights": recognizer.weights.checksum}
        accepted = len(entries) - rejected - failed
        counts = {"accepted": accepted, "rejected": rejected, "failed": failed}
        write_json({**enrolled, **used, "clips": entries, **counts})
    if failed:
        raise typer.Exit(ClipError.exit_code)
    if rejected:
        raise typer.Exit(1)


def _decided(
    settings: Settings,
    paths: Sequence[Path],
    options: ReadOptions,
    kept: list[Any],
    support: SupportSet,
) -> Iterator[tuple[Path, Decision | ClipError, list[Event], float]]:
    """Read and decide, many files of joints at a time, in as many processes as there are cores.

    Args:
        kept: gets the clip and the poses of a file that is read here, and not in a process.

    Returns:
        Path, decision or what is wrong, what is done in a long clip, and its share of the time,
        milliseconds.
    """
    from actioncli.live.watching import events_in

    videos = any(map(is_video, paths))
    processes = sharing(paths, options) if videos else cores()
    size = 1 if videos else min(_BATCH, -(-len(paths) // processes) or 1)
    batches = [paths[at : at + size] for at in range(0, len(paths), size)]
    # On a terminal, lines of text tell how far the work is; a video that is read alone has a bar.
    one_by_one = videos and processes == 1
    shown = not settings.quiet and (settings.json or not sys.stdout.isatty())

    def read(path: Path) -> tuple[Clip | ClipError, Poses | None]:
        shown = one_by_one and not settings.quiet
        try:
            with video_progress(path, shown=shown and is_video(path)) as report:
                kept[:] = read_with_poses(path, options, report)
        except ClipError as unusable:
            return unusable, None
        return kept[0], kept[1]

    def decide(clips: list[Clip]) -> list[Decision | ClipError]:
        try:
            # One clip can last hours; of many, their number shows how far the work is.
            with steps(shown=len(paths) == 1 and not settings.quiet) as step:
                bar = None if step is None else functools.partial(step, "Comparing")
                return [*support.classify_all(clips, options.whole, bar)]
        except ClipError as unusable:
            if len(clips) == 1:
                return [unusable]
            # One of them lacks joints, and the others are not to suffer for it.
            return [decision for clip in clips for decision in decide([clip])]

    def all_in(path: Path, clip: Clip | ClipError, poses: Poses | None) -> list[Event]:
        if options.whole or isinstance(clip, ClipError):
            return []
        if poses is None:
            return events_in(clip, support)
        from actioncli.pose.video import clip_of

        # Of a video, a clip is the part that shows one repetition.
        return events_in(clip_of(poses, path, whole=True), support)

    def of_batch(number: int) -> tuple[list[Decision | ClipError], list[list[Event]], float]:
        begun = time.perf_counter()
        found = [read(path) for path in batches[number]]
        clips = [clip for clip, _ in found]
        decisions = iter(decide([clip for clip in clips if not isinstance(clip, ClipError)]))
        outcomes = [clip if isinstance(clip, ClipError) else next(decisions) for clip in clips]
        events = [all_in(path, *one) for path, one in zip(batches[number], found, strict=True)]
        return outcomes, events, (time.perf_counter() - begun) * 1e3 / len(outcomes)

    results = in_processes(of_batch, len(batches), processes, pinned=videos)
    with closing(results):
        for number in progress(range(len(batches)), "Classifying", shown=shown and not one_by_one):
            outcomes, events, milliseconds = next(results)
            for path, outcome, told in zip(batches[number], outcomes, events, strict=True):
                yield path, outcome, told, milliseconds


def _explain(
    settings: Settings, support: SupportSet, clip: Clip, decision: Decision, page: Path
) -> None:
    """Write the page that shows why.

    Raises:
        UsageError: it cannot be written.
        SupportError: the action was removed meanwhile.
    """
    from actioncli.recognition.explanation import explain_decision
    from actioncli.report.explanation import SHOWN, Explained, Neighbour, write_explanation

    recognizer = support.recognizer
    with settings.open_store() as store:
        found, clip = explain_decision(recognizer, store, clip, decision)
        shown = [store.examples(decision.nearest)[found.example]]
        shown += [store.examples(each.label)[0] for each in decision.ranking[1:SHOWN]]
        named = [(each, f"example {each.id}, {each.source}") for each in shown]
        neighbours = [Neighbour(each.label, text, store.clip(each.id)) for each, text in named]
    case = Explained(clip, decision, found, recognizer.weights.config.preparation)
    write_explanation(page, case, neighbours)
    settings.tell(f"explained in {printable(page)}")


def _advise(
    settings: Settings, support: SupportSet, path: Path, clip: Clip, decision: Decision
) -> None:
    """Say of a rejected clip what would have had to be alike, and what can be done next."""
    from actioncli.model.config import PartsConfig
    from actioncli.recognition.explanation import explain_decision

    if decision.negative_is_nearer:
        settings.tell("It is nearer to what you enrolled with --negative than to every action.")
        return
    recognizer = support.recognizer
    # In a window the number of windows counts too, which no part can make up for.
    whole = decision.part == (clip.start, clip.start + clip.duration)
    few = len(support.actions[decision.nearest]) <= _MOST_EXPLAINED
    if isinstance(recognizer.weights.config, PartsConfig) and whole and few:
        with settings.open_store() as store:
            lacking = explain_decision(recognizer, store, clip, decision)[0].lacking(decision.tau)
        settings.tell(f"{lacking[0].upper()}{lacking[1:]}.")
    file, label = (shlex.quote(printable(each)) for each in (path, decision.nearest))
    settings.tell(
        f"If it is the same to you: actioncli enroll {label} {file}\n"
        f"To see why: actioncli classify {file} --explain why.html"
    )


def _print_ranking(decision: Decision, top: int) -> None:
    if top:
        columns = ("distance", "probability", "confidence")
        ranked = decision.ranking[:top]
        rows = [(each.label, *(getattr(each, name) for name in columns)) for each in ranked]
        say(table(("action", *columns), rows, indent="    "))
