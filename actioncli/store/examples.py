"""Examples in an open database: finding, adding, reading. Transactions are the caller's."""

from __future__ import annotations

import sqlite3
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from actioncli.errors import StoreError, SupportError, UsageError
from actioncli.store.names import check_label

if TYPE_CHECKING:
    from actioncli.store.record import Record


@dataclass(frozen=True)
class Inserted:
    """What became of a clip: `added` is False where the same clip was there already."""

    example: int
    label: str
    added: bool


@dataclass(frozen=True)
class Example:
    """One enrolled clip; `added` is in UTC (ISO 8601), `checksum` the SHA-256 of its content."""

    id: int
    label: str
    negative: bool
    source: str
    checksum: str
    frames: int
    joints: int
    fps: float
    added: str
    note: str

    @property
    def seconds(self) -> float:
        """From the first frame to the last."""
        return (self.frames - 1) / self.fps

    def to_json(self) -> dict[str, object]:
        """As plain values, without the label."""
        names = "id", "source", "frames", "joints", "fps", "seconds", "added", "note", "checksum"
        return {name: getattr(self, name) for name in names}


def list_examples(db: sqlite3.Connection, label: str | None = None) -> list[Example]:
    """The examples of a label, or all, by label and in the order of enrolment."""
    rows = db.execute(
        "SELECT id, label, negative, source, checksum, frames, joint_count, fps, added, note "
        "FROM examples WHERE ?1 IS NULL OR label = ?1 ORDER BY label, id",
        (label,),
    ).fetchall()
    examples = []
    for number, name, negative, *rest in rows:
        source, checksum, _, _, fps, added, note = rest
        require_label(name)
        require(str, source, checksum, added, note)
        require(float, fps)
        examples.append(Example(number, name, bool(negative), *rest))
    return examples


def insert(db: sqlite3.Connection, record: Record) -> Inserted:
    """Add an example, unless the same clip is there under the same label.

    Raises:
        UsageError: the label holds negatives and this is an action, or the other way round.
    """
    negatives = holds_negatives(db, record.label)
    if negatives is not None and negatives != record.negative:
        there, given = ("negatives", "an action") if negatives else ("an action", "negatives")
        raise UsageError(f"`{record.label}` holds {there}; choose another label for {given}.")
    same = db.execute(
        "SELECT id FROM examples WHERE label = ? AND negative = ? AND checksum = ?",
        (record.label, record.negative, record.checksum),
    ).fetchone()
    if same:
        return Inserted(int(same[0]), record.label, added=False)
    # The next identifier of AUTOINCREMENT: the seal covers it.
    (example,) = db.execute(
        "SELECT 1 + max((SELECT coalesce(max(id), 0) FROM examples), coalesce("
        "(SELECT seq FROM sqlite_sequence WHERE name = 'examples'), 0))"
    ).fetchone()
    insert_as(db, example, record)
    return Inserted(example, record.label, added=True)


def insert_as(db: sqlite3.Connection, example: int, record: Record) -> None:
    """Write an example under a free identifier."""
    from actioncli.store.record import COLUMNS

    values = (example, len(record.joint_names), record.seal(example), *record.row())
    places = ", ".join("?" * len(values))
    db.execute(f"INSERT INTO examples (id, joint_count, seal, {COLUMNS}) VALUES ({places})", values)


def holds_negatives(db: sqlite3.Connection, label: str) -> bool | None:
    """Whether a label holds negatives; None where it is not enrolled."""
    row = db.execute("SELECT negative FROM examples WHERE label = ? LIMIT 1", (label,)).fetchone()
    return bool(row[0]) if row else None


def stored_label(db: sqlite3.Connection, label: str) -> str:
    """The label as it is stored.

    Raises:
        SupportError: it is not enrolled.
    """
    label = check_label(label)
    if holds_negatives(db, label) is None:
        query = "SELECT DISTINCT label FROM examples ORDER BY label"
        enrolled = [f"`{row[0]}`" for row in db.execute(query).fetchall()]
        listed = ", ".join(enrolled[:10]) + (", ..." if len(enrolled) > 10 else "")
        raise SupportError(
            f"`{label}` is not enrolled; "
            + (f"enrolled: {listed}." if enrolled else "nothing is, see `actioncli enroll --help`.")
        )
    return label


def require(kind: type, *values: object) -> None:
    """Raise `sqlite3.DatabaseError` for another type: a flipped bit turns a text into a blob."""
    if not all(isinstance(value, kind) for value in values):
        raise sqlite3.DatabaseError(f"a column that should hold {kind.__name__} does not")


def require_label(label: object) -> None:
    """Raise `sqlite3.DatabaseError` for a label that could not have been enrolled: it goes to
    terminals and to other programs, whoever wrote the file."""
    require(str, label)
    with suppress(UsageError):
        if check_label(str(label)) == label:
            return
    raise sqlite3.DatabaseError(f"the label {str(label)[:100]!a} is none that is allowed")


def read_records(
    db: sqlite3.Connection, path: Path, where: str = "TRUE"
) -> Iterator[tuple[int, Record]]:
    """The examples for which an SQL term is true, in the order of enrolment, one at a time.

    Raises:
        StoreError: one is not what was enrolled.
    """
    for (example,) in db.execute(f"SELECT id FROM examples WHERE {where} ORDER BY id").fetchall():
        yield example, read_record(db, path, example)


def read_outlines(db: sqlite3.Connection, path: Path) -> list[Record]:
    """All examples in the order of enrolment, without the bytes of their recordings.

    Raises:
        StoreError: one cannot be an example; whether it is what was enrolled, `read_record` tells.
    """
    from actioncli.store.record import OUTLINE, Record

    found = []
    for example, *row in db.execute(f"SELECT id, {OUTLINE} FROM examples ORDER BY id").fetchall():
        try:
            found.append(Record.from_row(row))
        except (TypeError, ValueError) as error:
            raise damaged(path, example, row[0]) from error
    return found


def read_record(db: sqlite3.Connection, path: Path, example: int) -> Record:
    """One example that is there, its content checked.

    Raises:
        StoreError: it is not what was enrolled.
    """
    from actioncli.store.record import COLUMNS, Record

    row = db.execute(f"SELECT seal, {COLUMNS} FROM examples WHERE id = ?", (example,)).fetchone()
    if row is None:
        raise sqlite3.DatabaseError(f"example {example} is listed but missing")
    sealed, *row = row
    try:
        record = Record.from_row(row)
        intact = record.intact() and record.seal(example) == sealed
    except (TypeError, ValueError) as error:
        raise damaged(path, example, row[0]) from error
    if not intact:
        raise damaged(path, example, record.label)
    return record


def rename_examples(db: sqlite3.Connection, path: Path, old: str, new: str) -> int:
    """Give all examples of a label another one; how many there are.

    Raises:
        StoreError: one is not what was enrolled; a new seal would hide that.
    """
    from actioncli.store.record import seal

    db.create_function("seal", 7, seal)
    sealed = "seal(id, ?1, negative, source, note, added, checksum)"
    query = f"SELECT id FROM examples WHERE label = ?1 AND seal != {sealed}"
    for (example,) in db.execute(query, (old,)):
        raise damaged(path, example, old)
    query = f"UPDATE examples SET label = ?1, seal = {sealed} WHERE label = ?2"
    return db.execute(query, (new, old)).rowcount


def damaged(path: Path, example: int, label: object) -> StoreError:
    """The error of an example whose content is not what was enrolled."""
    return StoreError(
        f"{path}: example {example} of {label!r} is damaged. `actioncli doctor --repair` sets it "
        "aside; then enrol it again."
    )
