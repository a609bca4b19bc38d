"""Transactions on the store's file.

Every operation opens the file, works in one transaction and closes it. Opening costs a fraction
of a millisecond; in return there is nothing to close, nothing that a fork or a thread could
share, and the file may be moved or replaced between two operations.

The journal is SQLite's rollback journal, not its write-ahead log: a store in a read-only folder
stays readable, no shared memory is needed (which network file systems lack), and at rest the
store is one file that can be copied. Writers exclude readers for the milliseconds of a commit,
which nobody notices here. `synchronous = EXTRA` also syncs the folder after the journal is
deleted, so that what was acknowledged survives a power loss.
"""

from __future__ import annotations

import sqlite3
from collections.abc import Iterator
from contextlib import closing, contextmanager, nullcontext, suppress
from pathlib import Path

from actioncli.errors import StoreError
from actioncli.store import migrations
from actioncli.store.faults import sqlite_fault
from actioncli.store.location import exists, prepare

# Seconds to wait for other writers: sixteen that enrol at once on a slow disk stay far below it.
PATIENCE = 30.0

# Bytes; more than any example has, so that what a hostile file announces stays bearable.
LONGEST_ROW = 96 * 2**20

# What SQLite answers where only giving back a lock failed.
_UNLOCKING = {sqlite3.SQLITE_IOERR_RDLOCK, sqlite3.SQLITE_IOERR_UNLOCK}

_PRAGMAS = (
    "PRAGMA synchronous = EXTRA",
    "PRAGMA foreign_keys = ON",
    # What was removed is overwritten, not only unlinked: it is a recording of somebody.
    "PRAGMA secure_delete = ON",
    # The file may come from someone else: its schema must not run functions, its pages are checked.
    "PRAGMA trusted_schema = OFF",
    "PRAGMA cell_size_check = ON",
)


@contextmanager
def reading(path: Path) -> Iterator[sqlite3.Connection]:
    """One consistent view of the store, or of an empty one where there is none. Creates nothing.

    Raises:
        StoreError: the file cannot be opened or read as a store.
    """
    latest = len(migrations.MIGRATIONS)
    with connected(path) if exists(path) else nullcontext() as db:
        version = 0
        if db:
            db.execute("BEGIN")
            version = migrations.schema_version(db, path)
        if db and 0 < version < latest:
            db.execute("ROLLBACK")
            with suppress(StoreError):
                with writing(path):
                    pass  # the first release to read an old store gives it today's schema
                db.execute("BEGIN")
                version = latest
        if db and version == latest:
            yield db
            return
        # Nothing is there, or it cannot be written (a read-only folder, a full disk).
        with closing(sqlite3.connect(":memory:", isolation_level=None)) as copy:
            if db and version:
                db.backup(copy)
            migrations.migrate(copy, version)
            yield copy


@contextmanager
def writing(path: Path) -> Iterator[sqlite3.Connection]:
    """One write transaction: committed when the block ends, undone when it raises.

    Creates the store and brings its schema up to date, in the same transaction.

    Args:
        path: the store's file.

    Raises:
        StoreError: the file cannot be opened, locked or written as a store.
    """
    while True:
        prepare(path)
        file = _file(path)
        with connected(path) as db:
            # The write lock is taken first: a reader that turned writer could deadlock with
            # another.
            db.execute("BEGIN IMMEDIATE")
            # While this waited for the lock, a repair may have put another file in its place.
            if _file(path) != file:
                continue
            migrations.migrate(db, migrations.schema_version(db, path))
            yield db
            try:
                db.execute("COMMIT")
            except sqlite3.OperationalError as error:
                # Everything is on the disk by then; closing the file gives the lock back as well.
                if error.sqlite_errorcode not in _UNLOCKING:
                    raise
            return


def _file(path: Path) -> tuple[int, int] | None:
    """Which file stands there; None where there is none."""
    try:
        status = path.stat()
    except OSError:
        return None
    return status.st_dev, status.st_ino


@contextmanager
def connected(path: Path) -> Iterator[sqlite3.Connection]:
    """A connection whose errors are `StoreError`; closing it undoes what was not committed."""
    try:
        # mode=rw never creates; where writing is not allowed, SQLite opens for reading only.
        uri = f"{path.as_uri()}?mode=rw"
        with closing(sqlite3.connect(uri, uri=True, timeout=PATIENCE, isolation_level=None)) as db:
            db.setlimit(sqlite3.SQLITE_LIMIT_LENGTH, LONGEST_ROW)
            for pragma in _PRAGMAS:
                db.execute(pragma)
            yield db
    # In a damaged file, even the text of an error may not be text.
    except (sqlite3.Error, UnicodeDecodeError) as error:
        raise sqlite_fault(path, error) from error
