"""Repairing a damaged store: what it still holds goes into a new file, the damaged one is kept.

Nothing is taken away before all that replaces it is on the disk, so that a repair that is
interrupted at any moment leaves what was there, or what it made of it.
"""

from __future__ import annotations

import os
import shutil
import sys
import tempfile
import time
import zlib
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from mmap import ACCESS_READ, mmap
from operator import ne
from pathlib import Path
from typing import BinaryIO

from actioncli.errors import StoreError
from actioncli.store.database import writing
from actioncli.store.examples import place
from actioncli.store.faults import system_fault
from actioncli.store.health import damage
from actioncli.store.location import exists, sync_folder
from actioncli.store.migrations import MIGRATIONS, schema_of
from actioncli.store.salvage import Gone, Salvage, salvage
from actioncli.store.settings import put_setting

# Seconds that a reader or a short write may take to leave the store alone.
_PATIENCE = 2.0
# The bytes that SQLite locks, at their place in every database: a writer holds some of them.
_LOCK_START, _LOCK_LENGTH = 0x40000000, 512
# Letters of a statement of the schema that damage may have changed.
_MOST_FLIPPED = 8


@dataclass(frozen=True)
class Repair:
    """What a repair did.

    Attributes:
        kept: where the damaged file lies now.
        labels: of the examples that were salvaged, by identifier.
        doubtful: those of them whose source, note or time may have changed.
        gone: the examples that are lost, as far as they can be named.
        settings_gone: names of the settings that are lost.
        complete: whether that is all that is lost.
    """

    kept: Path
    labels: dict[int, str]
    doubtful: tuple[int, ...]
    gone: tuple[Gone, ...]
    settings_gone: tuple[str, ...]
    complete: bool


# Bytes, on the file systems in use.
_LONGEST_NAME = 255


def repair(path: Path) -> Repair | None:
    """Put a whole store in the place of a damaged one; None where nothing is damaged.

    Raises:
        StoreError: another process uses it, it is no support set, or one of a newer release, or
            there is no room for a second one.
    """
    if not exists(path):
        return None
    try:
        with _alone(path) as file, _workshop(path) as folder:
            copy = folder / "damaged.db"
            _copy(file, copy)
            journal = _beside(path, "-journal")
            if journal.is_file():
                shutil.copyfile(journal, _beside(copy, "-journal"))
            # Reading it plays back its journal, as reading the store itself would.
            if not damage(copy):
                return None
            whole = folder / "whole.db"
            found = _salvage(copy, whole, path)
            if damage(whole):
                raise StoreError(f"{path}: what could be salvaged is damaged again; is the disk?")
            kept = _keep(file, path, folder)
            if journal.is_file():
                # A journal belongs to what it can play back, never to the file that comes now.
                _overwrite(file, copy)
                journal.unlink()
                sync_folder(path.parent)
            if os.name == "nt":
                file.close()
            whole.replace(path)
            sync_folder(path.parent)
    except OSError as error:
        raise system_fault(path, error, "cannot be repaired") from error
    return Repair(
        kept, found.labels, tuple(found.doubtful), tuple(found.gone), tuple(found.settings_gone),
        found.complete,
    )  # fmt: skip


@contextmanager
def _alone(path: Path) -> Iterator[BinaryIO]:
    """The store's file, opened, while no other process may read or write it.

    Until it is closed, nothing else in this process may open it: closing that would end the lock.
    """
    with path.open("r+b") as file:
        # Elsewhere a file that is open cannot be replaced, so that the last step fails.
        if sys.platform != "win32":
            import fcntl

            end = time.monotonic() + _PATIENCE
            while True:
                try:
                    fcntl.lockf(file, fcntl.LOCK_EX | fcntl.LOCK_NB, _LOCK_LENGTH, _LOCK_START)
                    break
                except (BlockingIOError, PermissionError) as error:
                    if time.monotonic() > end:
                        raise StoreError(
                            f"{path} is in use by another program. Wait for it or end it, then "
                            "repair again."
                        ) from error
                time.sleep(0.05)
        yield file


