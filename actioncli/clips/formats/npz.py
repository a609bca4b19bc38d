"""NumPy's `.npz`: an archive of named arrays, read without trusting what it announces."""

from __future__ import annotations

import io
import os
import zipfile
import zlib
from collections.abc import Container, Mapping
from pathlib import Path
from typing import IO, Any, cast

from numpy.typing import NDArray

from actioncli.clips.formats.fields import (
    METADATA,
    POSITIONS,
    from_fields,
    in_small_letters,
    listed,
)
from actioncli.clips.formats.files import MEGABYTE
from actioncli.clips.formats.npy import MAGIC, read_array, read_header
from actioncli.clips.recording import Recording
from actioncli.errors import ClipError

# The directory at the end of the archive is read whole by the library; 1 MB is 10,000 arrays.
_LARGEST_DIRECTORY = MEGABYTE
_END = b"PK\x05\x06"
_END_LENGTH = 22
# An archive with this before its end keeps the directory's size elsewhere, as only those of more
# than 4 GB need.
_LARGE_ARCHIVE = b"PK\x06\x07"
_LARGE_ARCHIVE_LENGTH = 20
_NEED = "a clip needs poses3d or joints (SMPL's poses and betas are angles: save its joints)"
# Bytes of an array that are read ahead.
_AT_ONCE = 2**16


def read(file: Path) -> Recording:
    """A clip's `poses3d` or `joints`, with what stands beside them."""
    wanted = (*POSITIONS, *METADATA, "lengths", "joints_mm")
    arrays = read_arrays(file, wanted, _NEED, only_array=True)
    if "joints_mm" in arrays and "lengths" in arrays:
        raise ClipError(
            f"{file}: is a collection of {arrays['lengths'].size} clips, not a clip; "
            "collections are for train and evaluate."
        )
    return from_fields(arrays, str(file))


def read_arrays(
    file: Path, wanted: Container[str], need: str, only_array: bool = False
) -> Mapping[str, NDArray[Any]]:
    """The wanted arrays of an archive by name; with `only_array`, a single one of any name too.

    Args:
        file: the archive.
        wanted: names of arrays; others are not read.
        need: what to say where none of them is there.
        only_array: take the only array of the archive as positions.

    Raises:
        ClipError: the archive is damaged, or an array is (see `npy.read_header`).
    """
    try:
        with file.open("rb") as opened, _archive(opened, file) as archive:
            members = in_small_letters(
                {info.filename.removesuffix(".npy"): info for info in archive.infolist()}
            )
            chosen = {name: info for name, info in members.items() if name in wanted}
            if only_array and len(members) == 1 and not chosen:
                chosen = dict(zip(POSITIONS, members.values(), strict=False))
            if not chosen:
                raise ClipError(f"{file}: holds {listed(members)}; {need}.")
            arrays = {}
            for name, info in chosen.items():
                if info.compress_type not in (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED):
                    raise ClipError(f"{file}: is compressed in a way that numpy.savez never uses.")
                # Each read costs many calls within the library: headers are small reads.
                member = cast("io.RawIOBase", archive.open(info))
                with io.BufferedReader(member, _AT_ONCE) as stream:
                    where = f"{file} ({info.filename})"
                    arrays[name] = read_array(stream, read_header(stream, where), where)
            return arrays
    # What the library raises on damaged, encrypted or exotic archives.
    except (
        zipfile.BadZipFile, zlib.error, EOFError, NotImplementedError, RuntimeError, ValueError,
        OverflowError, KeyError,
    ) as error:  # fmt: skip
        raise ClipError(f"{file}: is a damaged .npz archive: {error}.") from error


def _archive(opened: IO[bytes], file: Path) -> zipfile.ZipFile:
    """Refuse what is not a plain archive, before the library reads its directory."""
    # The library reads many small pieces, and each would be a call of the system.
    small = os.fstat(opened.fileno()).st_size <= MEGABYTE
    stream: IO[bytes] = io.BytesIO(opened.read()) if small else opened
    beginning = stream.read(len(MAGIC))
    if not beginning.startswith(b"PK"):
        raise ClipError(
            f"{file}: is not an .npz archive (it does not begin as one); save it by numpy.savez."
        )
    size = stream.seek(0, 2)
    stream.seek(max(0, size - _END_LENGTH - _LARGE_ARCHIVE_LENGTH))
    before, end = stream.read(_LARGE_ARCHIVE_LENGTH), stream.read()
    if (
        not end.startswith(_END)
        or before.startswith(_LARGE_ARCHIVE)
        or int.from_bytes(end[12:16], "little") > _LARGEST_DIRECTORY
    ):
        raise ClipError(
            f"{file}: is a damaged .npz archive: its directory is missing or too large. It may "
            "be cut off; save it again by numpy.savez."
        )
    return zipfile.ZipFile(stream)
