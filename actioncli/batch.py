"""Recordings by the thousand: a `Recognizer` as a stage of a Ray Data pipeline.

The files are divided into small blocks. Each worker, a process on one core of this machine or of
a cluster, reads a block's files and decides as `classify` does; rows come back in any order. A
worker that dies is replaced and its block done again. Needs the extra `ray`.
"""

from __future__ import annotations

import contextlib
import logging
import os
import secrets
import shutil
import tempfile
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

from actioncli.batch_results import WORKER_DIED, Row, State, as_table
from actioncli.errors import ActionCliError, UsageError
from actioncli.media import read_any
from actioncli.recognizer import Recognizer
from actioncli.threshold import Threshold

if TYPE_CHECKING:
    import pyarrow as pa

    from actioncli.clips.clip import FloatArray
    from actioncli.model.weights import Weights

# Files of a block: what is lost of a worker that dies, and what comes back at once.
_BLOCK = 8
# How often a block is given to another worker before its files are tried one by one.
_RETRIES = 2
# Bytes for what workers hand over; rows are small.
_OBJECT_STORE = 128 * 2**20


@dataclass(frozen=True, slots=True, eq=False)
class Task:
    """What decisions depend on; everything a worker needs.

    Attributes:
        weights: of the model.
        support: embeddings of each action's examples.
        negatives: embeddings of what must never be accepted.
        threshold: what confidence must exceed.
        durations: of the enrolled examples, see `Recognizer.classify`.
        options: how to read files, see `read_any`.
    """

    weights: Weights
    support: Mapping[str, FloatArray]
    negatives: FloatArray
    threshold: Threshold
    durations: Sequence[float] = ()
    options: dict[str, Any] = field(default_factory=dict)


class Stage:
    """A worker: paths in, rows out."""

    def __init__(self, task: Task) -> None:
        """Build the recogniser once."""
        self._task = task
        self._recognizer = Recognizer(task.weights)

    def __call__(self, batch: pa.Table) -> pa.Table:
        """Decide about the files in the column `source`; see `batch_results.SCHEMA`."""
        return as_table([self.row(source) for source in batch["source"].to_pylist()])

    def row(self, source: str) -> Row:
        """What a file shows, or why that cannot be told."""
        begun, state, task = time.perf_counter(), State.of(source), self._task
        row: Row = {"source": source, "weights": task.weights.checksum}
        row |= {"size": state.size, "mtime_ns": state.mtime_ns}
        try:
            clip = read_any(source, **task.options)
            decision = self._recognizer.classify(
                clip, task.support, task.threshold.tau, task.negatives, task.durations
            )
        except ActionCliError as error:
            return row | _error(type(error).__name__, str(error))
        except Exception as error:  # noqa: BLE001 - one file, whatever it does, ends no archive
            return row | _error(type(error).__name__, f"{source}: {error} (this is a bug)")
        decision = task.threshold.apply(decision)
        start, end = decision.part or (None, None)
        return row | {
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
            "notes": list(decision.notes),
            "ms": (time.perf_counter() - begun) * 1e3,
        }


def _error(kind: str, message: str) -> Row:
    return {"error_type": kind, "error": " ".join(message.split())}


def decide(task: Task, sources: Sequence[str], take: Callable[[pa.Table], None]) -> None:
    """Classify files on the Ray that is joined, see `joined_ray`.

    A block whose workers keep dying is done file by file, and a file whose workers keep dying
    gets a row with the error `WORKER_DIED`.

    Args:
        task: what to decide by.
        sources: absolute paths, which mean the same on all machines.
        take: called in this thread with rows as they come.

    Raises:
        UsageError: the pipeline cannot run.
    """
    left = dict.fromkeys(sources)
    for block in (_BLOCK, 1):
        for rows in _rows(task, list(left), block):
            take(rows)
            for source in rows["source"].to_pylist():
                left.pop(source, None)
        if not left:
            return
    take(as_table([_died(task, source) for source in left]))


