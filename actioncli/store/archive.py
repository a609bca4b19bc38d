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
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any, BinaryIO

from actioncli.errors import ActionCliError, ClipError, StoreError
from actioncli.files import replacing, sync_folder
from actioncli.store.faults import system_fault
from actioncli.store.record import Record, check_outline, find_flaw

FORMAT = "actioncli support set"
# The one without settings, and the one with them.
VERSIONS = ("1", "2")
# JSON takes up to 25 times its length in memory: this keeps a hostile header below half a GB.
LARGEST_HEADER = 16 * 2**20
LARGEST_ARCHIVE = 4 * 2**30
# Far above a threshold for each of a thousand actions.
LARGEST_SETTING = 2**18
_NO_EXPORT = "this is no export of a support set, or it is damaged."

# What the manifest says of an example, in this order.
_FIELDS = (
    "label", "negative", "source", "note", "added", "fps", "frames", "joint_names", "confidence",
    "checksum",
)  # fmt: skip


def write_archive(
    path: Path,
    outlines: Sequence[Record],
    records: Iterable[Record],
    settings: Mapping[str, str] | None = None,
) -> None:
    """Write an archive; the file appears whole or not at all, readable by its owner only.

    Args:
        path: the file; an archive that is there already is replaced, anything else is not.
        outlines: the examples in order, without their bytes.
        records: the same with them, of which one at a time is in memory.
        settings: what goes with them, name to value.

    Raises:
        StoreError: not writable, too large, or something else of that name is there.
    """
    header = _compact(_header(outlines, settings)).encode()
    header += b" " * (-len(header) % 8)
    size = 8 + len(header) + _content_size(outlines)
    if len(header) > LARGEST_HEADER or size > LARGEST_ARCHIVE:
        raise StoreError(
            f"{len(outlines)} examples ({size >> 20} MB) are too many for one export; "
            "copy the store's file instead."
        )
    try:
        if path.is_symlink() or (path.exists() and not _is_archive(path)):
            raise StoreError(f"{path} is there already and is no export; choose another name.")
        with replacing(path, private=True) as part, part.open("wb") as file:
            file.write(len(header).to_bytes(8, "little") + header)
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
    with _opened(path) as (file, size):
        for number, outline in enumerate(_read_header(file, size)[0], 1):
            joints, *confidence = (file.read(length) for _, _, length in _tensors(outline))
            record = replace(outline, joints=joints, confidence=next(iter(confidence), None))
            try:
                flaw = find_flaw(record)
            except ActionCliError as error:
                flaw = str(error)
            if flaw:
                raise _RefusedError(f"example {number}: {flaw}")
            yield record


def carried_settings(path: Path) -> dict[str, str]:
    """The settings of an archive, name to value; their meaning is not checked.

    Raises:
        StoreError: as `read_archive`.
    """
    with _opened(path) as (file, size):
        return _read_header(file, size)[1]


class _RefusedError(Exception):
    """Why a file is not taken."""


@contextmanager
def _opened(path: Path) -> Iterator[tuple[BinaryIO, int]]:
    """The open file and its size; what is wrong with it is a `StoreError`."""
    try:
        if not path.is_file():
            raise StoreError(f"{path} does not exist, or is no ordinary file; check the path.")
        with path.open("rb") as file:
            yield file, path.stat().st_size
    except (_RefusedError, ClipError) as error:
        raise StoreError(
            f"{path}: {error} Nothing was imported; export the support set again."
        ) from error
    except OSError as error:
        raise system_fault(path, error, "cannot be read") from error


