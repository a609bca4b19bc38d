"""Work shared by processes: in order, whole, and gone with whoever wanted it."""

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from actioncli.archives.processes import cores, in_processes
from actioncli.errors import ActionCliError, ClipError

pytestmark = pytest.mark.skipif(cores() == 1, reason="processes cannot be forked here")


def test_the_order_of_tasks_is_kept_and_work_is_shared() -> None:
    for processes in (1, 2, 3, 20):
        found = list(in_processes(lambda task: (task, os.getpid()), 11, processes))
        assert [task for task, _ in found] == list(range(11))
        assert len({pid for _, pid in found}) == min(processes, 11)
        assert (os.getpid() in {pid for _, pid in found}) == (processes == 1)
    assert list(in_processes(lambda task: task, 0, 4)) == []


def test_results_larger_than_a_pipe() -> None:
    sizes = [len(text) for text in in_processes(lambda task: "x" * (task * 300_000), 6, 2)]
    assert sizes == [task * 300_000 for task in range(6)]


def test_what_a_task_raises_is_raised_where_its_result_is_wanted() -> None:
    def work(task: int) -> int:
        if task == 3:
            raise ClipError(f"{task} is no clip")
        return task

    found = in_processes(work, 8, 2)
    assert [next(found) for _ in range(3)] == [0, 1, 2]
    with pytest.raises(ClipError, match="3 is no clip"):
        next(found)


def test_an_error_that_is_a_result_is_not_raised() -> None:
    found = list(in_processes(lambda task: ClipError(str(task)), 4, 2))
    assert [str(error) for error in found] == ["0", "1", "2", "3"]


def test_each_process_may_have_a_core_of_its_own() -> None:
    def where(_: int) -> frozenset[int]:
        return frozenset(os.sched_getaffinity(0))

    own = list(in_processes(where, 2 * cores(), cores(), pinned=True))
    assert {len(found) for found in own} == {1}
    assert len(set(own)) == cores()
    assert set(in_processes(where, 4, 2)) == {frozenset(os.sched_getaffinity(0))}


def test_a_killed_process_is_told() -> None:
    def work(task: int) -> int:
        if task == 1:
            os.kill(os.getpid(), signal.SIGKILL)
        return task

    with pytest.raises(ActionCliError, match="killed"):
        list(in_processes(work, 4, 2))


def children(pid: int) -> list[int]:
    return [int(word) for word in Path(f"/proc/{pid}/task/{pid}/children").read_text().split()]


def test_processes_end_with_the_iterator() -> None:
    before = children(os.getpid())
    found = in_processes(lambda task: time.sleep(0.01 * (task > 0)), 1000, 2)
    next(found)
    assert len(children(os.getpid())) == len(before) + 2
    found.close()
    assert children(os.getpid()) == before


ENDLESS = """
import time
from actioncli.archives.processes import in_processes
for _ in in_processes(lambda task: time.sleep(0.05), 10_000, 3):
    print("on", flush=True)
"""


@pytest.mark.usefixtures("unmeasured")
@pytest.mark.parametrize("how", [signal.SIGKILL, signal.SIGTERM, signal.SIGINT])
def test_processes_end_with_the_first_one(how: signal.Signals) -> None:
    first = subprocess.Popen(
        [sys.executable, "-c", ENDLESS], stdout=subprocess.PIPE, stderr=subprocess.PIPE
    )
    assert first.stdout is not None
    first.stdout.readline()
    others = children(first.pid)
    assert len(others) == 3
    first.send_signal(how)
    first.communicate(timeout=30)
    deadline = time.monotonic() + 30
    while any(Path(f"/proc/{pid}").exists() and not ended(pid) for pid in others):
        assert time.monotonic() < deadline
        time.sleep(0.05)


def ended(pid: int) -> bool:
    """Gone, or waiting for whoever adopts orphans to notice."""
    try:
        return Path(f"/proc/{pid}/stat").read_text().rsplit(")", 1)[1].split()[0] == "Z"
    except OSError:
        return True
