"""What a batch has found out: kept file by file while it runs, one table at its end.

While a run lasts, `OUTPUT.partial`, an SQLite database, holds the list of files and, as soon as it
is known, the row of each. However a run ends, the next one goes on from there; neither the list
nor the rows have to fit in memory. At the end the rows are written to `OUTPUT` in the order of
the files' names, and the database goes away. A later run takes over what a Parquet file holds; CSV
does not say what it was made with, and begins anew. Two runs that found the same write the same
bytes. Parquet needs the extra `ray`.
"""

from __future__ import annotations

import csv
import json
import os
import re
import sqlite3
from collections.abc import Iterable, Iterator, Mapping
from contextlib import closing, contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

from actioncli.errors import ClipError, UsageError
from actioncli.files import replacing

if TYPE_CHECKING:
    import pyarrow as pa

Row = dict[str, Any]

# Name to type, as Arrow has them.
COLUMNS = {
    "source": "string",
    "label": "string",
    "accepted": "bool",
    "confidence": "float64",
    "tau": "float64",
    "nearest": "string",
    "distance": "float64",
    "nearest_negative": "float64",
    "part_start": "float64",
    "part_end": "float64",
    "frames": "int64",
    "seconds": "float64",
    "notes": "strings",
    "error_type": "string",
    "error": "string",
    "size": "int64",
    "mtime_ns": "int64",
}
SUFFIXES = (".csv", ".parquet")
_METADATA = b"actioncli"
_LOCKED = "database is locked"
# Rows that are in memory at once when a Parquet file is read or written.
_CHUNK = 5_000
# A byte that is no UTF-8, as Python has it in a name, escaped.
_HALF = re.compile(r"\\u(dc[89a-f][0-9a-f])")


