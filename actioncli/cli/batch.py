"""`batch`: classify archives of recordings into a Parquet file, on all cores or on a cluster."""

from __future__ import annotations

import contextlib
import json
import sys
import time
from collections.abc import Callable, Iterator
from hashlib import sha256
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from actioncli.cli.common import (
    FpsOption,
    LayoutOption,
    Settings,
    UnitOption,
    UpOption,
    WeightsOption,
    checked_tau,
    command,
    stored_negatives,
    used_threshold,
)
from actioncli.cli.output import note, number, plural, printable, say, write_json
from actioncli.cli.video import CacheOption, PersonOption, QualityOption, checked_quality
from actioncli.errors import ClipError, SupportError, UsageError

if TYPE_CHECKING:
    import pyarrow as pa

    from actioncli.batch import Task

# Rows are on the disk at the latest so many seconds after they have come back.
_SAVE_SECONDS = 5.0
# Seconds between lines where standard error is a file.
_LOG_SECONDS = 30.0


@command
def batch(
    settings: Settings,
    recordings: Annotated[
        Path,
        typer.Argument(
            metavar="INPUT",
            help="A folder, a pattern such as 'archive/*.mp4', a clip or video, or a list: a .txt "
            "file with a path on each line, relative to the list's folder.",
        ),
    ],
    output: Annotated[
        Path, typer.Argument(metavar="OUTPUT.parquet", help="Where the decisions go.")
    ],
    tau: Annotated[
        float | None,
        typer.Option(
            metavar="0..1",
            help="Accept where the confidence is above it.  [default: the calibrated one, "
            "else 0.5]",
            show_default=False,
        ),
    ] = None,
    ray: Annotated[
        str | None,
        typer.Option(
            metavar="ADDRESS",
            help="A Ray cluster that this machine belongs to, HOST:PORT or auto.  [default: "
            "processes of this machine]",
            show_default=False,
        ),
    ] = None,
    workers: Annotated[
        int | None,
        typer.Option(
            metavar="N", min=1, help="Processes on this machine.  [default: one for each core]"
        ),
    ] = None,
    restart: Annotated[
        bool, typer.Option("--restart", help="Forget what OUTPUT holds and begin anew.")
    ] = False,
    weights: WeightsOption = None,
    layout: LayoutOption = None,
    unit: UnitOption = None,
    up: UpOption = None,
    fps: FpsOption = None,
    quality: QualityOption = None,
    person: PersonOption = None,
    cache: CacheOption = True,
) -> None:
    """Classify archives of clips and videos, on all cores or on a cluster.

    Needs the extra: pip install 'actioncli[ray]'. Decisions are those of `classify`. Given the
    same OUTPUT again, only files are looked at that are new or have changed in size or time of
    change; rows of other files stay. A file that cannot be used gets a row that says why, and
    the others are still classified. Whatever ends a run, what it had found out is kept, in
    OUTPUT.parts until the next run ends.

    The machines of a cluster need this version of actioncli with the extra, and the recordings
    under the same paths.

    \b
    Examples:
      actioncli batch recordings/ decisions.parquet
      actioncli batch 'archive/2025-*/*.mp4' decisions.parquet --tau 0.7
      actioncli batch list.txt decisions.parquet --ray 10.0.0.5:6379

    \b
    Columns:
      source, label (null: rejected), accepted, confidence, tau, nearest, distance
      nearest_negative, part_start, part_end, frames, seconds, notes, error_type, error
      weights, ms, size, mtime_ns

    \b
    JSON keys:
      output, weights, tau, actions, clips, done_before, accepted, rejected, failed
      seconds, clips_per_second

    The exit code is 3 where files could not be used; rejected ones do not change it.
    """
    _check_extra()
    if tau is not None:
        checked_tau(tau)
    network = None if quality is None else checked_quality(quality)
    if ray is not None and workers is not None:
        raise UsageError("--workers is for this machine; the cluster of --ray has its own.")
    given = {"layout": layout, "unit": unit, "up": up, "fps": fps}
    given |= {"quality": network, "person": person}
    task = _task(settings, weights, tau, {k: v for k, v in given.items() if v is not None})
    basis = _basis(task)
    task.options["cache"] = cache
    sources = _sources(recordings)

    from actioncli.batch import decide, joined_ray
    from actioncli.batch_results import Results, State
    from actioncli.claims import claimed

    begun = time.monotonic()
    with claimed(output, "batch", UsageError):
        results = Results.open(output, basis, restart)
        missing = results.missing({source: State.of(source) for source in sources})
        settings.tell(
            f"{plural(len(sources), 'file')}, {len(sources) - len(missing)} of them done before"
        )
        saved = time.monotonic()

        def take(rows: pa.Table) -> None:
            nonlocal saved
            results.add(rows)
            for error in filter(None, rows["error"].to_pylist()):
                note(f"error: {printable(error)}")
            if time.monotonic() - saved > _SAVE_SECONDS:
                results.save()
                saved = time.monotonic()
            advance(len(rows))

        try:
            if missing:
                with joined_ray(ray, workers), _progress(settings, len(missing)) as advance:
                    decide(task, missing, take)
        finally:
            results.save()
        results.finish()
    seconds = time.monotonic() - begun
    rows = results.rows(sources)
    failed = len(rows) - rows["error"].null_count
    accepted = sum(filter(None, rows["accepted"].to_pylist()))
    rejected = len(rows) - failed - accepted
    rate = len(missing) / seconds
    if settings.json:
        write_json(
            {
                "output": str(output),
                "weights": task.weights.checksum,
                "tau": number(task.threshold.tau),
                "actions": len(task.support),
                "clips": len(sources),
                "done_before": len(sources) - len(missing),
                "accepted": accepted,
                "rejected": rejected,
                "failed": failed,
                "seconds": number(seconds),
                "clips_per_second": number(rate),
            }
        )
    else:
        say(
            f"{printable(output)}: {plural(len(sources), 'file')}, {accepted} accepted, "
            f"{rejected} rejected, {failed} failed; {len(missing)} of them now, "
            f"{rate:.1f} a second"
        )
    if failed:
        raise typer.Exit(ClipError.exit_code)


