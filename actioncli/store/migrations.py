"""The schema, as the ordered list of changes that lead to it.

A database's `user_version` counts the changes it has seen, its `application_id` says that it is
ours. A change that was released is never edited; a new one is added below it, and a store of the
schema before it is kept for the tests (`tests/store/schemas/make.py`).
"""

from __future__ import annotations

import sqlite3
import zlib
from collections.abc import Callable
from contextlib import closing
from functools import lru_cache
from pathlib import Path

from actioncli.errors import StoreError
from actioncli.store.faults import system_fault

APPLICATION_ID = int.from_bytes(b"ACLI")
# A file with less than SQLite's smallest page counts as an empty database there.
_SMALLEST = 512


# The statements of each change.
MIGRATIONS: tuple[tuple[str, ...], ...] = (
    (
        # Identifiers are never given twice (AUTOINCREMENT): an embedding that was computed
        # for a removed example cannot be filed under a new one.
        # The index holds `negative` so that the integrity check covers it.
        """
            CREATE TABLE examples (
                id INTEGER PRIMARY KEY AUTOINCREMENT,
                label TEXT NOT NULL CHECK (length(label) BETWEEN 1 AND 100),
                negative INTEGER NOT NULL CHECK (negative IN (0, 1)),
                source TEXT NOT NULL,
                note TEXT NOT NULL,
                added TEXT NOT NULL,
                fps REAL NOT NULL CHECK (fps > 0),
                frames INTEGER NOT NULL CHECK (frames >= 2),
                joint_count INTEGER NOT NULL CHECK (joint_count >= 1),
                joint_names TEXT NOT NULL,
                checksum TEXT NOT NULL,
                joints BLOB NOT NULL CHECK (length(joints) = frames * joint_count * 12),
                confidence BLOB CHECK (length(confidence) = frames * joint_count * 4),
                UNIQUE (label, negative, checksum)
            )
            """,
        """
            CREATE TABLE embeddings (
                example INTEGER NOT NULL REFERENCES examples (id) ON DELETE CASCADE,
                weights TEXT NOT NULL,
                frames INTEGER NOT NULL,
                width INTEGER NOT NULL,
                crc INTEGER NOT NULL,
                data BLOB NOT NULL,
                PRIMARY KEY (example, weights)
            )
            """,
        "CREATE TABLE settings (name TEXT PRIMARY KEY NOT NULL, value TEXT NOT NULL)",
    ),
    # Seals, so that a flipped bit is noticed in a label as it is in a recording.
    (
        "ALTER TABLE examples ADD COLUMN seal INTEGER NOT NULL DEFAULT 0",
        "UPDATE examples SET seal = seal(id, label, negative, source, note, added, checksum)",
        "ALTER TABLE settings ADD COLUMN crc INTEGER NOT NULL DEFAULT 0",
        "UPDATE settings SET crc = setting_crc(name, value)",
        # Their checksums cover the label from now on.
        "DELETE FROM embeddings",
    ),
)

_OBJECTS = "SELECT type, name, tbl_name, sql FROM sqlite_master"


def setting_crc(name: str, value: str) -> int:
    """CRC-32 of a setting."""
    return zlib.crc32(f"{name}\0{value}".encode("utf-8", "surrogatepass"))


def schema_version(db: sqlite3.Connection, path: Path) -> int:
    """How many migrations the database has seen; 0 for an empty one.

    Raises:
        StoreError: another program's database, or one of a newer release; or the file is out of
            reach.
        sqlite3.DatabaseError: what is left of a database that was cut short.
    """
    (application,) = db.execute("PRAGMA application_id").fetchone()
    (version,) = db.execute("PRAGMA user_version").fetchone()
    if application == 0 and version == 0:
        (tables,) = db.execute("SELECT count(*) FROM sqlite_master").fetchone()
        if tables == 0:
            try:
                size = path.stat().st_size
            except OSError as error:
                raise system_fault(path, error) from error
            if 0 < size < _SMALLEST:
                raise sqlite3.DatabaseError("the file is cut short")
            return 0
    if application != APPLICATION_ID or version < 1:
        raise StoreError(
            f"{path} is a database of another program; it was left as it is. "
            "Name another file with --store or ACTIONCLI_HOME."
        )
    if version > len(MIGRATIONS):
        raise StoreError(
            f"{path} was written by a newer release (schema {version}, this one knows "
            f"{len(MIGRATIONS)}). Update actioncli, or name another file with --store."
        )
    # SQLite adds statistics when somebody asks it to ANALYZE. A flipped bit makes bytes of a name.
    if _made(version) != {
        row
        for row in db.execute(_OBJECTS)
        if row[0] != "table" or not str(row[1]).startswith("sqlite_stat")
    }:
        raise StoreError(
            f"{path}: its tables are not as actioncli makes them, so it was changed by another "
            "program, or on purpose. `actioncli doctor --repair` takes over what is whole in it."
        )
    return int(version)


def is_as_made(db: sqlite3.Connection, table: str, version: int) -> bool:
    """Whether a table can be read to be the one that the migrations up to a version make."""
    made = {row for row in _made(version) if row[1] == table}
    try:
        return set(db.execute(f"{_OBJECTS} WHERE name = ?", (table,))) == made
    except (sqlite3.Error, UnicodeDecodeError):
        return False


@lru_cache
def _made(version: int) -> set[tuple[str, str, str, str | None]]:
    with closing(sqlite3.connect(":memory:")) as db:
        # There are no rows, so that nothing is ever sealed.
        _run(db, MIGRATIONS[:version], lambda *_: 0)
        return set(db.execute(_OBJECTS))


def migrate(db: sqlite3.Connection, version: int) -> None:
    """Bring a schema of this version up to date, inside the caller's write transaction.

    Raises:
        sqlite3.DatabaseError: an older store is damaged; nothing is built on that.
    """
    if version == len(MIGRATIONS):
        return
    from actioncli.store.record import seal

    (found,) = db.execute("PRAGMA integrity_check(1)").fetchone() if version else ("ok",)
    if found != "ok":
        raise sqlite3.DatabaseError(found)
    _run(db, MIGRATIONS[version:], seal)
    db.execute(f"PRAGMA application_id = {APPLICATION_ID}")
    db.execute(f"PRAGMA user_version = {len(MIGRATIONS)}")


def _run(
    db: sqlite3.Connection, migrations: tuple[tuple[str, ...], ...], seal: Callable[..., int]
) -> None:
    # What their statements call.
    db.create_function("seal", 7, seal)
    db.create_function("setting_crc", 2, setting_crc)
    for migration in migrations:
        for statement in migration:
            db.execute(statement)
