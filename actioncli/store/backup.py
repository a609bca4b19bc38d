"""A verified copy of the store beside it, `support.db.backup`, which follows what is committed.

A commit is followed by a copy at once where the last one is older than a minute, else when the
process ends. What is removed from the store is removed from the copy before that is committed:
it must not stay anywhere.
"""

from __future__ import annotations

import atexit
import os
import sqlite3
import time
from collections.abc import Iterator
from contextlib import closing, contextmanager, suppress
from functools import cache
from pathlib import Path

from actioncli.errors import StoreError
from actioncli.files import sync_folder
from actioncli.store.database import connected, writing
from actioncli.store.health import damage
from actioncli.store.location import beside, exists
from actioncli.store.names import plain_text

# Seconds; a copy of ten thousand examples takes some.
_EVERY = 60.0

# Stores whose copy waits for the end of the process.
_waiting: set[Path] = set()


def backup_path(path: Path) -> Path:
    """Where the copy of a store lies."""
    return beside(path, ".backup")


def _part(path: Path) -> Path:
    """The copy while it is written; the store's write lock keeps others from it."""
    return beside(path, ".backup.part")


@contextmanager
def changing(path: Path, erases: bool = False) -> Iterator[sqlite3.Connection]:
    """A write transaction as `database.writing` has it, which the copy follows.

    A copy that cannot be made is logged, and no error: what was committed stands.

    Args:
        erases: examples or settings are taken away.

    Raises:
        StoreError: as `writing`, or the copy cannot be deleted.
    """
    if is_lost(path):
        raise StoreError(lost_store(path))
    with writing(path) as db:
        before = db.total_changes
        yield db
        changed = db.total_changes > before
        if erases and changed:
            _prune(path, db)
    if not changed:
        return
    copy, age = backup_path(path), _EVERY
    with suppress(OSError):
        # What others laid there is none.
        age = _EVERY if copy.is_symlink() else time.time() - copy.stat().st_mtime
    if not 0 <= age < _EVERY:
        _waiting.discard(path)
        make_backup(path)
        return
    if not _waiting:
        atexit.register(finish_backups)
    _waiting.add(path)


def is_lost(path: Path) -> bool:
    """Whether a store's file is gone or empty, and its copy is not.

    Raises:
        StoreError: something else has the store's name.
    """
    copy = backup_path(path)
    with suppress(OSError):  # what may not be looked at is told by who opens it
        empty = not exists(path) or not path.stat().st_size
        return empty and copy.is_file() and not copy.is_symlink() and copy.stat().st_size > 0
    return False


def lost_store(path: Path) -> str:
    """What to say of a store whose file is gone or empty, beside its copy."""
    return (
        f"{path} is gone or empty, but its copy {backup_path(path)} is there: `actioncli doctor "
        "--repair` brings it back; or delete the copy, to begin anew."
    )


def finish_backups() -> None:
    """Make the copies that wait."""
    while _waiting:
        make_backup(_waiting.pop())


def make_backup(path: Path) -> bool:
    """Copy the store, look at every example of the copy, and put it in the last one's place.

    Returns:
        Whether there is a copy of the store as it is now. The last one stays where the store is
        damaged, or the disk is full; a line in the log, which goes to standard error, says so.
    """
    part = _part(path)
    try:
        if not exists(path):
            return False
        # Nobody else writes meanwhile, neither the store nor the copy. A connection that may write
        # cannot be copied from.
        with connected(path) as alone, connected(path) as db:
            alone.execute("BEGIN IMMEDIATE")
            try:
                part.unlink(missing_ok=True)
                part.touch(0o600, exist_ok=False)
                with closing(sqlite3.connect(part)) as copy:
                    # An unfinished copy is of no use to anybody: no journal, one sync.
                    copy.execute("PRAGMA journal_mode = OFF")
                    copy.execute("PRAGMA synchronous = OFF")
                    db.backup(copy)
                if found := damage(part):
                    raise StoreError(found[0].replace(str(part), str(path)))
                with part.open("rb+") as file:
                    os.fsync(file.fileno())
                part.replace(backup_path(path))
            finally:
                part.unlink(missing_ok=True)
        sync_folder(path.parent)
    except (StoreError, OSError, sqlite3.Error) as error:
        _log(f"{backup_path(path)}: this copy cannot be renewed: {error.__cause__ or error}")
        return False
    return True


@cache
def _log(line: str) -> None:
    """Once in a process; without handlers it is a line on standard error."""
    import logging

    logging.getLogger("actioncli").warning("%s", plain_text(line, 1000))


def _prune(path: Path, db: sqlite3.Connection) -> None:
    """Take out of the copy what the open transaction takes out of the store.

    Raises:
        StoreError: it can neither be changed nor deleted.
    """
    copy = backup_path(path)
    try:
        _part(path).unlink(missing_ok=True)
        if not copy.is_file() or copy.is_symlink():
            return
        try:
            seen = copy.stat()
            with connected(copy) as spare:
                # A journal would hold what is removed.
                spare.execute("PRAGMA journal_mode = MEMORY")
                spare.execute("BEGIN IMMEDIATE")
                for table, key in (("examples", "id"), ("settings", "name")):
                    query = f"SELECT {key} FROM {table}"
                    gone = set(spare.execute(query)) - set(db.execute(query))
                    spare.executemany(f"DELETE FROM {table} WHERE {key} = ?", gone)
                spare.execute("COMMIT")
            # It is as old as before: what came since it was made is still missing.
            os.utime(copy, ns=(seen.st_atime_ns, seen.st_mtime_ns))
        except StoreError:  # it is damaged
            copy.unlink()
    except OSError as error:
        raise StoreError(
            f"{copy}: this copy would keep what is removed, and cannot be deleted: "
            f"{error.strerror}. Nothing was removed."
        ) from error


def backup_flaw(path: Path) -> str | None:
    """What is wrong with the copy of a store that is there; None where it is as it should be."""
    copy = backup_path(path)
    with suppress(FileNotFoundError):
        if copy.stat().st_mtime < path.stat().st_mtime:
            return f"{copy} is older than the support set; the next change renews it"
        if damage(copy):
            return f"{copy} is damaged; the next change renews it"
        return None
    return f"there is no {copy}; the next change makes it"