def _died(task: Task, source: str) -> Row:
    state = State.of(source)
    message = f"{source}: the process that read it died, {_RETRIES + 1} times in a row."
    row = {"source": source, "weights": task.weights.checksum, "size": state.size}
    return row | {"mtime_ns": state.mtime_ns} | _error(WORKER_DIED, message)


def _rows(task: Task, sources: Sequence[str], most: int) -> Iterator[pa.Table]:
    import ray
    from ray.data import ActorPoolStrategy

    cores = max(1, int(ray.cluster_resources().get("CPU", 1)))
    # Small archives are spread over all workers.
    per_block = max(1, min(most, len(sources) // (2 * cores)))
    blocks = -(-len(sources) // per_block)
    pipeline = ray.data.from_items(
        [{"source": source} for source in sources], override_num_blocks=blocks
    ).map_batches(
        Stage,
        fn_constructor_args=(task,),
        batch_size=None,
        batch_format="pyarrow",
        compute=ActorPoolStrategy(min_size=1, max_size=min(cores, blocks)),
        num_cpus=1,
        max_task_retries=_RETRIES,
    )
    try:
        yield from pipeline.iter_batches(batch_size=None, batch_format="pyarrow")
    except ray.exceptions.RayError as error:
        raise UsageError(
            f"Ray cannot run the workers: {str(error).splitlines()[-1]} (every machine of the "
            "cluster needs this version of actioncli with the extra `ray`)."
        ) from error


@contextlib.contextmanager
def joined_ray(address: str | None = None, cores: int | None = None) -> Iterator[None]:
    """Ray to work on: a cluster, or processes of this machine that end with the block.

    The latter listen on the loopback interface alone, under a token that no other user knows,
    and keep their files in a folder of their own that is removed. Nothing is reported to anyone.

    Args:
        address: of a cluster that this machine belongs to, HOST:PORT or `auto`.
        cores: workers on this machine; None: one for each core.

    Raises:
        UsageError: there is no such cluster.
    """
    os.environ["RAY_USAGE_STATS_ENABLED"] = "0"
    # Ray says much that is of no use to who waits for rows.
    os.environ.setdefault("RAY_DEDUP_LOGS", "1")
    folder = None
    if address is None:
        os.environ |= {"RAY_AUTH_MODE": "token", "RAY_AUTH_TOKEN": secrets.token_hex(32)}
        # Sockets lie in it, whose paths may have about a hundred characters.
        short = Path("/tmp")
        folder = tempfile.mkdtemp(prefix="actioncli-", dir=short if short.is_dir() else None)
    import ray

    own: dict[str, Any] = {
        "address": "local",
        "num_cpus": cores,
        "include_dashboard": False,
        "object_store_memory": _OBJECT_STORE,
        "_node_ip_address": "127.0.0.1",
        "_temp_dir": folder,
    }
    try:
        _start(own if address is None else {"address": address})
        context = ray.data.DataContext.get_current()
        context.max_errored_blocks = -1
        context.enable_progress_bars = False
        context.print_on_execution_start = False
        for name in ("ray", "ray.data"):
            logging.getLogger(name).setLevel(logging.CRITICAL)
        yield
    finally:
        ray.shutdown()
        if folder is not None:
            shutil.rmtree(folder, ignore_errors=True)


def _start(how: Mapping[str, Any]) -> None:
    import ray

    try:
        ray.init(**how, logging_level=logging.CRITICAL, log_to_driver=False)
    except ConnectionError as error:
        raise UsageError(
            f"there is no Ray cluster at {how['address']!r}: start one with `ray start`, or leave "
            "out --ray."
        ) from error
    # Ray raises Exception itself where its processes are not up within half a minute.
    except Exception as error:
        raise UsageError(
            f"Ray does not start: {error} (try again when the machine is less busy, or with --ray "
            "on a cluster that runs)."
        ) from error
