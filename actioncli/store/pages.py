"""SQLite's pages, read without SQLite: what a damaged file still holds, cell by cell.

SQLite gives up at the first page that makes no sense; here every page is looked at by itself, as
the file format describes it (https://sqlite.org/fileformat2.html), and a cell that makes no sense
is passed over. Nothing read here may be believed until a checksum says so.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from mmap import mmap
from typing import Any

# Types of pages: of an index inside and at the leaves, of a table at the leaves.
_INDEX_INTERIOR, _INDEX_LEAF, _TABLE_LEAF = 2, 10, 13

HEADER = b"SQLite format 3\0"
PAGE_SIZES = (4096, 512, 1024, 2048, 8192, 16384, 32768, 65536)


class _BrokenError(Exception):
    """A cell that makes no sense."""


@dataclass(frozen=True)
class Row:
    """A cell of a table.

    Attributes:
        id: its rowid.
        values: its columns from the first; those of a broken row end where it breaks.
        whole: whether all bytes of the row were there.
    """

    id: int
    values: tuple[Any, ...]
    whole: bool


class Pages:
    """The pages of a file.

    Args:
        content: the file; its last page may be cut short.
        size: bytes of a page.
    """

    def __init__(self, content: bytes | mmap, size: int) -> None:
        self._content = content
        self._size = size
        self.count = -(-len(content) // size)

    def rows(self) -> Iterator[Row]:
        """The rows of all tables, in the order of the pages."""
        for number in range(1, self.count + 1):
            if self._kind(number) == _TABLE_LEAF or self._was_leaf(number):
                for cell in self._cells(number, _TABLE_LEAF):
                    try:
                        yield self._row(number, cell)
                    except _BrokenError:
                        continue

    def entries(self) -> Iterator[tuple[Any, ...]]:
        """The entries of all indices that are whole, in the order of the pages."""
        for number in range(1, self.count + 1):
            kind = self._kind(number)
            if kind in {_INDEX_INTERIOR, _INDEX_LEAF}:
                for cell in self._cells(number, kind):
                    try:
                        yield self._entry(number, cell, kind)
                    except _BrokenError:
                        continue

    def tree(self, root: int) -> list[tuple[Any, ...]] | None:
        """The entries of the index whose root page is `root`; None unless all of it is whole."""
        entries = []
        waiting, seen = [root], set[int]()
        try:
            while waiting:
                number = waiting.pop()
                kind = self._kind(number)
                if number in seen or kind not in {_INDEX_INTERIOR, _INDEX_LEAF}:
                    return None
                seen.add(number)
                start = self._start(number)
                page = self._page(number)
                cells = list(self._cells(number, kind))
                if len(cells) != int.from_bytes(page[start + 3 : start + 5], "big"):
                    return None
                if kind == _INDEX_INTERIOR:
                    waiting.append(int.from_bytes(page[start + 8 : start + 12], "big"))
                    waiting += [int.from_bytes(page[at : at + 4], "big") for at in cells]
                entries += [self._entry(number, cell, kind) for cell in cells]
        except _BrokenError:
            return None
        return entries

    def _was_leaf(self, number: int) -> bool:
        """Whether only the type of a page of a table was damaged: its other fields make sense."""
        page, start = self._page(number), self._start(number)
        if len(page) < start + 8 or page[start] in {_INDEX_INTERIOR, _INDEX_LEAF}:
            return False
        count = int.from_bytes(page[start + 3 : start + 5], "big")
        content = int.from_bytes(page[start + 5 : start + 7], "big")
        pointers = range(start + 8, start + 8 + 2 * count, 2)
        return (
            count > 0
            and pointers.stop <= content <= self._size == len(page)
            and all(
                content <= int.from_bytes(page[at : at + 2], "big") < self._size for at in pointers
            )
        )

    def _page(self, number: int) -> bytes:
        if not 1 <= number <= self.count:
            raise _BrokenError
        return self._content[(number - 1) * self._size : number * self._size]

    def _start(self, number: int) -> int:
        # The file's header stands before that of its first page.
        return 100 if number == 1 else 0

    def _kind(self, number: int) -> int:
        page, start = self._page(number), self._start(number)
        return page[start] if len(page) > start else 0

    def _cells(self, number: int, kind: int) -> Iterator[int]:
        """Where the cells of a page begin."""
        page, start = self._page(number), self._start(number)
        pointers = start + (12 if kind == _INDEX_INTERIOR else 8)
        count = int.from_bytes(page[start + 3 : start + 5], "big")
        for at in range(pointers, min(pointers + 2 * count, len(page) - 1), 2):
            cell = int.from_bytes(page[at : at + 2], "big")
            if pointers + 2 <= cell < len(page):
                yield cell

    def _row(self, number: int, cell: int) -> Row:
        page = self._page(number)
        length, at = _varint(page, cell)
        rowid, at = _varint(page, at)
        payload = self._payload(page, at, length, self._size - 35)
        values, whole = _values(payload, length)
        return Row(_signed(rowid), values, whole)

    def _entry(self, number: int, cell: int, kind: int) -> tuple[Any, ...]:
        page = self._page(number)
        at = cell + 4 if kind == _INDEX_INTERIOR else cell
        length, at = _varint(page, at)
        payload = self._payload(page, at, length, (self._size - 12) * 64 // 255 - 23)
        values, whole = _values(payload, length)
        if not whole:
            raise _BrokenError
        return values

    def _payload(self, page: bytes, at: int, length: int, most: int) -> bytes:
        """The bytes of a cell, as many as there are, those on overflow pages too."""
        if length > len(self._content):
            raise _BrokenError
        local = length
        if length > most:
            least = (self._size - 12) * 32 // 255 - 23
            local = least + (length - least) % (self._size - 4)
            local = local if local <= most else least
        parts = [page[at : at + local]]
        if len(parts[0]) < local:
            return parts[0]
        missing = length - local
        following = int.from_bytes(page[at + local : at + local + 4], "big")
        while missing > 0:
            try:
                page = self._page(following)
            except _BrokenError:
                break
            wanted = min(missing, self._size - 4)
            parts.append(page[4 : 4 + wanted])
            if len(parts[-1]) < wanted:
                break
            missing -= wanted
            following = int.from_bytes(page[:4], "big")
        return b"".join(parts)


def _values(payload: bytes, length: int) -> tuple[tuple[Any, ...], bool]:
    """The columns of a record as far as they go, and whether they are all there."""
    header, at = _varint(payload, 0)
    if not at <= header <= len(payload):
        raise _BrokenError
    values: list[Any] = []
    place = header
    while at < header:
        kind, at = _varint(payload, at)
        size = _size(kind)
        part = payload[place : place + size]
        if len(part) < size:
            return tuple(values), False
        values.append(_value(kind, part))
        place += size
    return tuple(values), len(payload) == place == length and at == header


def _size(kind: int) -> int:
    if kind >= 12:
        return (kind - 12) // 2
    return (0, 1, 2, 3, 4, 6, 8, 8, 0, 0, 0, 0)[kind]


def _value(kind: int, part: bytes) -> Any:
    import struct

    if kind == 0:
        return None
    if kind == 7:
        return struct.unpack(">d", part)[0]
    if kind in {8, 9}:
        return kind - 8
    if kind < 7:
        return int.from_bytes(part, "big", signed=True)
    if kind < 12:
        raise _BrokenError
    # What is no text stays bytes, and is nothing that a column of text may hold.
    if kind % 2:
        try:
            return part.decode()
        except UnicodeDecodeError:
            return part
    return part


def _varint(page: bytes, at: int) -> tuple[int, int]:
    """A number of one to nine bytes, and where it ends."""
    value = 0
    for place in range(at, min(at + 8, len(page))):
        value = value << 7 | page[place] & 0x7F
        if page[place] < 0x80:
            return value, place + 1
    if at + 8 >= len(page):
        raise _BrokenError
    return value << 8 | page[at + 8], at + 9


def _signed(value: int) -> int:
    return value - 2**64 if value >= 2**63 else value
