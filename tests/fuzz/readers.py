"""Every reader of files that may come from somebody else, as fuzzing sees it.

A reader takes a file and gives a value or an `ActionCliError`; anything else is a finding. Formats
that guard their content by checksums, or keep it in an archive, are also changed from within:
`unpack` takes a file apart, `pack` puts the changed parts together as a forger would, with sums
that fit.
"""

import io
import json
import shutil
import struct
import warnings
import zipfile
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from actioncli.clips.clip import Clip
from actioncli.clips.collection import read_collection
from actioncli.clips.read import read_clip
from actioncli.errors import AmbiguousClipError, StoreError
from actioncli.evaluation.splits import read_splits
from actioncli.model import weights
from actioncli.recognition.threshold import kept_threshold
from actioncli.store import archive
from actioncli.store.health import damage
from actioncli.store.record import Record, _content_checksum
from actioncli.store.store import SupportStore

Parts = Sequence[bytes]
CORPUS = Path(__file__).parent / "corpus"


@dataclass(frozen=True)
class Reader:
    """One reader.

    Attributes:
        suffix: of the file that it is given.
        read: gives a value or raises an `ActionCliError`.
        unpack: a file's content to its parts; raises ValueError where it cannot.
        pack: parts to a file's content; raises ValueError likewise.
        whole: an input to a file's content, where the two differ.
    """

    suffix: str
    read: Callable[[Path], object]
    unpack: Callable[[bytes], Parts] | None = None
    pack: Callable[[Parts], bytes] | None = None
    whole: Callable[[bytes], bytes] = bytes


def _clip(file: Path) -> Clip:
    try:
        return read_clip(file)
    except AmbiguousClipError:
        return read_clip(file, unit="m", up="y")


def _archive(file: Path) -> object:
    """Read an export; what passes is imported too, and must leave a store without a fault."""
    home = file.parent / "home"
    store = SupportStore(home / "support.db")
    try:
        found = list(archive.read_archive(file))
        store.import_(file)
        assert store.check() == []
        store.support()
        kept_threshold(store)
        return found
    finally:
        if home.exists():
            shutil.rmtree(home)


def _store(file: Path) -> object:
    """Read a support set; what repair makes of a damaged one must be whole."""
    store = SupportStore(file)
    try:
        kept = kept_threshold(store)
        return [kept, store.actions(), store.examples(), store.support(), store.negatives()]
    except StoreError:
        if store.repair() is not None:
            assert damage(store.path) == []
            store.support()
        raise
    finally:
        # Journals, and the damaged file that was kept.
        for beside in file.parent.glob(f"{file.name}?*"):
            beside.unlink()


def _splits(file: Path) -> object:
    splits = read_splits(file)
    return [
        splits.names(name, part, getattr(split, part))
        for name, split in splits.by_collection.items()
        for part in ("train", "benchmark", "excluded")
    ]


def _weights(file: Path) -> object:
    found = weights.read_weights(file)
    assert all(np.isfinite(tensor).all() for tensor in found.tensors.values())
    return found


def _unpack_zip(content: bytes) -> Parts:
    try:
        with zipfile.ZipFile(io.BytesIO(content)) as file:
            members = [(info.filename.encode(), file.read(info)) for info in file.infolist()]
            return [part for member in members for part in member]
    # Whatever the library makes of a broken archive.
    except Exception as error:
        raise ValueError from error


def _pack_zip(parts: Parts) -> bytes:
    buffer = io.BytesIO()
    with warnings.catch_warnings(), zipfile.ZipFile(buffer, "w") as file:
        warnings.simplefilter("ignore")  # of names that are there twice
        for name, content in zip(parts[::2], parts[1::2], strict=True):
            member = zipfile.ZipInfo(name.decode("utf-8", "replace").split("\0")[0] or "a")
            file.writestr(member, content)
    return buffer.getvalue()


def _header(content: bytes) -> tuple[Any, bytes]:
    """The JSON at the beginning of a safetensors file, and what follows it."""
    end = 8 + int.from_bytes(content[:8], "little")
    return json.loads(content[8:end]), content[end:]


def _unpack_archive(content: bytes) -> Parts:
    header, tensors = _header(content)
    try:
        metadata = header["__metadata__"]
        settings = metadata.get("settings", "{}").encode()
        return [metadata["examples"].encode(), tensors, settings]
    except (KeyError, TypeError, AttributeError) as error:
        raise ValueError from error