def _check_extra() -> None:
    if not (find_spec("ray") and find_spec("pyarrow")):
        raise UsageError("batch needs Ray Data: pip install 'actioncli[ray]'.")


def _task(
    settings: Settings, weights: Path | None, tau: float | None, options: dict[str, object]
) -> Task:
    from actioncli.batch import Task
    from actioncli.recognizer import Recognizer

    recognizer = Recognizer(weights)
    with settings.open_store() as store:
        support = store.embeddings(recognizer.weights.checksum, recognizer.embed)
        negatives = stored_negatives(store, recognizer)
        threshold = used_threshold(settings, store, recognizer, tau)
        actions = store.actions()
    if not support:
        raise SupportError(
            "the support set is empty; enrol an action first: actioncli enroll LABEL CLIP"
        )
    durations = [each.seconds / each.examples for each in actions if not each.negative]
    return Task(recognizer.weights, support, negatives, threshold, durations, options)


def _basis(task: Task) -> dict[str, str]:
    """What decisions depend on, by the names under which a change of it is told."""
    digest = sha256(task.negatives.tobytes())
    for label, embeddings in task.support.items():
        digest.update(json.dumps([label, embeddings.shape]).encode())
        digest.update(embeddings.tobytes())
    digest.update(json.dumps(list(task.durations)).encode())
    tau = {"": task.threshold.tau, **task.threshold.actions}
    return {
        "weights": task.weights.checksum,
        "support set": digest.hexdigest(),
        "tau": json.dumps(tau, sort_keys=True),
        "options": json.dumps(dict(task.options), sort_keys=True),
    }


def _sources(recordings: Path) -> list[str]:
    """The files that INPUT names, as absolute paths."""
    from actioncli.clips.read import CLIP_SUFFIXES, find_clips
    from actioncli.pose import VIDEO_SUFFIXES

    if recordings.suffix.lower() == ".txt" and recordings.is_file():
        try:
            lines = recordings.read_text(encoding="utf-8").splitlines()
        except (OSError, UnicodeDecodeError) as error:
            raise ClipError(f"{recordings}: cannot be read as a list of files: {error}.") from error
        named = [recordings.parent / line for line in lines if line.strip()]
    else:
        named = [recordings]
    found = find_clips(named, (*CLIP_SUFFIXES, *VIDEO_SUFFIXES))
    if not found or (found == [recordings] and not recordings.is_file()):
        what = "there are no clips or videos in it" if recordings.is_dir() else "no such file"
        raise ClipError(f"{recordings}: {what}.")
    return list(dict.fromkeys(str(path.absolute()) for path in found))


@contextlib.contextmanager
def _progress(settings: Settings, total: int) -> Iterator[Callable[[int], None]]:
    """Tell how many files are done: a bar on a terminal, a line every half minute in a log."""
    done, begun = 0, time.monotonic()
    told = begun
    if settings.quiet:
        yield lambda _: None
        return
    if sys.stderr.isatty():
        from rich.console import Console
        from rich.progress import BarColumn, MofNCompleteColumn, TextColumn, TimeRemainingColumn
        from rich.progress import Progress as Bar

        with Bar(
            TextColumn("Classifying"),
            BarColumn(),
            MofNCompleteColumn(),
            TextColumn("{task.fields[rate]:.1f} a second"),
            TimeRemainingColumn(),
            console=Console(stderr=True),
            transient=True,
            redirect_stdout=False,
        ) as bar:
            task = bar.add_task("", total=total, rate=0.0)

            def move(count: int) -> None:
                nonlocal done
                done += count
                bar.update(task, completed=done, rate=done / (time.monotonic() - begun))

            yield move
        return

    def log(count: int) -> None:
        nonlocal done, told
        done += count
        now = time.monotonic()
        if now - told > _LOG_SECONDS:
            told, rate = now, done / (now - begun)
            left = (total - done) / rate / 60
            note(f"{done}/{total} files  {rate:.1f} a second  {left:.0f} min left")

    yield log
