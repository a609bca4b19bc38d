"""Nothing that was acknowledged is lost, nothing is half there: kills and crowds."""

from __future__ import annotations

import os
import random
import signal
import stat
import time
from collections.abc import Callable
from itertools import count
from pathlib import Path

import numpy as np
from storing import fork, make_clip, same, succeeded

from actioncli.store.store import SupportStore

KILLS = 200


def killed_after(seconds: float, work: Callable[[int], None], wait: bool = False) -> list[int]:
    """Run `work` in a child, kill it (SIGKILL); the numbers that it had acknowledged by then.

    Args:
        seconds: when to kill.
        work: gets the file descriptor on which to acknowledge, 8 bytes for each number.
        wait: let the clock run from the first acknowledgement, not from the start.
    """
    receive, acknowledge = os.pipe()
    child = fork(lambda: work(acknowledge))
    os.close(acknowledge)
    answers = os.read(receive, 8) if wait else b""
    time.sleep(seconds)
    os.kill(child, signal.SIGKILL)
    assert not succeeded(child)
    with os.fdopen(receive, "rb") as pipe:
        answers += pipe.read()
    return [int.from_bytes(answers[at : at + 8], "little") for at in range(0, len(answers), 8)]


def test_kills_lose_no_acknowledged_example(store: SupportStore) -> None:
    """SIGKILL at random moments of enrolments of one clip and of three at once."""
    generator = random.Random(time.time_ns())
    acknowledged: dict[int, int] = {}
    total = interrupted = 0

    def enrol(turn: int, acknowledge: int) -> None:
        for step in count():
            seed = turn * 10_000 + step * 3
            label = f"action {turn}-{step}"
            size = 1 if step % 2 else 3
            clips = [(label, make_clip(seed + place)) for place in range(size)]
            for place, enrolled in enumerate(store.enroll_all(clips)):
                answer = enrolled.example * 10_000_000 + seed + place
                os.write(acknowledge, answer.to_bytes(8, "little"))

    for turn in range(KILLS):
        answers = killed_after(
            generator.uniform(0, 0.03), lambda fd, turn=turn: enrol(turn, fd), wait=turn % 10 > 0
        )
        for answer in answers:
            example, seed = divmod(answer, 10_000_000)
            acknowledged[example] = seed
        interrupted += store.path.with_name("support.db-journal").exists()
        assert store.check() == []
        assert acknowledged.keys() <= {example.id for example in store.examples()}
        if turn % 20 == 19:
            for action in store.actions():
                step = int(action.label.rpartition("-")[2])
                assert action.examples == (1 if step % 2 else 3)
            for example, seed in acknowledged.items():
                assert same(store.clip(example), make_clip(seed))
            total += len(acknowledged)
            acknowledged.clear()
            store.clear()  # so that checking after each kill stays quick
    # The kills did hit: much was acknowledged, and commits were cut in the middle.
    assert total > KILLS / 2
    assert interrupted > 0


def test_kills_while_the_store_is_created(tmp_path: Path) -> None:
    generator = random.Random(time.time_ns())
    for turn in range(20):
        store = SupportStore(tmp_path / f"home {turn}" / "support.db")

        def enrol(acknowledge: int, store: SupportStore = store) -> None:
            store.enroll("wave", make_clip(0))
            os.write(acknowledge, (1).to_bytes(8, "little"))
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


def test_sixteen_processes_that_do_everything_at_once(store: SupportStore, tmp_path: Path) -> None:
    store.enroll("shared", make_clip(0))

    def live(process: int) -> None:
        mine = f"process {process}"
        for turn in range(2):
            store.enroll_all([(mine, make_clip(process * 100 + turn + 1)), ("all", make_clip(7))])
            assert store.rename(mine, f"{mine} renamed") == turn + 1
            numbers = [example.id for example in store.examples(f"{mine} renamed")]
            store.keep_embeddings("w", dict.fromkeys(numbers, np.ones((2, 3), np.float32)))
            assert store.rename(f"{mine} renamed", mine) == turn + 1
            assert len(store.support()[mine]) == turn + 1
        archive = tmp_path / f"{process}.safetensors"
        exported = store.export(archive)
        assert SupportStore(tmp_path / f"{process}.db").import_(archive) == (exported, 0)
        if process % 2:
            store.remove(mine, store.examples(mine)[0].id)

    children = [fork(lambda process=process: live(process)) for process in range(16)]
    assert [succeeded(child) for child in children] == [True] * len(children)
    assert store.check() == []
    labels = {action.label: action.examples for action in store.actions()}
    assert labels["all"] == labels["shared"] == 1
