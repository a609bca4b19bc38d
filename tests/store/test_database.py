"""Transactions: faults of the disk, of other programs and of the file itself."""

from __future__ import annotations

import contextlib
import os
import random
import resource
import shutil
import signal
import sqlite3
import subprocess
from contextlib import closing
from pathlib import Path

import numpy as np
import pytest
from storing import as_ordinary_user, fork, give_away, make_clip, same, succeeded

from actioncli.errors import ActionCliError, StoreError
from actioncli.store import database
from actioncli.store.database import reading, writing
from actioncli.store.examples import list_examples
from actioncli.store.store import SupportStore


def fill(store: SupportStore) -> StoreError:
    """Enrol until the disk is full; what was said then."""
    for seed in range(1000):
        try:
            store.enroll("fill", make_clip(seed, frames=60))
        except StoreError as error:
            return error
    raise AssertionError("the disk was never full")


def test_reading_creates_nothing(store: SupportStore) -> None:
    with reading(store.path) as db:
        assert list_examples(db) == []
    assert store.check() == []
    assert not store.path.parent.exists()


def test_a_block_that_raises_is_undone(store: SupportStore) -> None:
    store.enroll("wave", make_clip(0))

    def lose() -> None:
        with writing(store.path) as db:
            db.execute("DELETE FROM examples")
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        lose()
    assert [action.examples for action in store.actions()] == [1]


def test_a_locked_store_is_told(store: SupportStore, monkeypatch: pytest.MonkeyPatch) -> None:
    store.enroll("wave", make_clip(0))
    monkeypatch.setattr(database, "PATIENCE", 0.05)
    with closing(sqlite3.connect(store.path, isolation_level=None)) as other:
        other.execute("BEGIN IMMEDIATE")
        assert len(store.actions()) == 1  # who only reads does not mind
        assert len(store.snapshot("w").clips) == 1
        with pytest.raises(StoreError, match="locked by another program"):
            store.enroll("wave", make_clip(1))
        other.execute("ROLLBACK")
        other.execute("BEGIN EXCLUSIVE")
        with pytest.raises(StoreError, match="locked by another program"):
            store.actions()
    store.enroll("wave", make_clip(1))


def test_a_full_database_is_told(store: SupportStore, monkeypatch: pytest.MonkeyPatch) -> None:
    store.enroll("wave", make_clip(0))
    limit = (*database._PRAGMAS, "PRAGMA max_page_count = 40")
    with monkeypatch.context() as patch:
        patch.setattr(database, "_PRAGMAS", limit)
        assert "disk is full" in str(fill(store))
    kept = store.actions()[0].examples
    assert kept > 5
    assert store.check() == []
    store.enroll("fill", make_clip(5000))
    assert store.actions()[0].examples == kept + 1


def test_a_limit_of_the_system_is_told(store: SupportStore) -> None:
    def limited() -> None:
        resource.setrlimit(resource.RLIMIT_FSIZE, (200_000, 200_000))
        error = fill(store)
        assert str(store.path) in str(error)
        assert "full" in str(error)

    store.enroll("wave", make_clip(0))
    assert succeeded(fork(limited))
    assert store.check() == []
    assert {action.label for action in store.actions()} == {"fill", "wave"}
    store.enroll("fill", make_clip(5000))


@pytest.mark.skipif(os.geteuid() != 0, reason="mounting needs root")
def test_a_full_disk_loses_nothing(tmp_path: Path) -> None:
    disk = tmp_path / "disk"
    disk.mkdir()
    mount = ["mount", "-t", "tmpfs", "-o", "size=256k", "tmpfs", str(disk)]
    if subprocess.run(mount, capture_output=True, check=False).returncode != 0:
        pytest.skip("mounting is not allowed here")
    try:
        ballast = disk / "ballast"
        ballast.write_bytes(bytes(2**16))
        store = SupportStore(disk / "support.db")
        error = fill(store)
        assert "full" in str(error)
        kept = store.actions()[0].examples
        assert kept > 5
        assert store.check() == []
        with pytest.raises(StoreError, match="No space left"):
            store.export(disk / "out.safetensors")
        assert {file.name for file in disk.iterdir()} == {
            "support.db",
            "support.db.backup",
            "ballast",
        }
        ballast.unlink()
        store.remove("fill", store.examples()[0].id)
        store.enroll("fill", make_clip(5000, frames=10))
        assert len(store.support()["fill"]) == kept
    finally:
        subprocess.run(["umount", str(disk)], check=True)


