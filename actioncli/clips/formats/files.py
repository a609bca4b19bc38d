"""Opening files that may be anything: what is missing, special, empty or too large is refused."""

from __future__ import annotations

import stat
from array import array
from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np

from actioncli.clips.clip import FloatArray
from actioncli.clips.recording import LARGEST_CLIP, LONGEST_CLIP
from actioncli.errors import ClipError

MEGABYTE = 10**6
LARGEST_FILE = 1000 * MEGABYTE
LARGEST_TEXT = 200 * MEGABYTE
LARGEST_NUMBER = 1e9
_LONGEST_LINE = 2**20


def check_file(file: Path, suffixes: Sequence[str] = ()) -> bytes:
    """The first bytes of a regular, readable, non-empty file of a bearable size.

    Raises:
        ClipError: it is none of that.
    """
    try:
        status = file.stat()
        if stat.S_ISDIR(status.st_mode):
            kinds = f" ({', '.join(suffixes)})" if suffixes else ""
            raise ClipError(f"{file}: is a folder and holds no clips{kinds}.")
        # A pipe or a device could keep the reader waiting for ever.
        if not stat.S_ISREG(status.st_mode):
            raise ClipError(f"{file}: is not a regular file; save the clip as one.")
        if status.st_size == 0:
            raise ClipError(f"{file}: is empty (0 bytes); save the clip again.")
        check_size(file, LARGEST_FILE)
        with file.open("rb") as stream:
            return stream.read(16)
    except FileNotFoundError as error:
        raise ClipError(f"{file}: no such file.") from error
    except OSError as error:
        raise ClipError(f"{file}: cannot be read: {error.strerror or error}.") from error
    except ValueError as error:
        raise ClipError(f"{str(file)!r}: is not a file name: {error}.") from error


def check_size(file: Path, limit: int) -> None:
    """Refuse a file of more than `limit` bytes."""
    size = file.stat().st_size
    if size > limit:
        raise ClipError(
            f"{file}: has {size / MEGABYTE:.0f} MB, more than the {limit / MEGABYTE:.0f} MB "
            "that a file of this kind may have; cut it down."
        )


def text_lines(file: Path) -> Iterator[str]:
    """The lines of a text file, one at a time, without their ends.

    UTF-8 or, where a byte order mark says so, UTF-16. Undecodable bytes become replacement
    characters, so that a path in a header in some old encoding does no harm.

    Raises:
        ClipError: it is too large or not text.
    """
    check_size(file, LARGEST_TEXT)
    with file.open("rb") as binary:
        mark = binary.read(2)
    encoding = "utf-16" if mark in (b"\xff\xfe", b"\xfe\xff") else "utf-8-sig"
    with file.open(encoding=encoding, errors="replace") as stream:
        while line := stream.readline(_LONGEST_LINE):
            if "\0" in line:
                raise ClipError(f"{file}: holds NUL bytes and is not text.")
            if len(line) == _LONGEST_LINE:
                raise ClipError(f"{file}: has a line of more than {_LONGEST_LINE} characters.")
            yield line.rstrip("\r\n")


class Numbers:
    """Rows of numbers gathered compactly, with a bound on how many there may be."""

    def __init__(self, file: Path, width: int, most_rows: int = LONGEST_CLIP) -> None:
        """Gather up to `most_rows` rows of `width` numbers each."""
        self._file = file
        self._most_rows = most_rows
        self._width = width
        self._values = array("f")

    def __len__(self) -> int:
        return len(self._values) // self._width if self._width else 0

    def add(self, row: Sequence[float]) -> None:
        """Append one row.

        Raises:
            ClipError: the file holds more numbers than a clip may have.
        """
        if len(self._values) + len(row) > LARGEST_CLIP or len(self) > self._most_rows:
            raise ClipError(
                f"{self._file}: holds more than {LARGEST_CLIP} numbers or {self._most_rows} rows, "
                "more than a clip may have; cut out the action."
            )
        self._values.extend(row)

    def parse(self, cells: Sequence[str], line: int) -> None:
        """Append the numbers in the cells of one line.

        Raises:
            ClipError: a cell is no number, or there are more than a clip may have.
        """
        self.add(parsed(cells, self._file, line))

    def table(self) -> FloatArray:
        """(rows, width) float32.

        Raises:
            ClipError: there are no rows, or a number is beyond all positions.
        """
        if not self._values:
            raise ClipError(f"{self._file}: holds no rows of numbers.")
        table = np.frombuffer(self._values, dtype=np.float32).reshape(len(self), self._width)
        check_range(table, str(self._file))
        return table


def check_range(values: FloatArray, where: str) -> None:
    """Refuse finite numbers so large that arithmetic with them would overflow."""
    sizes = np.abs(values)
    if (sizes[np.isfinite(sizes)] >= LARGEST_NUMBER).any():
        raise ClipError(
            f"{where}: holds numbers of {LARGEST_NUMBER:.0e} and more, which are no positions "
            "or angles."
        )


def parsed(cells: Sequence[str], file: Path, line: int) -> list[float]:
    """The numbers in some cells of a line.

    Raises:
        ClipError: one of them is none.
    """
    try:
        return [number(cell) for cell in cells]
    except ValueError as error:
        raise ClipError(f"{file}: line {line}: {error}.") from error


def frame_rate(step: float, shortest: float = 1e-3) -> float | None:
    """Frames per second from the seconds between two frames, if they can be that."""
    return round(1 / step, 3) if shortest <= step <= 2 else None


def number(text: str) -> float:
    """A number of a text file, with a decimal comma too; NaN for what stands for a missing one.

    Raises:
        ValueError: it is neither.
    """
    try:
        return float(text)
    except ValueError:
        if text.strip().lower() in ("", "na", "n/a", "null", "none", "-", "nil"):
            return float("nan")
        if text.count(",") == 1:
            return float(text.replace(",", "."))
        raise
