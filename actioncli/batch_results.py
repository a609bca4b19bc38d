"""What a batch has found out: a Parquet file that grows by parts and is whole at any moment.

`OUTPUT` holds one row for each file that was looked at. While a run lasts, its rows are added to
the folder `OUTPUT.parts`, every few seconds another file; at the end of the run they are merged
into `OUTPUT` and the folder goes away. A run that ended early is merged by the next one. Every
file is written under another name first and renamed: a kill leaves rows out, never half a row.
Each file carries what its decisions depend on, so that decisions under different weights, support
sets or thresholds are never mixed. Needs the extra `ray`.
"""

from __future__ import annotations

import json
import shutil
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import pyarrow as pa
import pyarrow.parquet as pq

from actioncli.errors import ClipError, UsageError
from actioncli.replacing import replacing

Row = dict[str, Any]

# The error of a file whose worker process died each time; the next run tries it again.
WORKER_DIED = "WorkerDied"

SCHEMA = pa.schema(
    [
        ("source", pa.string()),
        ("label", pa.string()),
        ("accepted", pa.bool_()),
        ("confidence", pa.float64()),
        ("tau", pa.float64()),
        ("nearest", pa.string()),
        ("distance", pa.float64()),
        ("nearest_negative", pa.float64()),
        ("part_start", pa.float64()),
        ("part_end", pa.float64()),
        ("frames", pa.int64()),
        ("seconds", pa.float64()),
        ("notes", pa.list_(pa.string())),
        ("error_type", pa.string()),
        ("error", pa.string()),
        ("weights", pa.string()),
        ("ms", pa.float64()),
        ("size", pa.int64()),
        ("mtime_ns", pa.int64()),
    ]
)
_KEY = b"actioncli"


def as_table(rows: Sequence[Mapping[str, Any]]) -> pa.Table:
    """Rows as a table; what a row does not name is null."""
    return pa.Table.from_pylist(list(rows), schema=SCHEMA)


@dataclass(frozen=True, slots=True)
class State:
    """A file as it was when it was looked at; None where it could not be asked."""

    size: int | None
    mtime_ns: int | None

    @classmethod
    def of(cls, path: str) -> State:
        """The file as it is now."""
        try:
            found = Path(path).stat()
        except (OSError, ValueError):
            return cls(None, None)
        return cls(found.st_size, found.st_mtime_ns)


@dataclass(slots=True)
class Results:
    """The rows of one output.

    Attributes:
        output: the Parquet file.
        basis: what decisions depend on, name to value.
    """

    output: Path
    basis: Mapping[str, str]
    _table: pa.Table = field(default_factory=lambda: as_table([]))
    _waiting: list[pa.Table] = field(default_factory=list)

    @classmethod
    def open(cls, output: Path, basis: Mapping[str, str], restart: bool = False) -> Results:
        """Begin, or go on with what is there.

        Args:
            restart: forget what is there.

        Raises:
            UsageError: it was decided on another basis.
            ClipError: it is damaged, or not what this module writes.
        """
        results = cls(output, basis)
        if restart:
            shutil.rmtree(results._folder, ignore_errors=True)
            output.unlink(missing_ok=True)
            return results
        found = [output] if output.exists() else []
        found += sorted(results._folder.glob("*.parquet")) if results._folder.is_dir() else []
        results._table = _last_of_each([results._table, *map(results._read, found)])
        return results

    @property
    def _folder(self) -> Path:
        return self.output.with_name(self.output.name + ".parts")

    def rows(self, sources: Iterable[str]) -> pa.Table:
        """What is known about files, those waiting to be written too."""
        self._table, self._waiting = _last_of_each([self._table, *self._waiting]), []
        wanted = pa.array(list(sources), pa.string())
        return self._table.filter(pa.compute.is_in(self._table["source"], wanted))

    def missing(self, states: Mapping[str, State]) -> list[str]:
        """The files that no row tells about as they are now."""
        known = {
            row["source"]: State(row["size"], row["mtime_ns"])
            for row in self._table.select(["source", "size", "mtime_ns", "error_type"]).to_pylist()
            if row["error_type"] != WORKER_DIED
        }
        return [source for source, state in states.items() if known.get(source) != state]

    def add(self, rows: pa.Table) -> None:
        """Take rows; they are safe after the next `save`."""
        self._waiting.append(rows)

    def save(self) -> None:
        """Write what was added since the last time as another part.

        Raises:
            ClipError: it cannot be written.
        """
        if not self._waiting:
            return
        part = pa.concat_tables(self._waiting)
        try:
            self._folder.mkdir(mode=0o700, exist_ok=True)
            number = sum(1 for _ in self._folder.glob("*.parquet"))
            self._write(self._folder / f"{number:06d}.parquet", part)
        except OSError as error:
            raise ClipError(f"{self._folder}: cannot be written: {error.strerror}.") from error
        self._table, self._waiting = pa.concat_tables([self._table, part]), []

    def finish(self) -> None:
        """Merge all parts into the output.

        Raises:
            ClipError: it cannot be written.
        """
        table = _last_of_each([self._table, *self._waiting])
        try:
            self._write(self.output, table)
        except OSError as error:
            raise ClipError(f"{self.output}: cannot be written: {error.strerror}.") from error
        shutil.rmtree(self._folder, ignore_errors=True)
        self._table, self._waiting = table, []

    def _write(self, path: Path, table: pa.Table) -> None:
        header = json.dumps({"format": 1, **self.basis})
        with replacing(path, private=True) as part:
            pq.write_table(table.replace_schema_metadata({_KEY: header}), part)

    def _read(self, path: Path) -> pa.Table:
        try:
            table = pq.read_table(path, partitioning=None)
            header = json.loads((table.schema.metadata or {})[_KEY])
            rows = table.replace_schema_metadata(None).cast(SCHEMA)
        except (OSError, pa.ArrowException, KeyError, ValueError) as error:
            raise ClipError(
                f"{path}: is no output of `actioncli batch` ({type(error).__name__}); name another "
                "OUTPUT, or begin anew with --restart."
            ) from error
        changed = [name for name, value in self.basis.items() if header.get(name) != value]
        if changed:
            raise UsageError(
                f"{path}: was made with other {' and '.join(changed)}; decisions are not mixed: "
                "name another OUTPUT, or begin anew with --restart."
            )
        return rows


def _last_of_each(tables: Sequence[pa.Table]) -> pa.Table:
    """One row for each source, by name: what was found out last."""
    table = pa.concat_tables(tables)
    last = {source: row for row, source in enumerate(table["source"].to_pylist())}
    return table.take(pa.array([last[source] for source in sorted(last)], pa.int64()))