def _pack_archive(parts: Parts) -> bytes:
    """The file that a forger would make for this manifest, these tensors and these settings."""
    manifest, tensors, settings = json.loads(parts[0]), parts[1], json.loads(parts[2])
    try:
        at, entries = 0, []
        for fields in manifest:
            joints = fields["frames"] * len(fields["joint_names"]) * 12
            end = at + joints + (joints // 3 if fields["confidence"] else 0)
            fields["checksum"] = _content_checksum(
                fields["fps"],
                tuple(fields["joint_names"]),
                tensors[at : at + joints],
                tensors[at + joints : end] or None,
            )
            seen = b"" if fields.pop("confidence") else None
            entries.append(Record(**fields, joints=b"", confidence=seen))
            at = end
        header = archive._header(entries, settings)
    except (KeyError, TypeError, AttributeError, OverflowError, MemoryError) as error:
        raise ValueError from error
    text = json.dumps(header, ensure_ascii=False).encode("utf-8", "surrogatepass")
    return len(text).to_bytes(8, "little") + text + tensors


def _unpack_weights(content: bytes) -> Parts:
    header, _ = _header(content)
    try:
        held = header.pop("__metadata__")
        return [held["config"].encode(), held["metadata"].encode(), json.dumps(header).encode()]
    except (KeyError, TypeError, AttributeError) as error:
        raise ValueError from error


def _pack_weights(parts: Parts) -> bytes:
    """A header around any configuration and any tensors of zeros, with the right checksum."""
    config, metadata = (part.decode("utf-8", "replace") for part in parts[:2])
    header = json.loads(parts[2])
    kinds = {"F32": "<f4", "F16": "<f2", "F64": "<f8", "I64": "<i8", "BOOL": "?"}
    try:
        tensors = {
            name: np.zeros([min(size, 2**10) for size in entry["shape"][:3]], kinds[entry["dtype"]])
            for name, entry in header.items()
        }
        header["__metadata__"] = {
            "format": weights.FORMAT,
            "format_version": weights.FORMAT_VERSION,
            "config": config,
            "metadata": metadata,
            "checksum": weights._checksum(config, metadata, tensors),
        }
    except (KeyError, TypeError, AttributeError, OverflowError) as error:
        raise ValueError from error
    text = json.dumps(header).encode()
    return len(text).to_bytes(8, "little") + text


def _with_zeros(content: bytes) -> bytes:
    """Weights whose tensors were left out, for they are long, with zeros in their place."""
    try:
        header, rest = _header(content)
        end = max(entry["data_offsets"][1] for entry in header.values() if "data_offsets" in entry)
        return content.ljust(len(content) - len(rest) + min(end, 2**20), b"\0")
    except (ValueError, RecursionError, KeyError, TypeError, AttributeError, IndexError):
        return content


READERS: Mapping[str, Reader] = {
    "npy": Reader(".npy", _clip),
    "npz": Reader(".npz", _clip, _unpack_zip, _pack_zip),
    "json": Reader(".json", _clip),
    "csv": Reader(".csv", _clip),
    "ntu": Reader(".skeleton", _clip),
    "trc": Reader(".trc", _clip),
    "bvh": Reader(".bvh", _clip),
    "c3d": Reader(".c3d", _clip),
    "collection": Reader(".npz", read_collection, _unpack_zip, _pack_zip),
    "weights": Reader(".safetensors", _weights, _unpack_weights, _pack_weights, _with_zeros),
    "archive": Reader(".safetensors", _archive, _unpack_archive, _pack_archive),
    "splits": Reader(".json", _splits),
    "store": Reader(".db", _store),
}


def mutator(reader: Reader, mutate: Callable[[bytes, int], bytes]) -> Callable[..., bytes]:
    """A libFuzzer mutator that, every other time, changes one part of an unpacked file."""
    unpack, pack = reader.unpack, reader.pack
    assert unpack is not None
    assert pack is not None

    def change(data: bytes, max_size: int, seed: int) -> bytes:
        if seed % 2:
            try:
                parts: list[Any] = list(unpack(data))
                place = (seed >> 1) % len(parts)
                parts[place] = mutate(parts[place], max_size)
                packed = pack(parts)
                if len(packed) <= max_size:
                    return packed
            except (ValueError, ZeroDivisionError, RecursionError, struct.error):
                pass
        return mutate(data, max_size)

    return change
