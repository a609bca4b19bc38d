"""The schema: created once, recognised, brought up to date, never guessed at."""

import sqlite3
from contextlib import closing
from pathlib import Path

import pytest
from storing import alter, make_clip

from actioncli.errors import StoreError
from actioncli.store import migrations
from actioncli.store.migrations import APPLICATION_ID, MIGRATIONS
from actioncli.store.store import SupportStore


def both_refuse(store: SupportStore, match: str) -> None:
    """Neither reading nor writing touches the file."""
    before = store.path.read_bytes()
    with pytest.raises(StoreError, match=match):
        store.actions()
    with pytest.raises(StoreError, match=match):
        store.enroll("wave", make_clip(0))
    assert len(store.check()) == 1
    assert store.path.read_bytes() == before


def test_a_new_store_says_what_it_is(store: SupportStore) -> None:
    store.enroll("wave", make_clip(0))
    with closing(sqlite3.connect(store.path)) as db:
        assert db.execute("PRAGMA application_id").fetchone() == (APPLICATION_ID,)
        assert db.execute("PRAGMA user_version").fetchone() == (len(MIGRATIONS),)
        assert db.execute("PRAGMA journal_mode").fetchone() == ("delete",)


@pytest.mark.parametrize(
    "statements",
    [
        ("CREATE TABLE bookmarks (url TEXT)",),
        ("PRAGMA user_version = 7",),
        ("PRAGMA application_id = 1196444487", "CREATE TABLE features (id INTEGER)"),
        (f"PRAGMA application_id = {APPLICATION_ID}",),
    ],
)
def test_the_database_of_another_program_is_refused(
    tmp_path: Path, statements: tuple[str, ...]
) -> None:
    path = tmp_path / "places.db"
    alter(path, *statements)
    both_refuse(SupportStore(path), "another program")


@pytest.mark.parametrize("content", [b"not a database", b"x" * 5000, b"SQLite format 3\0" * 300])
def test_what_is_no_database_is_refused(tmp_path: Path, content: bytes) -> None:
    path = tmp_path / "notes.txt"
    path.write_bytes(content)
    both_refuse(SupportStore(path), r"is not a support set|is damaged")


def test_an_empty_file_is_an_empty_store(tmp_path: Path) -> None:
    store = SupportStore(tmp_path / "support.db")
    store.path.write_bytes(b"")
    assert store.actions() == []
    assert store.path.read_bytes() == b""
    store.enroll("wave", make_clip(0))
    assert store.check() == []


def test_a_migration_that_fails_changes_nothing(
    store: SupportStore, monkeypatch: pytest.MonkeyPatch
) -> None:
    store.enroll("wave", make_clip(0))
    broken = ("ALTER TABLE examples ADD COLUMN colour TEXT", "NO STATEMENT")
    with monkeypatch.context() as patch:
        patch.setattr(migrations, "MIGRATIONS", (*MIGRATIONS, broken))
        with pytest.raises(StoreError):
            store.actions()
    assert [action.label for action in store.actions()] == ["wave"]
    assert store.check() == []


def test_a_file_that_goes_out_of_reach_is_told(tmp_path: Path) -> None:
    """As when somebody takes the rights on its folder away after it was opened."""
    gone = tmp_path / "no folder" / "support.db"
    with closing(sqlite3.connect(":memory:")) as db, pytest.raises(StoreError) as told:
        migrations.schema_version(db, gone)
    assert str(gone) in str(told.value)
