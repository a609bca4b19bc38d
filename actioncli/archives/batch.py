"""Recordings by the thousand: a `Recognizer` as a stage of a Ray Data pipeline.

The files are divided into small blocks. Each worker, a process on one core of this machine or of
a cluster, reads a block's files and decides as `classify` does; rows come back in any order. A
worker that dies is replaced and its block done again. Needs the extra `ray`.
"""

from __future__ import annotations

import warnings
from collections.abc import Generator, Iterator, Sequence
from dataclasses import dataclass, field

import pyarrow as pa

from actioncli._version import __version__
from actioncli.archives.results import SCHEMA, Results, Row, file_named, storable
from actioncli.errors import ActionCliError, ClipError, UsageError
from actioncli.pose.read import ReadOptions, read_any
from actioncli.recognition.support import SupportSet

# Files of one pipeline: what is in memory at once. Starting workers for the next takes seconds.
_WINDOW = 50_000
# Files of a block, which are begun anew where their worker dies.
_BLOCK = 8
# How often that happens before the files are tried one by one, and then given up.
_RETRIES = 2


@dataclass(frozen=True, slots=True, eq=False)
class Task:
    """What decisions depend on; everything a worker needs.

    Attributes:
        support: what is enrolled.
        options: how to read files.
        version: of the actioncli that asks; one worker of another could decide otherwise.
    """

    support: SupportSet
    options: ReadOptions = field(default_factory=ReadOptions)
    version: str = __version__


class Stage:
    """A worker: paths in, rows out."""

    def __init__(self, task: Task) -> None:
        """Take the task.

        Raises:
            UsageError: this machine has another version of actioncli.
        """
        if task.version != __version__:
            raise UsageError(f"a machine of the cluster has actioncli {__version__}")
        self._task = task

    def __call__(self, batch: pa.Table) -> Iterator[pa.Table]:
        """Decide about the files in the column `source`: for each a table of one row, which
        comes back at once."""
        for source in batch["source"].to_pylist():
            yield pa.Table.from_pylist([self.row(source)], SCHEMA)

    def row(self, source: str) -> Row:
        """What a file shows, or why that cannot be told; see `batch_results.SCHEMA`."""
        task = self._task
        try:
            clip = read_any(file_named(source), task.options)
            decision = task.support.classify(clip)
        except ActionCliError as error:
            return _failed(source, type(error).__name__, str(error))
        except Exception as error:  # noqa: BLE001 - one file, whatever it does, ends no archive
            return _failed(source, type(error).__name__, f"{source}: {error} (this is a bug)")
        start, end = decision.part or (None, None)
        return {
            "source": source,
            "label": decision.label,
            "accepted": decision.accepted,
            "confidence": decision.confidence,
            "tau": decision.tau,
            "nearest": decision.nearest,
            "distance": decision.ranking[0].distance,
            "nearest_negative": decision.nearest_negative,
            "part_start": start,
            "part_end": end,
            "frames": len(clip),
            "seconds": clip.duration,
            "notes": [storable(each) for each in decision.notes],
        }


def _failed(source: str, kind: str, message: str) -> Row:
    return {"source": source, "error_type": kind, "error": storable(" ".join(message.split()))}


def decide(task: Task, results: Results) -> Generator[Row, None, None]:
    """Classify the files whose rows are missing, on the Ray that is joined; see `ray_session`.

    The files of a block whose workers keep dying are done one by one, and a file whose workers
    keep dying gets a row that says so.

    Args:
        task: what to decide by.
        results: they are to be given each row before the next one is asked for.

    Raises:
        UsageError: the pipeline cannot run.
    """
    for block in (_BLOCK, 1):
        for window in _windows(results):
            yield from _rows(task, window, block)
    died = f"the process that read it died, {_RETRIES + 1} times in a row."
    for window in _windows(results):
        for source in window:
            yield _failed(source, ClipError.__name__, f"{source}: {died}")


def _windows(results: Results) -> Iterator[list[str]]:
    after = ""
    while window := results.missing(_WINDOW, after):
        yield window
        after = window[-1]


def _rows(task: Task, sources: Sequence[str], most: int) -> Iterator[Row]:
    import ray
    from ray.data import ActorPoolStrategy
    from ray.util.annotations import RayDeprecationWarning

    cores = max(1, int(ray.cluster_resources().get("CPU", 1)))
    # A few files are spread over all workers.
    size = max(1, min(most, len(sources) // (2 * cores)))
    blocks = [pa.table({"source": sources[at : at + size]}) for at in range(0, len(sources), size)]
    workers = min(cores, len(blocks))
    with warnings.catch_warnings():
        # `max_task_retries` is to go in Ray 2.64, which pyproject.toml excludes. Without it a file
        # that kills its worker is tried for ever.
        warnings.simplefilter("ignore", RayDeprecationWarning)
        pipeline = ray.data.from_arrow(blocks).map_batches(
            Stage,
            fn_constructor_args=(task,),
            batch_size=None,
            batch_format="pyarrow",
            # Where other work holds cores of the cluster, it begins with those that are free.
            compute=ActorPoolStrategy(min_size=1, max_size=workers, initial_size=workers),
            num_cpus=1,
            max_task_retries=_RETRIES,
        )
    try:
        yield from pipeline.iter_rows()
    except ray.exceptions.RayError as error:
        raise UsageError(
            f"Ray cannot run the workers: {str(error).strip().splitlines()[-1]} (every machine of "
            f"the cluster needs actioncli {__version__} with the extra `ray`)."
        ) from error
