"""Transactions: faults of the disk, of other programs and of the file itself."""

import resource
import sqlite3
from collections import deque
from contextlib import closing
from pathlib import Path

import pytest
from storing import as_ordinary_user, fork, give_away, interrupt, make_clip, succeeded

from actioncli.errors import StoreError
from actioncli.store import database
from actioncli.store.database import reading, writing
from actioncli.store.examples import list_examples
from actioncli.store.store import SupportStore


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


def test_a_limit_of_the_system_is_told(store: SupportStore) -> None:
    def limited() -> None:
        resource.setrlimit(resource.RLIMIT_FSIZE, (200_000, 200_000))
        clips = (("fill", make_clip(seed, frames=60)) for seed in range(1000))
        with pytest.raises(StoreError, match=rf"^{store.path} .* full"):
            deque(map(store.enroll_all, ([clip] for clip in clips)), maxlen=0)

    store.enroll("wave", make_clip(0))
    assert succeeded(fork(limited))
    assert store.check() == []
    assert {action.label for action in store.actions()} == {"fill", "wave"}
    store.enroll("fill", make_clip(5000))


def test_an_interrupted_write_is_undone_where_writing_is_possible(shared_folder: Path) -> None:
    store = SupportStore(shared_folder / "home" / "support.db")
    store.enroll("wave", make_clip(0))
    journal = interrupt(store, "UPDATE examples SET note = hex(zeroblob(200000))")
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
