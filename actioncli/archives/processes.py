"""Work on many files shared by processes: one for each core, forked, so that nothing of what is
loaded is loaded again."""

from __future__ import annotations

import os
import signal
from collections.abc import Callable, Generator, Sequence
from typing import TYPE_CHECKING, TypeVar

from actioncli import files
from actioncli.errors import ActionCliError

if TYPE_CHECKING:
    from multiprocessing.connection import Connection

T = TypeVar("T")


class ProcessKilledError(ActionCliError):
    """A process that did a part of the work was killed, at the task whose outcome is wanted."""


def cores() -> int:
    """On which this process may run; 1 where processes cannot be forked safely (macOS, Windows)."""
    return len(files.own_cores()) if files.SYSTEM == "linux" else 1


def in_processes(
    work: Callable[[int], T], tasks: int, processes: int, pinned: bool = False
) -> Generator[T, None, None]:
    """What `work` gives for each number below `tasks`, in their order.

    Each process takes every `processes`-th task and waits when it is far ahead. They end with
    this process, however it ends, and with the iterator.

    Args:
        work: gives what can be pickled; it is not to write where others write.
        processes: 1 works here, as it goes.
        pinned: keep each process to one core, so that what takes a thread for each core that it
            finds takes one.

    Raises:
        Exception: what `work` raised, at the first task that did.
        ProcessKilledError: a process was killed.
    """
    processes = min(processes, tasks)
    if processes <= 1:
        yield from map(work, range(tasks))
        return
    from multiprocessing import get_context

    context = get_context("fork")
    on = files.own_cores()
    ends: list[Connection] = []
    workers = []
    try:
        for first in range(processes):
            ours, theirs = context.Pipe(duplex=False)
            mine = range(first, tasks, processes)
            core = {on[first % len(on)]} if pinned else set(on)
            given = work, mine, theirs, [*ends, ours], core
            worker = context.Process(target=_work, args=given, daemon=True)
            worker.start()
            theirs.close()
            ends.append(ours)
            workers.append(worker)
        for task in range(tasks):
            try:
                raised, outcome = ends[task % processes].recv()
            except EOFError:
                raise ProcessKilledError(
                    "a process that did a part of the work was killed, perhaps for want of "
                    "memory; try again with fewer files at once."
                ) from None
            if raised:
                raise outcome
            yield outcome
    finally:
        for worker in workers:
            worker.kill()
        for worker in workers:
            worker.join()
        for end in ends:
            end.close()


def _work(
    work: Callable[[int], object],
    tasks: Sequence[int],
    out: Connection,
    inherited: list[Connection],
    on: set[int],
) -> None:
    """What a process does, on these cores."""
    os.sched_setaffinity(0, on)
    # Ctrl-C reaches all of a terminal's processes: the first one ends the others.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    # For it these are like Ctrl-C.
    for ending in files.ending_signals():
        signal.signal(ending, signal.SIG_DFL)
    # Who holds these would not notice that the first process is gone.
    for end in inherited:
        end.close()
    try:
        for task in tasks:
            try:
                outcome = work(task)
            except Exception as error:  # noqa: BLE001 - raised again where the results are wanted
                out.send((True, error))
                return
            out.send((False, outcome))
    except BrokenPipeError:
        return
