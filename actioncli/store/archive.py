"""The exported support set: one portable file, read with suspicion.

It is a safetensors file, so that other programs can open it: a header (JSON) that places the
tensors `0/joints` (T, J, 3), `0/confidence` (T, J), `1/joints`, ... one after the other, all
float32 and little-endian. Its metadata holds the manifest (what the store knows of each example)
and the manifest's SHA-256; the manifest holds the SHA-256 of each example's content. Between
them, they cover every bit that matters. Version 2 adds the settings (the threshold that was
calibrated on these examples), with their SHA-256; without any, version 1 is written.

It is written and read here, not by the safetensors library, for two reasons: an example at a
time is in memory, whatever the file's size; and reading is strict, for the only header that is
accepted is the one that would be written for the manifest.
"""

from __future__ import annotations

import hashlib
import json
import os
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, BinaryIO

from actioncli.errors import ActionCliError, StoreError
from actioncli.files import replacing
from actioncli.store.faults import system_fault
from actioncli.store.location import sync_folder
from actioncli.store.record import Record, check_outline, find_flaw

FORMAT = "actioncli support set"
# The one without settings, and the one with them.
VERSIONS = ("1", "2")
# JSON takes up to 25 times its length in memory: this keeps a hostile header below half a GB.
LARGEST_HEADER = 16 * 2**20
LARGEST_ARCHIVE = 4 * 2**30
# Far above a threshold for each of a thousand actions.
LARGEST_SETTING = 2**18

_FIELDS: dict[str, type] = {
    "label": str,
    "negative": bool,
    "source": str,
    "note": str,
    "added": str,
    "fps": float,
    "frames": int,
    "joint_names": list,
    "confidence": bool,
    "checksum": str,
}


@dataclass(frozen=True)
class Entry:
    """What the manifest says of one example; the tensors follow in the file.

    Attributes:
        record: the example, without its bytes.
        confidence: whether the example has a confidence for each joint.
    """

    record: Record
    confidence: bool

    @property
    def joints_size(self) -> int:
        """Bytes of the joints."""
        return self.record.frames * len(self.record.joint_names) * 12

    @property
    def confidence_size(self) -> int:
        """Bytes of the confidence."""
        return self.joints_size // 3 if self.confidence else 0


def write_archive(
    path: Path,
    entries: Sequence[Entry],
    records: Iterable[Record],
    settings: Mapping[str, str] | None = None,
) -> None:
    """Write an archive; the file appears whole or not at all, readable by its owner only.

    Args:
        path: the file; an archive that is there already is replaced, anything else is not.
        entries: what goes into the manifest, in order.
        records: the same examples with their bytes, taken one at a time.
        settings: what goes with them, name to value.

    Raises:
        StoreError: not writable, too large, or something else of that name is there.
    """
    header = _compact(_header(entries, settings)).encode()
    header += b" " * (-len(header) % 8)
    size = 8 + len(header) + sum(entry.joints_size + entry.confidence_size for entry in entries)
    if len(header) > LARGEST_HEADER or size > LARGEST_ARCHIVE:
        raise StoreError(
            f"{len(entries)} examples ({size >> 20} MB) are too many for one export; "
            "copy the store's file instead."
        )
    try:
        if path.is_symlink() or (path.exists() and not _is_archive(path)):
            raise StoreError(f"{path} is there already and is no export; choose another name.")
        with replacing(path, private=True) as part, part.open("wb") as file:
            file.write(len(header).to_bytes(8, "little"))
            file.write(header)
            for record in records:
                file.write(record.joints)
                file.write(record.confidence or b"")
            file.flush()
            os.fsync(file.fileno())
        sync_folder(path.parent)
    except OSError as error:
        raise system_fault(path, error, "cannot be written") from error


def read_archive(path: Path) -> Iterator[Record]:
    """The examples of an archive, in order, each checked as an enrolment would.

    A caller that must not keep half of a bad file reads it to the end once before it believes
    anything.

    Raises:
        StoreError: unreadable, damaged, not an archive, of a newer release, or hostile.
    """
    try:
        if not path.is_file():
            raise StoreError(f"{path} does not exist, or is no ordinary file; check the path.")
        with path.open("rb") as file:
            yield from _records(file, path.stat().st_size, path)
    except OSError as error:
        raise system_fault(path, error, "cannot be read") from error


def carried_settings(path: Path) -> dict[str, str]:
    """The settings of an archive, name to value; their meaning is not checked.

    Raises:
        StoreError: as `read_archive`.
    """
    try:
        with path.open("rb") as file:
            return _read_header(file, path.stat().st_size)[1]
    except (_RefusedError, ActionCliError) as error:
        raise StoreError(f"{path}: {error} Nothing was imported.") from error
    except OSError as error:
        raise system_fault(path, error, "cannot be read") from error


def _records(file: BinaryIO, size: int, path: Path) -> Iterator[Record]:
    what = str(path)
    try:
        entries, _ = _read_header(file, size)
        for number, entry in enumerate(entries, 1):
            what = f"{path}, example {number}"
            joints = file.read(entry.joints_size)
            confidence = file.read(entry.confidence_size) if entry.confidence else None
            record = replace(entry.record, joints=joints, confidence=confidence)
            flaw = find_flaw(record)
            if flaw:
                raise _RefusedError(flaw)
            yield record
    except (_RefusedError, ActionCliError) as error:
        raise StoreError(
            f"{what}: {error} Nothing was imported; export the support set again."
        ) from error


