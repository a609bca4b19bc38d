"""What a damaged store still holds, told apart from what only looks like it.

Nothing of the database's structure is believed. A recording counts where its SHA-256 fits, what is
said of it where its seal does; the index over the examples, which repeats their labels, stands in
for a seal that is damaged or of a schema that had none, and names what is gone.
"""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from datetime import UTC, datetime
from mmap import mmap

from actioncli.errors import ActionCliError
from actioncli.store.migrations import APPLICATION_ID, setting_crc
from actioncli.store.names import check_label, file_name, plain_text
from actioncli.store.pages import HEADER, PAGE_SIZES, Pages, Row
from actioncli.store.record import TIME_FORMAT, Record, find_flaw

# Columns of the table `examples` in the first schema; later ones add the seal.
_COLUMNS = 13
_INDEX = "sqlite_autoindex_examples_1"
_SETTINGS_INDEX = "sqlite_autoindex_settings_1"
# A number above it was damaged: it would take years of enrolling to get there.
_LAST_ID = 2**31


@dataclass(frozen=True)
class Gone:
    """An example that could be named, but not salvaged."""

    id: int
    label: str
    why: str


@dataclass
class Salvage:
    """What was found.

    Attributes:
        labels: of the examples that were salvaged, by identifier.
        doubtful: those of them whose source, note or time may have changed.
        settings: name to value.
        gone: the examples that are lost, as far as they can be named.
        settings_gone: names of lost settings.
        complete: whether `gone` and `settings_gone` name all that is lost.
        ours: whether there was any sign of a support set.
        last: the highest identifier that was ever given, as far as is known.
    """

    labels: dict[int, str] = field(default_factory=dict)
    doubtful: list[int] = field(default_factory=list)
    settings: dict[str, str] = field(default_factory=dict)
    gone: list[Gone] = field(default_factory=list)
    settings_gone: list[str] = field(default_factory=list)
    complete: bool = False
    ours: bool = False
    last: int = 0


@dataclass(frozen=True)
class _Entry:
    """A line of the index over the examples."""

    label: str
    negative: bool
    checksum: str


def salvage(content: bytes | mmap, keep: Callable[[int, Record], None]) -> Salvage:
    """Look through all pages of a database's file, whatever has become of it.

    Args:
        content: the file, its journal played back.
        keep: gets the identifier and the record of each example that is proved to be what was
            enrolled, one at a time.
    """
    declared = int.from_bytes(content[16:18], "big")
    sizes = dict.fromkeys((PAGE_SIZES[0], 65536 if declared == 1 else declared, *PAGE_SIZES))
    marked = content[:16] == HEADER and content[68:72] == APPLICATION_ID.to_bytes(4, "big")
    # Another size of pages is only of interest where the usual one finds nothing.
    for size in (size for size in sizes if size in PAGE_SIZES):
        search = _Search(Pages(content, size), keep)
        if search.found.ours:
            return search.found
    return Salvage(ours=marked)


class _Search:
    """One walk through the pages."""

    def __init__(self, pages: Pages, keep: Callable[[int, Record], None]) -> None:
        self.found = Salvage()
        self._keep = keep
        self._kept: set[_Entry] = set()
        self._broken: dict[int, Gone] = {}
        self._index: dict[int, _Entry] = {}
        self._roots = {_INDEX: 0, _SETTINGS_INDEX: 0}
        names = self._read_indices(pages)
        for row in pages.rows():
            self._look_at(row)
        found = self.found
        found.complete = all(pages.tree(root) is not None for root in self._roots.values())
        found.settings_gone = sorted(names - found.settings.keys())
        for example, entry in self._index.items():
            if entry not in self._kept:
                gone = Gone(example, entry.label, "its recording is damaged or missing")
                self._broken.setdefault(example, gone)
        found.gone = [
            gone for example, gone in sorted(self._broken.items()) if example not in found.labels
        ]
        found.ours = found.ours or bool(found.labels or self._index or found.settings)
        found.last = max([found.last, *found.labels, *(gone.id for gone in found.gone)])

    def _read_indices(self, pages: Pages) -> set[str]:
        """Fill the index over the examples; the names of settings."""
        names = set()
        for entry in pages.entries():
            match entry:
                case (str(label), (0 | 1) as negative, str(checksum), int(example)):
                    if _plain(label) and re.fullmatch("[0-9a-f]{64}", checksum) and _id(example):
                        self._index[example] = _Entry(label, bool(negative), checksum)
                case (str(name), int()) if _plain(name):
                    names.add(name)
        return names

    def _look_at(self, row: Row) -> None:
        match row.values:
            case ("index", str(name), str(), int(number), None) if name in self._roots:
                self._roots[name] = number
            case ("table", "examples", "examples", int(), _):
                self.found.ours = True
            case ("examples", int(last)) if _id(last):
                self.found.last = last
            case (str(name), str(value), int(crc)) if setting_crc(name, value) == crc:
                self.found.settings[name] = value
            case (None, label, (0 | 1), *_) if _id(row.id):
                record, certain = _record(row)
                if record is not None:
                    self._take(row, record, certain)
                elif isinstance(label, str) and _plain(label):
                    self._broken.setdefault(row.id, Gone(row.id, label, "its recording is damaged"))

    def _take(self, row: Row, record: Record, certain: bool) -> None:
        """Keep a record whose content is whole, if there is no doubt about its label."""
        told = _Entry(record.label, record.negative, record.checksum)
        known = self._index.get(row.id)
        # The first schema had no seals; what lost its own needs another witness.
        unsealed = row.whole and len(row.values) == _COLUMNS
        if not certain and known != told and (known is not None or not unsealed):
            why = "what it was called cannot be told for certain"
            self._broken[row.id] = Gone(row.id, known.label if known else record.label, why)
        elif row.id not in self.found.labels and told not in self._kept:
            if not certain and not unsealed:
                self.found.doubtful.append(row.id)
            self._keep(row.id, record)
            self.found.labels[row.id] = record.label
            self._kept.add(told)


def _record(row: Row) -> tuple[Record | None, bool]:
    """The record of a row if its content is what was enrolled, and whether all else is too."""
    if len(row.values) < _COLUMNS:
        return None, False
    _, label, negative, *texts, fps, frames, _, names, checksum, joints, confidence = row.values[
        :_COLUMNS
    ]
    source, note, added = (text if isinstance(text, str) else "" for text in texts)
    try:
        record = Record.from_row(
            (label, negative, source, note, added, fps, frames, names, checksum, joints, confidence)
        )
        certain = len(row.values) > _COLUMNS and row.values[_COLUMNS] == record.seal(row.id)
        if not certain:
            record = replace(
                record, source=file_name(source), note=plain_text(note), added=_time(added)
            )
        return (None if find_flaw(record) else record), certain
    # As many as there are ways to be damaged.
    except (ActionCliError, TypeError, ValueError, AttributeError, OverflowError):
        return None, False


def _plain(label: str) -> bool:
    try:
        return check_label(label) == label
    except ActionCliError:
        return False


def _id(number: int) -> bool:
    return 0 < number < _LAST_ID


def _time(added: str) -> str:
    """A time as it stands, or today's where it is none."""
    try:
        return datetime.fromisoformat(added).strftime(TIME_FORMAT)
    except ValueError:
        return datetime.now(UTC).strftime(TIME_FORMAT)
