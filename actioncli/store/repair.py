"""Repairing a damaged store: what can be read of it goes into a new file, what is missing comes
from the copy beside it, the damaged file is kept.

Nothing is taken away before all that replaces it is on the disk, so that a repair that is
interrupted at any moment leaves what was there, or what it made of it.
"""

from __future__ import annotations

import os
import shutil
import sqlite3
import tempfile
import time
import zlib
from collections.abc import Iterator
from contextlib import closing, contextmanager, suppress
from dataclasses import asdict, dataclass, field
from itertools import count
from pathlib import Path
from typing import Any, BinaryIO

from actioncli.errors import ActionCliError, StoreError
from actioncli.files import lock_bytes, replace_open, sync_folder
from actioncli.store.backup import backup_path, is_lost, make_backup
from actioncli.store.database import LONGEST_ROW, writing
from actioncli.store.examples import insert_as, read_record, require_label
from actioncli.store.faults import system_fault
from actioncli.store.health import damage
from actioncli.store.location import beside, exists, prepare
from actioncli.store.migrations import MIGRATIONS, is_as_made
from actioncli.store.record import COLUMNS, Record, find_flaw
from actioncli.store.settings import intact_setting, put_setting

# Seconds that a reader or a short write may take to leave the store alone.
_PATIENCE = 2.0
# The bytes that SQLite locks, at their place in every database: a writer holds some of them.
_LOCK_START, _LOCK_LENGTH = 0x40000000, 512
# Identifiers between two damaged pages that are tried one by one.
_MOST_TRIED = 100_000
_INDEXED = "INDEXED BY sqlite_autoindex_examples_1"
# What reading a damaged database raises.
_UNREADABLE = (sqlite3.Error, ActionCliError, UnicodeDecodeError, TypeError, ValueError)


@dataclass(frozen=True)
class Gone:
    """An example that could be named, but not read."""

    id: int
    label: str
    why: str


@dataclass
class Repair:
    """What a repair did.

    Attributes:
        kept: where the damaged file lies now.
        labels: of the examples that are there again, by identifier.
        doubtful: those of them whose source, note or time may have changed.
        gone: the examples that are lost, as far as they can be named.
        settings_gone: names of the settings that are lost.
        complete: whether that is all that is lost.
    """

    kept: Path = field(default_factory=Path)
    labels: dict[int, str] = field(default_factory=dict)
    doubtful: list[int] = field(default_factory=list)
    gone: list[Gone] = field(default_factory=list)
    settings_gone: list[str] = field(default_factory=list)
    complete: bool = True

    def to_json(self) -> dict[str, object]:
        """As plain values; how many examples were salvaged, not which."""
        return {
            "kept": str(self.kept),
            "salvaged": len(self.labels),
            "doubtful": self.doubtful,
            "gone": [asdict(each) for each in self.gone],
            "settings_gone": self.settings_gone,
            "complete": self.complete,
        }


def repair(path: Path) -> Repair | None:
    """Put a whole store in the place of a damaged one; None where nothing is damaged.

    Raises:
        StoreError: another process uses it, it is no support set, or one of a newer release, or
            there is no room for a second one.
    """
    lost = is_lost(path)
    if lost:
        prepare(path)
    elif not exists(path):
        return None
    try:
        with _alone(path) as file, _workshop(path) as folder:
            copy = folder / "damaged.db"
            _copy(file, copy)
            journal = _journal(path)
            if journal.is_file():
                shutil.copyfile(journal, _journal(copy))
            # Reading it plays back its journal, as reading the store itself would.
            if not lost and not damage(copy):
                return None
            whole = folder / "whole.db"
            done = _rebuild(copy, whole, path)
            if damage(whole):
                raise StoreError(f"{path}: what could be read is damaged again; is the disk?")
            done.kept = _keep(file, path, folder)
            if journal.is_file():
                # A journal belongs to what it can play back, never to the file that comes now.
                file.seek(0)
                with copy.open("rb") as recovered:
                    shutil.copyfileobj(recovered, file)
                file.truncate()
                file.flush()
                os.fsync(file.fileno())
                journal.unlink()
                sync_folder(path.parent)
            replace_open(whole, path, file)
            sync_folder(path.parent)
    except OSError as error:
        raise system_fault(path, error, "cannot be repaired") from error
    make_backup(path)
    return done