def _read_header(file: BinaryIO, size: int) -> tuple[list[Record], dict[str, str]]:
    """The outlines of the examples, and the settings."""
    length = int.from_bytes(file.read(8), "little")
    if size < 10 or length > size - 8:
        raise _RefusedError(_NO_EXPORT)
    if length > LARGEST_HEADER or size > LARGEST_ARCHIVE:
        raise _RefusedError("this is larger than any export of a support set.")
    header = _parse(file.read(length))
    metadata = header.get("__metadata__") if isinstance(header, dict) else None
    if not isinstance(metadata, dict) or metadata.get("format") != FORMAT:
        raise _RefusedError(_NO_EXPORT)
    if metadata.get("version") not in VERSIONS:
        raise _RefusedError(
            f"its format version is {ascii(metadata.get('version'))[:20]}, this release reads "
            f"{' and '.join(VERSIONS)}; update actioncli."
        )
    manifest = _sealed(metadata, "examples", "sha256")
    if not isinstance(manifest, list):
        raise _RefusedError("its list of examples is damaged.")
    outlines = [_outline(fields) for fields in manifest]
    settings = {}
    if metadata["version"] == VERSIONS[1]:
        settings = _sealed(metadata, "settings", "settings_sha256")
        if (
            not isinstance(settings, dict)
            or not settings
            or not all(
                isinstance(value, str)
                and max(len(name), len(value)) <= LARGEST_SETTING
                and (name + value).isprintable()
                for name, value in settings.items()
            )
        ):
            raise _RefusedError("its settings are damaged, not printable or too long.")
    if header != _header(outlines, settings):
        raise _RefusedError("its header does not fit its list of examples.")
    if size != 8 + length + _content_size(outlines):
        raise _RefusedError("it was cut short, or something was appended.")
    return outlines, settings


def _sealed(metadata: dict[str, Any], name: str, checksum: str) -> Any:
    """The JSON that stands in the metadata beside its checksum."""
    text = metadata.get(name)
    if not isinstance(text, str) or metadata.get(checksum) != _sha256(text):
        raise _RefusedError(f"its {name} are damaged.")
    return _parse(text)


def _parse(text: str | bytes) -> Any:
    try:
        return json.loads(text)
    # Of another encoding, no JSON, an endless number; or nested too deeply.
    except (ValueError, RecursionError) as error:
        raise _RefusedError(_NO_EXPORT) from error


def _outline(fields: Any) -> Record:
    """One line of the manifest, its types and sizes checked, as a record without bytes."""
    try:
        bytes_ = {"joints": b"", "confidence": b"" if fields["confidence"] else None}
        outline = Record(**{**fields, **bytes_, "joint_names": tuple(fields["joint_names"])})
        outline.check_types()
    except (TypeError, KeyError) as error:
        raise _RefusedError("an example has other fields than it should.") from error
    check_outline(outline.frames, outline.joint_names, "")
    return outline


def _tensors(outline: Record) -> list[tuple[str, list[int], int]]:
    """Name, shape and bytes of each tensor of an example."""
    shape = [outline.frames, len(outline.joint_names)]
    tensors = [("joints", [*shape, 3], shape[0] * shape[1] * 12)]
    if outline.confidence is not None:
        tensors.append(("confidence", shape, shape[0] * shape[1] * 4))
    return tensors


def _content_size(outlines: Iterable[Record]) -> int:
    return sum(length for outline in outlines for _, _, length in _tensors(outline))


def _header(outlines: Sequence[Record], settings: Mapping[str, str] | None) -> dict[str, Any]:
    """The safetensors header of an archive."""
    text = _compact(
        [
            {name: getattr(outline, name) for name in _FIELDS}
            | {"confidence": outline.confidence is not None}
            for outline in outlines
        ]
    )
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
    for number, outline in enumerate(outlines):
        for name, shape, size in _tensors(outline):
            place = [offset, offset + size]
            header[f"{number}/{name}"] = {"dtype": "F32", "shape": shape, "data_offsets": place}
            offset += size
    return header


def _compact(value: object) -> str:
    return json.dumps(value, ensure_ascii=False, separators=(",", ":"))


def _is_archive(path: Path) -> bool:
    with path.open("rb") as file:
        # The format's name stands at the beginning of what `write_archive` writes.
        return FORMAT.encode() in file.read(100)


def _sha256(text: str) -> str:
    # A lone surrogate, which only a hostile file has, is no valid UTF-8.
    return hashlib.sha256(text.encode("utf-8", "surrogatepass")).hexdigest()