@contextmanager
def _workshop(path: Path) -> Iterator[Path]:
    """A folder beside the store, for its owner only, that is removed at the end."""
    prefix = f".repair-{zlib.crc32(os.fsencode(path.name)):08x}-"
    # Nobody else repairs this store now: what is there was left by a repair that was interrupted.
    for left in path.parent.glob(f"{prefix}*"):
        shutil.rmtree(left, ignore_errors=True)
    folder = Path(tempfile.mkdtemp(prefix=prefix, dir=path.parent))
    try:
        yield folder
    finally:
        shutil.rmtree(folder, ignore_errors=True)


def _salvage(copy: Path, whole: Path, path: Path) -> Salvage:
    """Fill the store `whole` with what the file `copy` still holds."""
    with writing(whole) as db:
        expected = schema_of(db)
    if _is_newer(copy, expected):
        raise StoreError(
            f"{path} was written by a newer release: update actioncli, and repair it with that."
        )
    size = copy.stat().st_size
    with writing(whole) as db, copy.open("rb") as file:
        content = mmap(file.fileno(), 0, access=ACCESS_READ) if size else b""
        found = salvage(content, lambda example, record: place(db, example, record))
        if isinstance(content, mmap):
            content.close()
        if not found.ours:
            raise StoreError(
                f"{path}: nothing of a support set was found in it, and it was left as it is. Move "
                "it away to begin anew, or name another file with --store or ACTIONCLI_HOME."
            )
        for name, value in found.settings.items():
            put_setting(db, name, value)
        # What was lost gives its number to no other example either.
        db.execute("DELETE FROM sqlite_sequence WHERE name = 'examples'")
        db.execute("INSERT INTO sqlite_sequence VALUES ('examples', ?)", (found.last,))
    return found


def _is_newer(copy: Path, expected: list[str]) -> bool:
    """Whether the file can be read so far that it tells of a schema that this release lacks."""
    import sqlite3
    from contextlib import closing

    try:
        with closing(sqlite3.connect(f"{copy.as_uri()}?mode=ro", uri=True)) as db:
            (version,) = db.execute("PRAGMA user_version").fetchone()
            # A version that is only a flipped bit has the schema that is known.
            return version > len(MIGRATIONS) and not _is_known(schema_of(db), expected)
    except (sqlite3.Error, UnicodeDecodeError):
        return False


def _is_known(schema: list[str], expected: list[str]) -> bool:
    """Whether these are the expected statements, but for a few flipped bits in each."""
    return len(schema) == len(expected) and all(
        any(len(one) == len(each) and sum(map(ne, one, each)) <= _MOST_FLIPPED for each in expected)
        for one in schema
    )


def _keep(file: BinaryIO, path: Path, folder: Path) -> Path:
    """Copy the damaged store, and its journal, to a name beside it that is free; that name.

    What has the name is complete, whenever this is interrupted: it comes from `folder`.
    """
    number = 1
    while True:
        suffix = ".damaged" if number == 1 else f".damaged-{number}"
        # A name that leaves no room for what is appended to it loses its end.
        room = _LONGEST_NAME - len(suffix) - len("-journal")
        kept = path.with_name(os.fsencode(path.name)[:room].decode(errors="ignore") + suffix)
        if not os.path.lexists(kept) and not os.path.lexists(_beside(kept, "-journal")):
            break
        number += 1
    copy = folder / "kept.db"
    _copy(file, copy)
    journal = _beside(path, "-journal")
    if journal.is_file():
        with journal.open("rb") as source:
            _copy(source, _beside(copy, "-journal"))
        _beside(copy, "-journal").rename(_beside(kept, "-journal"))
    copy.rename(kept)
    sync_folder(path.parent)
    return kept


def _beside(path: Path, suffix: str) -> Path:
    return path.with_name(path.name + suffix)


def _copy(source: BinaryIO, target: Path) -> None:
    """Copy an open file to a new one that only its owner can read, down to the disk."""
    source.seek(0)
    descriptor = os.open(target, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600)
    with os.fdopen(descriptor, "wb") as file:
        shutil.copyfileobj(source, file)
        file.flush()
        os.fsync(file.fileno())


def _overwrite(file: BinaryIO, copy: Path) -> None:
    """Play back the journal: give the open file the content of its recovered copy."""
    file.seek(0)
    with copy.open("rb") as source:
        shutil.copyfileobj(source, file)
    file.truncate()
    file.flush()
    os.fsync(file.fileno())