def test_an_interrupted_write_is_undone_where_writing_is_possible(shared_folder: Path) -> None:
    store = SupportStore(shared_folder / "home" / "support.db")
    store.enroll("wave", make_clip(0))

    def die_while_writing() -> None:
        with writing(store.path) as db:
            db.execute("PRAGMA cache_spill = 1")
            db.execute("PRAGMA cache_size = 1")
            db.execute("UPDATE examples SET note = hex(zeroblob(200000))")
            os.kill(os.getpid(), signal.SIGKILL)

    assert not succeeded(fork(die_while_writing))
    journal = store.path.with_name("support.db-journal")
    assert journal.stat().st_size > 0
    give_away(store.path.parent, store.path, journal)
    store.path.parent.chmod(0o500)

    def refused() -> None:
        with pytest.raises(StoreError, match="Make the file and its folder writable"):
            store.actions()

    assert as_ordinary_user(refused)
    store.path.parent.chmod(0o700)
    assert store.examples()[0].note == ""
    assert not journal.exists()
    assert store.check() == []


def test_damage_is_told_and_never_believed(store: SupportStore, tmp_path: Path) -> None:
    """Flip bits anywhere: it is told, or what is read is what was enrolled."""
    clips = {f"action {seed}": make_clip(seed, 40, confidence=seed % 2 == 0) for seed in range(8)}
    store.enroll_all(clips.items())
    store.keep_embeddings("w", {1: np.ones((2, 3), np.float32)})
    whole = store.path.read_bytes()
    damaged = SupportStore(tmp_path / "damaged.db")
    out = tmp_path / "out.safetensors"
    readers = (
        damaged.actions,
        damaged.examples,
        damaged.negatives,
        lambda: damaged.snapshot("w"),
        lambda: damaged.clip(1),
        lambda: damaged.export(out),
        lambda: damaged.setting("tau"),
    )
    writers = (
        lambda: damaged.enroll("action 0", make_clip(0)),
        lambda: damaged.keep_embeddings("w", {1: np.ones((2, 3), np.float32)}),
        lambda: damaged.remove("action 1"),
    )
    generator = random.Random(0)
    found = 0
    for turn in range(100):
        content = bytearray(whole)
        for _ in range(generator.choice([1, 1, 8])):
            content[generator.randrange(len(content))] ^= 1 << generator.randrange(8)
        damaged.path.write_bytes(content)
        problems = damaged.check()
        found += bool(problems)
        try:
            support = damaged.support()
        except StoreError:
            assert problems
        else:
            assert problems or support.keys() == clips.keys()
            for label in support.keys() & clips.keys():
                assert all(same(clip, clips[label]) for clip in support[label])
        for use in (*readers, *writers) if turn % 5 == 0 else readers:
            with contextlib.suppress(ActionCliError):
                use()
    assert found > 30


def test_a_truncated_store_is_told(store: SupportStore, tmp_path: Path) -> None:
    store.enroll_all((f"action {seed % 5}", make_clip(seed, frames=30)) for seed in range(20))
    size = store.path.stat().st_size
    for kept in (50, 4096, size // 2, size - 4096, size - 1):
        damaged = SupportStore(tmp_path / "damaged.db")
        shutil.copy(store.path, damaged.path)
        os.truncate(damaged.path, kept)
        assert damaged.check()
        with pytest.raises(StoreError, match=r"is damaged|is not a support set"):
            damaged.support()
