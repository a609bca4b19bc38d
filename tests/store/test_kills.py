"""Nothing that was acknowledged is lost, nothing is half there: kills and crowds.

The rounds of faults (`tests/faults`) kill and crowd processes that use a store which is there.
"""

from __future__ import annotations

import os
import random
import signal
import stat
import time
from collections.abc import Callable
from pathlib import Path

from storing import fork, make_clip, succeeded

from actioncli.store.store import SupportStore


def killed_after(seconds: float, work: Callable[[int], None]) -> bytes:
    """Run `work` in a child, kill it (SIGKILL); what it had written to its pipe by then."""
    receive, acknowledge = os.pipe()
    child = fork(lambda: work(acknowledge))
    os.close(acknowledge)
    time.sleep(seconds)
    os.kill(child, signal.SIGKILL)
    assert not succeeded(child)
    with os.fdopen(receive, "rb") as pipe:
        return pipe.read()


def test_kills_while_the_store_is_created(tmp_path: Path) -> None:
    generator = random.Random(time.time_ns())
    for turn in range(20):
        store = SupportStore(tmp_path / f"home {turn}" / "support.db")

        def enrol(acknowledge: int, store: SupportStore = store) -> None:
            store.enroll("wave", make_clip(0))
            os.write(acknowledge, b"1")
            time.sleep(10)

        acknowledged = killed_after(generator.uniform(0, 0.02), enrol)
        assert store.check() == []
        assert len(store.examples()) in ({1} if acknowledged else {0, 1})
        store.enroll("wave", make_clip(1))
        assert store.check() == []


def test_kills_during_import_and_export_leave_all_or_nothing(
    store: SupportStore, tmp_path: Path
) -> None:
    store.enroll_all((f"action {seed % 10}", make_clip(seed)) for seed in range(60))
    archive = tmp_path / "support.safetensors"
    store.export(archive)
    generator = random.Random(time.time_ns())
    for turn in range(20):
        other = SupportStore(tmp_path / f"other {turn}.db")
        copy = tmp_path / f"copy {turn}.safetensors"

        def work(_: int, other: SupportStore = other, copy: Path = copy) -> None:
            other.import_(archive)
            other.export(copy)
            time.sleep(10)

        killed_after(generator.uniform(0, 0.1), work)
        assert other.check() == []
        assert len(other.examples()) in {0, 60}
        assert not copy.exists() or copy.read_bytes() == archive.read_bytes()


def test_eight_processes_that_enrol_at_once_all_succeed(store: SupportStore) -> None:
    """They also create the folder, the file and the schema at the same moment."""
    start, go = os.pipe()

    def enrol(process: int) -> None:
        os.close(go)
        os.umask(0)
        os.read(start, 1)  # until the parent closes its end
        for turn in range(25):
            clip = make_clip(process * 1000 + turn)
            assert store.enroll(f"action {turn}", clip).added

    children = [fork(lambda process=process: enrol(process)) for process in range(8)]
    os.close(start)
    os.close(go)
    assert [succeeded(child) for child in children] == [True] * len(children)
    assert [action.examples for action in store.actions()] == [8] * 25
    assert store.check() == []
    assert stat.S_IMODE(store.path.stat().st_mode) == 0o600
    assert stat.S_IMODE(store.path.parent.stat().st_mode) == 0o700