class Results:
    """The rows of one output."""

    def __init__(self, output: Path, basis: Mapping[str, str], database: sqlite3.Connection):
        """Of a database that is there; see `opened`."""
        self._output, self._basis, self._database = output, dict(basis), database

    @classmethod
    @contextmanager
    def opened(cls, output: Path, basis: Mapping[str, str]) -> Iterator[Results]:
        """Begin, or go on with what is there; no other run may write this output meanwhile.

        Args:
            output: the file that is to hold the table, `.csv` or `.parquet`.
            basis: what decisions depend on, name to value.

        Raises:
            UsageError: another run writes it, or it was made on another basis.
            ClipError: it is damaged, or not what this class writes, or cannot be written.
        """
        partial = _partial(output)
        if not partial.exists():
            _check(output, basis)
        try:
            partial.touch(mode=0o600)
            # A statement is a transaction of its own, unless `_transaction` makes a larger one.
            with closing(sqlite3.connect(partial, timeout=0, isolation_level=None)) as database:
                results = cls(output, basis, database)
                results._begin()
                yield results
        except sqlite3.Error as error:
            if str(error) == _LOCKED:
                raise UsageError(
                    f"{output}: another run of `batch` is writing it; wait for that one, or name "
                    "another output."
                ) from error
            raise ClipError(
                f"{partial}: cannot be used: {error}; where it is damaged, delete it."
            ) from error

    def _begin(self) -> None:
        run = self._database.execute
        # Also on drives that share no memory between machines; a kill loses no row.
        run("PRAGMA locking_mode = EXCLUSIVE")
        run("PRAGMA journal_mode = WAL")
        run("PRAGMA synchronous = NORMAL")
        if not _partial(self._output).exists():  # another run came to its end just now
            raise sqlite3.OperationalError(_LOCKED)
        with _transaction(self._database):
            run("CREATE TABLE IF NOT EXISTS basis (name TEXT PRIMARY KEY, value TEXT)")
            run(
                "CREATE TABLE IF NOT EXISTS files (source TEXT PRIMARY KEY, size INTEGER, "
                "mtime_ns INTEGER, failed INTEGER, row TEXT) WITHOUT ROWID"
            )
            before = dict(run("SELECT name, value FROM basis"))
            if before:
                _compare(_partial(self._output), before, self._basis)
            else:
                self._database.executemany("INSERT INTO basis VALUES (?, ?)", self._basis.items())
                self._take_over()
            run("UPDATE files SET row = NULL WHERE failed")

    def _take_over(self) -> None:
        """The rows of an earlier run that came to its end."""
        if not self._output.exists() or _is_csv(self._output):
            return
        import pyarrow as pa
        import pyarrow.parquet as pq

        with _reading(self._output), pq.ParquetFile(self._output) as file:
            for batch in file.iter_batches(_CHUNK):
                rows = pa.Table.from_batches([batch]).cast(schema()).to_pylist()
                self._database.executemany(
                    "INSERT INTO files VALUES (?, ?, ?, ?, ?)", map(_values, rows)
                )

    def set_files(self, paths: Iterable[Path]) -> None:
        """Say which files there are: rows of others, and of files that have changed, go.

        Args:
            paths: absolute, in any order.
        """
        with _transaction(self._database):
            self._database.execute("CREATE TEMP TABLE listed (source TEXT PRIMARY KEY)")
            for path in paths:
                source = storable(str(path))
                size, mtime_ns = _state(path)
                self._database.execute("INSERT OR IGNORE INTO listed VALUES (?)", (source,))
                self._database.execute(
                    "INSERT INTO files VALUES (?, ?, ?, 0, NULL) ON CONFLICT (source) DO UPDATE "
                    "SET row = CASE WHEN size IS excluded.size AND mtime_ns IS excluded.mtime_ns "
                    "THEN row END, size = excluded.size, mtime_ns = excluded.mtime_ns",
                    (source, size, mtime_ns),
                )
            self._database.execute("DELETE FROM files WHERE source NOT IN listed")
            self._database.execute("DROP TABLE listed")

    def missing(self, most: int, after: str = "") -> list[str]:
        """The first files, by name, whose row is not known yet.

        Args:
            most: so many of them.
            after: a name; only those behind it.
        """
        found = self._database.execute(
            "SELECT source FROM files WHERE row IS NULL AND source > ? ORDER BY source LIMIT ?",
            (after, most),
        )
        return [source for (source,) in found]

    def add(self, row: Row) -> None:
        """Keep a row: from now on nothing but a power loss takes it away."""
        source, _, _, *values = _values(row)
        update = "UPDATE files SET failed = ?, row = ? WHERE source = ?"
        self._database.execute(update, (*values, source))

    def count(self) -> dict[str, int]:
        """How many `files` there are, and of them `done`, `accepted`, `rejected`, `failed`."""
        found = self._database.execute(
            "SELECT count(*), count(row), ifnull(sum(json_extract(row, '$.accepted')), 0), "
            "ifnull(sum(NOT json_extract(row, '$.accepted')), 0), "
            "ifnull(sum(failed AND row NOTNULL), 0) FROM files"
        )
        names = ("files", "done", "accepted", "rejected", "failed")
        return dict(zip(names, next(found), strict=True))

    def finish(self) -> None:
        """Write `OUTPUT`; nothing more can be added.

        Raises:
            ClipError: it cannot be written.
        """
        rows = self._rows()
        with replacing(self._output, failure=ClipError) as part:
            (_write_csv if _is_csv(self._output) else _write_parquet)(part, rows, self._basis)
        # While it is still held, and first the file beside it that closing would look for.
        self._database.execute("PRAGMA journal_mode = DELETE")
        _partial(self._output).unlink()
        self._database.close()

    def _rows(self) -> Iterator[list[Row]]:
        """What there is, in order, many rows at a time."""
        names = ("source", "size", "mtime_ns")
        found = self._database.execute(
            "SELECT row, source, size, mtime_ns FROM files WHERE row NOTNULL ORDER BY source"
        )
        while chunk := found.fetchmany(_CHUNK):
            yield [json.loads(row) | dict(zip(names, of, strict=True)) for row, *of in chunk]