def _rebuild(copy: Path, whole: Path, path: Path) -> Repair:
    """Fill the store `whole` with what can be read of the file `copy`, and of the store's copy.

    Raises:
        StoreError: nothing of a support set is in either, or a newer release wrote it.
    """
    done = Repair()
    backup = backup_path(path)
    with _opened(copy) as damaged, _opened(backup) as spare, writing(whole) as db:
        if damaged.is_newer:
            raise StoreError(
                f"{path} was written by a newer release: update actioncli, and repair it with that."
            )
        labels = spare.labels | damaged.labels
        ids = sorted(damaged.labels.keys() | spare.labels.keys() | damaged.unlisted())
        for example in ids:
            record = damaged.record(example) or spare.record(example)
            doubtful = damaged.doubtful(example) if record is None else None
            if found := record or doubtful:
                insert_as(db, example, found)
                done.labels[example] = found.label
                if doubtful:
                    done.doubtful.append(example)
            elif example in labels:
                done.gone.append(Gone(example, labels[example], "its recording is damaged"))
        copied, read = spare.settings(), damaged.settings()
        # What is damaged does not take the place of what was copied.
        intact = {name: value for name, value in read.items() if value is not None}
        settings = read | copied | intact
        for name, value in settings.items():
            if value is None:
                done.settings_gone.append(name)
            else:
                put_setting(db, name, value)
        done.complete = damaged.complete
        if not (done.labels or done.gone or settings):
            raise StoreError(
                f"{path}: nothing of a support set was found in it, and it was left as it is. Move "
                "it away to begin anew, or name another file with --store or ACTIONCLI_HOME."
            )
        # What was lost gives its number to no other example either.
        last = max([damaged.last, spare.last, *ids])
        db.execute("DELETE FROM sqlite_sequence WHERE name = 'examples'")
        db.execute("INSERT INTO sqlite_sequence VALUES ('examples', ?)", (last,))
    return done


class _Readable:
    """What plain queries still read of a database that may be damaged; all of it is proved.

    Attributes:
        labels: of the examples, by identifier, as the table or the index over it lists them.
        complete: whether that is all of them, and all settings can be read.
        last: the highest identifier that was ever given, as far as that can be read.
        is_newer: whether a release after this one made it.
    """

    def __init__(self, db: sqlite3.Connection) -> None:
        """Read what is listed."""
        self._db, self._ours = db, True
        version, _ = self._rows("PRAGMA user_version")
        schemas = range(1, len(MIGRATIONS) + 1)
        # A table that somebody else made could be a view that never ends.
        self._ours = any(is_as_made(db, "examples", number) for number in schemas)
        self.is_newer = bool(version) and version[0][0] > len(MIGRATIONS) and not self._ours
        self.labels: dict[int, str] = {}
        read = []
        for hint, order in (
            (_INDEXED, "label, negative, checksum"),
            (_INDEXED, "label DESC, negative DESC, checksum DESC"),
            ("NOT INDEXED", "id"),
            ("NOT INDEXED", "id DESC"),
        ):
            rows, whole = self._rows(f"SELECT id, label FROM examples {hint} ORDER BY {order}")
            found = {number: label for number, label in rows if _could_be(number, label)}
            self.labels = found | self.labels
            read.append(whole and len(found) == len(rows))
        sequence, _ = self._rows("SELECT seq FROM sqlite_sequence WHERE name = 'examples'")
        last = sequence[0][0] if sequence else 0
        self.last = last if isinstance(last, int) and 0 <= last < 2**31 else 0
        self.complete = any(read) and self._rows("SELECT count(*) FROM settings NOT INDEXED")[1]

    def _rows(self, query: str, *values: object) -> tuple[list[Any], bool]:
        """The rows of a query as far as they can be read, and whether these are all."""
        found: list[Any] = []
        try:
            if self._ours:
                found.extend(self._db.execute(query, values))
        except _UNREADABLE:
            return found, False
        return found, self._ours

    def unlisted(self) -> set[int]:
        """Identifiers of examples that may hide between damaged pages."""
        last = max([self.last, *self.labels])
        return set(range(1, last + 1)) if last <= _MOST_TRIED else set()

    def record(self, example: int) -> Record | None:
        """An example that is proved to be what was enrolled."""
        try:
            return read_record(self._db, Path(), example) if self._ours else None
        except _UNREADABLE:
            return None

    def doubtful(self, example: int) -> Record | None:
        """An example whose recording is proved by its checksum, and its label by the index; its
        source, note or time may have changed."""
        listed = f"SELECT label, negative, checksum FROM examples {_INDEXED} WHERE id = ?"
        proofs, _ = self._rows(listed, example)
        rows, _ = self._rows(f"SELECT {COLUMNS} FROM examples NOT INDEXED WHERE id = ?", example)
        for row in rows:
            with suppress(*_UNREADABLE):
                record = Record.from_row(row)
                proof = (record.label, int(record.negative), record.checksum)
                if find_flaw(record) is None and proof in proofs:
                    return record
        return None

    def settings(self) -> dict[str, str | None]:
        """Settings by name; None for one that is damaged."""
        names, _ = self._rows("SELECT name FROM settings ORDER BY name")
        rows, _ = self._rows("SELECT name, value, crc FROM settings NOT INDEXED")
        texts = [name for (name,) in names if isinstance(name, str) and name.isprintable()]
        found = dict[str, str | None].fromkeys(texts)
        return found | {row[0]: row[1] for row in rows if intact_setting(*row)}