class _RefusedError(Exception):
    """Why a file is not taken."""


def _read_header(file: BinaryIO, size: int) -> tuple[list[Entry], dict[str, str]]:
    length = int.from_bytes(file.read(8), "little")
    if size < 10 or length > size - 8:
        raise _RefusedError("this is no export of a support set, or it was cut short.")
    if length > LARGEST_HEADER or size > LARGEST_ARCHIVE:
        raise _RefusedError("this is larger than any export of a support set.")
    header = _parse(file.read(length))
    metadata = header.get("__metadata__") if isinstance(header, dict) else None
    if not isinstance(metadata, dict) or metadata.get("format") != FORMAT:
        raise _RefusedError("this is no export of a support set.")
    if metadata.get("version") not in VERSIONS:
        raise _RefusedError(
            f"its format version is {ascii(metadata.get('version'))[:20]}, this release reads "
            f"{' and '.join(VERSIONS)}; update actioncli."
        )
    text = metadata.get("examples")
    if not isinstance(text, str) or metadata.get("sha256") != _sha256(text):
        raise _RefusedError("its list of examples is damaged.")
    manifest = _parse(text)
    if not isinstance(manifest, list):
        raise _RefusedError("its list of examples is no list.")
    entries = [_entry(fields) for fields in manifest]
    settings = _settings(metadata) if metadata["version"] == VERSIONS[1] else {}
    if header != _header(entries, settings):
        raise _RefusedError("its header does not fit its list of examples.")
    if size != 8 + length + sum(entry.joints_size + entry.confidence_size for entry in entries):
        raise _RefusedError("it was cut short, or something was appended.")
    return entries, settings


def _settings(metadata: dict[str, Any]) -> dict[str, str]:
    text = metadata.get("settings")
    if not isinstance(text, str) or metadata.get("settings_sha256") != _sha256(text):
        raise _RefusedError("its settings are damaged.")
    settings = _parse(text)
    if not isinstance(settings, dict) or not settings:
        raise _RefusedError("its settings are no settings.")
    for name, value in settings.items():
        if not isinstance(value, str) or max(len(name), len(value)) > LARGEST_SETTING:
            raise _RefusedError("a setting of its is no text, or too long.")
        if not (name.isprintable() and value.isprintable()):
            raise _RefusedError("a setting of its is not printable.")
    return settings


def _compact(value: object) -> str:
    return json.dumps(value, ensure_ascii=False, separators=(",", ":"))


def _parse(text: str | bytes) -> Any:
    try:
        return json.loads(text)
    # Of another encoding, no JSON, an endless number; or nested too deeply.
    except (ValueError, RecursionError) as error:
        raise _RefusedError("this is no export of a support set, or it is damaged.") from error


def _entry(fields: Any) -> Entry:
    """One line of the manifest, its types and sizes checked."""
    if not isinstance(fields, dict) or fields.keys() != _FIELDS.keys():
        raise _RefusedError("an example has other fields than it should.")
    for name, kind in _FIELDS.items():
        if type(fields[name]) is not kind:
            raise _RefusedError(f"the {name} of an example is of another type than it should.")
    names = fields["joint_names"]
    if not names or not all(isinstance(name, str) for name in names) or fields["frames"] < 2:
        raise _RefusedError("the joint names or frames of an example make no clip.")
    confidence = fields.pop("confidence")
    check_outline(fields["frames"], names, "")
    record = Record(**{**fields, "joint_names": tuple(names)}, joints=b"", confidence=None)
    return Entry(record, confidence)


def _header(entries: Sequence[Entry], settings: Mapping[str, str] | None = None) -> dict[str, Any]:
    """The safetensors header of an archive."""
    manifest = [
        {name: getattr(entry.record, name) for name in _FIELDS} | {"confidence": entry.confidence}
        for entry in entries
    ]
    text = _compact(manifest)
    metadata = {
        "format": FORMAT,
        "version": VERSIONS[bool(settings)],
        "examples": text,
        "sha256": _sha256(text),
    }
    if settings:
        kept = _compact(dict(sorted(settings.items())))
        metadata |= {"settings": kept, "settings_sha256": _sha256(kept)}
    header: dict[str, Any] = {"__metadata__": metadata}
    offset = 0
    for number, entry in enumerate(entries):
        shape = [entry.record.frames, len(entry.record.joint_names)]
        tensors = [("joints", [*shape, 3], entry.joints_size)]
        if entry.confidence:
            tensors.append(("confidence", shape, entry.confidence_size))
        for name, dimensions, size in tensors:
            header[f"{number}/{name}"] = {
                "dtype": "F32",
                "shape": dimensions,
                "data_offsets": [offset, offset + size],
            }
            offset += size
    return header


def _is_archive(path: Path) -> bool:
    with path.open("rb") as file:
        # The format's name stands at the beginning of what `write_archive` writes.
        return FORMAT.encode() in file.read(100)


def _sha256(text: str) -> str:
    # A lone surrogate, which only a hostile file has, is no valid UTF-8.
    return hashlib.sha256(text.encode("utf-8", "surrogatepass")).hexdigest()
