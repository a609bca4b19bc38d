"""A store that somebody else made, or made a trap around."""

import json
import re
import sqlite3
from collections.abc import Callable
from contextlib import closing
from pathlib import Path

import pytest
from clips.bodies import waving

from actioncli import Clip, Recognizer, StoreError, SupportSet, SupportStore
from actioncli.clips.skeleton import DEFAULT_JOINTS
from actioncli.store.record import seal

BODY = waving(12)


def moving(seed: int = 0) -> Clip:
    return Clip(BODY + 0.01 * seed * BODY[::-1], DEFAULT_JOINTS, source=f"clip{seed}.npz")


@pytest.fixture
def kept(tmp_path: Path) -> SupportStore:
    """A store of three examples."""
    store = SupportStore(tmp_path / "home" / "support.db")
    store.enroll_all([("wave", moving(0)), ("wave", moving(1)), ("noise", moving(2))])
    return store


def forge(store: SupportStore, *statements: str) -> None:
    with closing(sqlite3.connect(store.path)) as db:
        db.executescript("PRAGMA writable_schema = ON;" + ";".join(statements))


HOSTILE = {
    "a trigger that removes": "CREATE TRIGGER t AFTER INSERT ON examples BEGIN "
    "DELETE FROM examples WHERE label != 'trap'; END",
    "a view that never ends": "ALTER TABLE examples RENAME TO e; CREATE VIEW examples AS "
    "WITH RECURSIVE n(id) AS (VALUES (1) UNION ALL SELECT id + 1 FROM n) "
    "SELECT n.id, label, negative, source, note, added, fps, frames, joint_count, joint_names, "
    "checksum, joints, confidence, seal FROM n, e",
    "a view in the place of the settings": "DROP TABLE settings; CREATE VIEW settings AS "
    "SELECT 'threshold' AS name, '{}' AS value, 0 AS crc",
    "a table that is computed": "CREATE VIRTUAL TABLE v USING fts5(a)",
    "an index that computes": "CREATE INDEX i ON examples (abs(fps))",
    "a column that is computed": "ALTER TABLE settings ADD COLUMN x AS (upper(name))",
    "one more table": "CREATE TABLE more (a)",
    "a table under SQLite's own name": "CREATE TABLE more (a); UPDATE sqlite_master SET "
    "name = 'sqlite_stat1', type = 'view' WHERE name = 'more'",
}


@pytest.mark.parametrize("what", HOSTILE)
def test_a_schema_that_no_release_made_is_refused(kept: SupportStore, what: str) -> None:
    forge(kept, HOSTILE[what])
    before = kept.path.read_bytes()
    recognizer = Recognizer()
    uses: list[Callable[[], object]] = [
        kept.actions,
        kept.examples,
        kept.support,
        kept.negatives,
        lambda: SupportSet.load(kept, recognizer),
        lambda: kept.enroll("trap", moving(3)),
        lambda: kept.remove("wave"),
        lambda: kept.rename("wave", "hello"),
        lambda: kept.setting("threshold"),
        lambda: kept.set_setting("threshold", "1"),
        lambda: kept.export(kept.path.parent / "export"),
    ]
    for use in uses:
        with pytest.raises(StoreError, match=r"support\.db"):
            use()
    assert kept.path.read_bytes() == before
    # The last one is damage for SQLite itself.
    assert re.search("tables are not as actioncli makes them|malformed", str(kept.check()))


def test_what_analyze_adds_is_no_reason_to_refuse(kept: SupportStore) -> None:
    forge(kept, "ANALYZE")
    assert [action.label for action in kept.actions()] == ["noise", "wave"]


LABELS = ["a\0b", "\x1b]0;pwned\x07", "a\u202egnp", " a", "", "a" * 101, "e\u0301", "a\nb"]


@pytest.mark.parametrize("label", LABELS, ids=ascii)
def test_a_label_that_nobody_could_enrol_goes_nowhere(kept: SupportStore, label: str) -> None:
    """It would go to the terminal, and to the program of `watch --exec`."""
    recognizer = Recognizer()
    with closing(sqlite3.connect(kept.path)) as db:
        db.execute("PRAGMA ignore_check_constraints = ON")
        # The seals that a forger would make.
        db.create_function("seal", 7, seal)
        db.execute("UPDATE examples SET label = ? WHERE label = 'noise'", (label,))
        db.execute(
            "UPDATE examples SET seal = seal(id, label, negative, source, note, added, checksum)"
        )
        db.commit()
    for use in (kept.actions, kept.examples, lambda: SupportSet.load(kept, recognizer)):
        with pytest.raises(StoreError, match="label") as error:
            use()
        assert str(error.value).isprintable()


def test_joint_names_that_nest_or_never_end_are_damage(kept: SupportStore) -> None:
    for names in ("[" * 50_000 + "]" * 50_000, json.dumps(["a" * 10_000_000]), "[1, 2]", "{}"):
        forge(kept, f"UPDATE examples SET joint_names = '{names}'")
        with pytest.raises(StoreError, match="damaged"):
            kept.support()
        with pytest.raises(StoreError, match="damaged"):
            kept.export(kept.path.parent / "export")


def test_a_blob_beyond_every_example_is_not_read(kept: SupportStore) -> None:
    with closing(sqlite3.connect(kept.path)) as db:
        db.execute("PRAGMA ignore_check_constraints = ON")
        db.execute("UPDATE examples SET joints = zeroblob(200000000) WHERE id = 1")
        db.commit()
    with pytest.raises(StoreError, match="too big"):
        kept.support()


def test_no_link_is_followed_from_the_stores_folder(tmp_path: Path) -> None:
    """In a folder that others may write, they can lay links under names that they can guess."""
    folder = tmp_path / "shared"
    folder.mkdir()
    precious = tmp_path / "thesis.txt"
    precious.write_text("mine")
    for name in ("support.db-journal", "support.db-wal", "export"):
        (folder / name).symlink_to(precious)
    store = SupportStore(folder / "support.db")
    # SQLite takes the links of its journals away, or refuses; it does not write through them.
    store.enroll("wave", moving())
    assert not (folder / "support.db").is_symlink()
    with pytest.raises(StoreError, match="is no export"):
        store.export(folder / "export")
    assert precious.read_text() == "mine"
