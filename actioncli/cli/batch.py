"""`batch`: classify archives of recordings into a table, on all cores or on a cluster."""

from __future__ import annotations

import json
import os
import time
from contextlib import closing
from dataclasses import asdict
from hashlib import sha256
from importlib.util import find_spec
from itertools import chain
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from actioncli._version import __version__
from actioncli.cli.command import Settings, command
from actioncli.cli.common import check_output, load_support
from actioncli.cli.options import ArchiveReading, TauOption, WeightsOption, file_named
from actioncli.cli.output import note, plural, printable, progress, say, write_json
from actioncli.errors import ClipError, UsageError

if TYPE_CHECKING:
    from actioncli.archives.batch import Task
    from actioncli.archives.results import Results


@command
def batch(
    settings: Settings,
    recordings: Annotated[
        Path,
        typer.Argument(
            metavar="INPUT",
            help="A folder, a pattern such as 'archive/*.mp4', a clip or a video.",
            parser=file_named,
        ),
    ],
    output: Annotated[
        Path, typer.Argument(metavar="OUTPUT.csv|.parquet", help="Where the decisions go.")
    ],
    *,
    tau: TauOption = None,
    ray: Annotated[
        str | None,
        typer.Option(
            metavar="ADDRESS",
            help="A Ray cluster that this machine belongs to, HOST:PORT or auto.  [default: "
            "processes of this machine alone, one for each core]",
            show_default=False,
        ),
    ] = None,
    weights: WeightsOption = None,
    options: ArchiveReading,
) -> None:
    """Classify archives of recordings, on all cores or a cluster.

    Decisions are those of `classify`. A file that cannot be used gets a row that says why, and
    the others are still classified. Parquet and clusters need the extra: pip install
    'actioncli[ray]'.

    Whatever ends a run, what it had found out is kept in OUTPUT.partial, and the same command
    goes on from there. Run again after that, CSV is begun anew; with Parquet, it looks at files
    that are new, that have changed in size or time of change, or that could not be used, and rows
    of files that are gone go. Decisions of another support set, tau, weights or options are not
    mixed, but refused.

    The machines of a cluster need this version of actioncli with the extra, and the recordings
    under the same paths. Who may use a cluster of Ray runs programs on it, and sees its data.

    \b
    Examples:
      actioncli batch recordings/ decisions.csv
      actioncli batch 'archive/2025-*/*.mp4' decisions.parquet --tau 0.7
      actioncli batch recordings/ decisions.parquet --ray 10.0.0.5:6379

    \b
    Columns:
      source                absolute path; rows are sorted by it
      label, accepted       the recognised action, null where the clip is rejected
      confidence, tau       that it shows the nearest action, and what this must exceed
      nearest, distance     the nearest enrolled action
      nearest_negative      distance to the nearest negative, null without
      part_start, part_end  the part that is meant, seconds
      frames, seconds       of the clip that was read
      notes                 what reading it decided on the way
      error_type, error     why the file cannot be used, else null
      size, mtime_ns        of the file when it was listed

    \b
    JSON keys:
      output, weights, tau, actions, files, done_before, accepted, rejected, failed, seconds

    The exit code is 3 where files could not be used; rejected ones do not change it.
    """
    # Files are shared by processes, which threads of their own would only disturb. Read when numpy
    # is imported.
    os.environ["OPENBLAS_NUM_THREADS"] = "1"
    from actioncli.archives.batch import Task, decide
    from actioncli.archives.results import SUFFIXES, Results, storable
    from actioncli.recognition.recognizer import Recognizer

    if output.suffix.lower() not in SUFFIXES:
        raise UsageError(f"{output}: tables are written as {' or '.join(SUFFIXES)}.")
    for asked, package in ((output.suffix.lower() == ".parquet", "pyarrow"), (ray, "ray")):
        if asked and not find_spec(package):
            raise UsageError(f"this needs {package}: pip install 'actioncli[ray]'.")
    check_output(output)
    recognizer = Recognizer(weights)
    with settings.open_store() as store:
        task = Task(load_support(settings, store, recognizer, tau), options)
    basis = {"INPUT": storable(str(recordings.absolute())), **_basis(task)}

    begun = time.monotonic()
    with Results.opened(output, basis) as results:
        _list(recordings, output, results)
        before = results.count()
        settings.tell(f"{plural(before['files'], 'file')}, {before['done']} of them done before")
        left = before["files"] - before["done"]
        decided = decide(task, results)
        if ray is not None and left:
            from actioncli.archives.cluster import decide_on_cluster

            decided = decide_on_cluster(task, results, ray)
        try:
            with closing(decided) as rows:
                for row in progress(rows, "Classifying", total=left, shown=not settings.quiet):
                    results.add(row)
                    if row.get("error") is not None:
                        note(f"error: {printable(row['error'])}")
        except KeyboardInterrupt:
            kept = results.count()
            settings.tell(
                f"{kept['done']} of {plural(kept['files'], 'file')} are kept; the same command "
                "goes on."
            )
            raise
        found = results.count()
        results.finish()
    seconds = time.monotonic() - begun
    counts = {name: found[name] for name in ("accepted", "rejected", "failed")}
    if settings.json:
        made = {
            "output": str(output),
            "weights": recognizer.weights.checksum,
            "tau": task.support.threshold.tau,
            "actions": len(task.support.actions),
            "files": found["files"],
            "done_before": before["done"],
        }
        write_json({**made, **counts, "seconds": seconds})
    else:
        outcome = ", ".join(f"{count} {name}" for name, count in counts.items())
        say(f"{printable(output)}: {plural(found['files'], 'file')}, {outcome} ({seconds:.0f} s)")
    if found["failed"]:
        raise typer.Exit(ClipError.exit_code)


def _basis(task: Task) -> dict[str, str]:
    """What decisions depend on, by the names under which a change of it is told."""
    support = task.support
    digest = sha256(support.negatives.tobytes())
    for label, embeddings in support.actions.items():
        digest.update(json.dumps([label, embeddings.shape]).encode())
        digest.update(embeddings.tobytes())
    digest.update(json.dumps(list(support.durations.values())).encode())
    tau = {"": support.threshold.tau, **support.threshold.actions}
    options = {
        name: value
        for name, value in asdict(task.options).items()
        if value is not None and name != "cache"
    }
    return {
        "version of actioncli": __version__,
        "weights": support.recognizer.weights.checksum,
        "support set": digest.hexdigest(),
        "tau": json.dumps(tau, sort_keys=True),
        "options": json.dumps(options, sort_keys=True),
    }


def _list(recordings: Path, output: Path, results: Results) -> None:
    """Look for the files that INPUT names; the table, where it stands among them, is none.

    Raises:
        ClipError: there are none.
    """
    from actioncli.clips.read import CLIP_SUFFIXES, walk_clips
    from actioncli.pose import VIDEO_SUFFIXES

    path = recordings.absolute()
    own = {f"{output.absolute()}{more}" for more in ("", ".partial", ".partial-wal")}
    found = walk_clips(path, (*CLIP_SUFFIXES, *VIDEO_SUFFIXES))
    listed = (each for each in found if str(each) not in own)
    first = next(listed, None)
    if first is None or (first == path and not path.is_file()):
        what = "there are no clips or videos in it" if path.is_dir() else "no such file"
        raise ClipError(f"{recordings}: {what}.")
    results.set_files(chain([first], listed))