def _could_be(number: object, label: object) -> bool:
    """Whether an identifier and a label could be those of an example."""
    with suppress(sqlite3.DatabaseError):
        require_label(label)
        return isinstance(number, int) and 0 < number < 2**31
    return False


@contextmanager
def _opened(path: Path) -> Iterator[_Readable]:
    """A database that may be damaged, or not be there."""
    name = f"{path.as_uri()}?mode=rw" if path.is_file() and not path.is_symlink() else ":memory:"
    with closing(sqlite3.connect(name, uri=True, isolation_level=None)) as db:
        db.setlimit(sqlite3.SQLITE_LIMIT_LENGTH, LONGEST_ROW)
        for pragma in ("trusted_schema = OFF", "cell_size_check = ON", "query_only = ON"):
            db.execute(f"PRAGMA {pragma}")
        yield _Readable(db)


@contextmanager
def _alone(path: Path) -> Iterator[BinaryIO]:
    """The store's file, opened, while no other process may read or write it.

    Until it is closed, nothing else in this process may open it: closing that would end the lock.
    """
    end = time.monotonic() + _PATIENCE
    with path.open("r+b") as file:
        while not lock_bytes(file, _LOCK_START, _LOCK_LENGTH):
            if time.monotonic() > end:
                raise StoreError(
                    f"{path} is in use by another program. Wait for it or end it, then repair "
                    "again."
                )
            time.sleep(0.05)
        yield file


@contextmanager
def _workshop(path: Path) -> Iterator[Path]:
    """A folder beside the store, for its owner only, that is removed at the end."""
    prefix = f".repair-{zlib.crc32(os.fsencode(path.name)):08x}-"
    # Nobody else repairs this store now: what is there was left by a repair that was interrupted.
    for left in path.parent.glob(f"{prefix}*"):
        shutil.rmtree(left, ignore_errors=True)
    with tempfile.TemporaryDirectory(
        prefix=prefix, dir=path.parent, ignore_cleanup_errors=True
    ) as folder:
        yield Path(folder)


def _keep(file: BinaryIO, path: Path, folder: Path) -> Path:
    """Copy the damaged store, and its journal, to a name beside it that is free; that name.

    What has the name is complete, whenever this is interrupted: it comes from `folder`.
    """
    names = (
        beside(path, f".damaged-{number}" if number > 1 else ".damaged") for number in count(1)
    )
    kept = next(name for name in names if not any(map(os.path.lexists, (name, _journal(name)))))
    copy = folder / "kept.db"
    _copy(file, copy)
    journal = _journal(path)
    if journal.is_file():
        with journal.open("rb") as source:
            _copy(source, _journal(copy))
        _journal(copy).rename(_journal(kept))
    copy.rename(kept)
    sync_folder(path.parent)
    return kept


def _journal(path: Path) -> Path:
    return path.with_name(path.name + "-journal")


def _copy(source: BinaryIO, target: Path) -> None:
    """Copy an open file to a new one that only its owner can read, down to the disk."""
    source.seek(0)
    target.touch(0o600, exist_ok=False)
    with target.open("wb") as file:
        shutil.copyfileobj(source, file)
        file.flush()
        os.fsync(file.fileno())