def schema() -> pa.Schema:
    """The columns of the Parquet file."""
    import pyarrow as pa

    strings = pa.list_(pa.string())
    kinds = {name: pa.type_for_alias(kind) for name, kind in COLUMNS.items() if kind != "strings"}
    return pa.schema([(name, kinds.get(name, strings)) for name in COLUMNS])


def _write_parquet(file: Path, rows: Iterable[list[Row]], basis: Mapping[str, str]) -> None:
    import pyarrow as pa
    import pyarrow.parquet as pq

    header = json.dumps({"format": 1, **basis})
    with pq.ParquetWriter(file, schema().with_metadata({_METADATA: header})) as writer:
        for some in rows:
            writer.write_table(pa.Table.from_pylist(some, writer.schema))


def _write_csv(file: Path, rows: Iterable[list[Row]], _: Mapping[str, str]) -> None:
    with file.open("w", encoding="utf-8", newline="") as out:
        writer = csv.DictWriter(out, list(COLUMNS))
        writer.writeheader()
        for some in rows:
            writer.writerows({**row, "notes": "; ".join(row.get("notes", ()))} for row in some)


def storable(text: str) -> str:
    """Text as a table can hold it: half characters are escaped. JSON can have them, and for Python
    they stand for bytes of a file's name that are no UTF-8."""
    return text.encode(errors="backslashreplace").decode()


def file_named(source: str) -> str:
    """The file whose name `storable` made this of."""
    return source if os.path.lexists(source) else _HALF.sub(lambda h: chr(int(h[1], 16)), source)


def _is_csv(output: Path) -> bool:
    return output.suffix.lower() == ".csv"


def _partial(output: Path) -> Path:
    return output.with_name(output.name + ".partial")


@contextmanager
def _transaction(database: sqlite3.Connection) -> Iterator[None]:
    """All or nothing."""
    database.execute("BEGIN")
    with database:
        yield


def _state(path: Path) -> tuple[int | None, int | None]:
    """Size and time of change by which a changed file is noticed; None where there is none."""
    try:
        found = path.stat()
        return found.st_size, found.st_mtime_ns
    except (OSError, ValueError):
        return None, None


def _values(row: Row) -> tuple[object, ...]:
    """A row as the columns of the table `files`."""
    values = {name: value for name, value in row.items() if value is not None}
    state = [values.pop(name, None) for name in ("source", "size", "mtime_ns")]
    return (*state, "error" in values, json.dumps(values))


@contextmanager
def _reading(path: Path) -> Iterator[None]:
    """Whatever reading an output stumbles on: it is somebody else's."""
    try:
        yield
    except (OSError, LookupError, RuntimeError, TypeError, ValueError, csv.Error) as error:
        raise ClipError(
            f"{path}: is no output of `actioncli batch` ({type(error).__name__}); it is not "
            "written over: name another OUTPUT, or delete it."
        ) from error


def _check(output: Path, basis: Mapping[str, str]) -> None:
    """Refuse an output that is another's, or was made otherwise, before anything is written."""
    if not output.exists():
        return
    with _reading(output):
        if _is_csv(output):
            with output.open(encoding="utf-8", newline="") as file:
                if next(csv.reader(file), None) != list(COLUMNS):
                    raise ValueError
            return
        import pyarrow.parquet as pq

        header = json.loads(pq.read_schema(output).metadata[_METADATA])
    _compare(output, header, basis)


def _compare(path: Path, before: Mapping[str, str], basis: Mapping[str, str]) -> None:
    changed = [name for name, value in basis.items() if before.get(name) != value]
    if changed:
        raise UsageError(
            f"{path}: was made with another {' and '.join(changed)}; decisions are not mixed: "
            "name another OUTPUT, or delete it."
        )
