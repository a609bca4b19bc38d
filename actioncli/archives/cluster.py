"""The rows of `batch` from the machines of a Ray cluster. Needs the extra `ray`.

The files are divided into small blocks. Each worker, a process on one core of the cluster, reads
a block's files; rows come back in any order. A worker that dies is replaced, its block done again.
"""

from __future__ import annotations

import contextlib
import logging
import os
import socket
import warnings
from collections.abc import Generator, Iterator, Sequence

import pyarrow as pa

from actioncli._version import __version__
from actioncli.archives.batch import Task, failed, windows
from actioncli.archives.results import Results, Row, schema
from actioncli.errors import UsageError

# Files of a block, which are begun anew where their worker dies.
_BLOCK = 8
# How often that happens before the files are tried one by one, and then given up.
_RETRIES = 2
# How long a cluster may take to answer.
_ANSWER_SECONDS = 10.0
# Nothing is reported to anyone, and Ray writes to neither standard output nor error.
_QUIET = {
    "RAY_USAGE_STATS_ENABLED": "0",
    "RAY_BACKEND_LOG_LEVEL": "fatal",
    "RAY_DEDUP_LOGS": "1",
    "RAY_DEDUP_LOGS_SKIP_REGEX": ".",
}


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
            yield pa.Table.from_pylist([self._task.row(source)], schema())


def decide_on_cluster(task: Task, results: Results, address: str) -> Generator[Row, None, None]:
    """As `batch.decide`, on a cluster that this machine belongs to.

    The files of a block whose workers keep dying are done one by one, and a file whose workers
    keep dying gets a row that says so.

    Args:
        address: HOST:PORT, or `auto`.

    Raises:
        UsageError: there is no such cluster, or the pipeline cannot run.
    """
    with _joined(address):
        for block in (_BLOCK, 1):
            for window in windows(results):
                yield from _rows(task, window, block)
        died = f"the process that read it died, {_RETRIES + 1} times in a row."
        for window in windows(results):
            for source in window:
                yield failed(source, f"{source}: {died}")


@contextlib.contextmanager
def _joined(address: str) -> Iterator[None]:
    host, _, port = address.rpartition(":")
    try:
        # Ray itself would wait for minutes for a machine that does not answer.
        if address != "auto":
            socket.create_connection((host, int(port)), timeout=_ANSWER_SECONDS).close()
        os.environ |= _QUIET
        import ray

        ray.init(address=address, logging_level=logging.CRITICAL, log_to_driver=False)
    except (OSError, ValueError, OverflowError, RuntimeError) as error:
        raise UsageError(
            f"there is no Ray cluster at {address!r} that can be used ({error}): start one with "
            "`ray start`, or leave out --ray."
        ) from error
    try:
        context = ray.data.DataContext.get_current()
        # A block that is given up ends no archive.
        context.max_errored_blocks = -1
        # Every row comes back when it is there, not when there are megabytes of them.
        context.target_max_block_size = 1
        context.enable_progress_bars = False
        context.print_on_execution_start = False
        logging.getLogger("ray.data").setLevel(logging.CRITICAL)
        yield
    finally:
        ray.shutdown()


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
