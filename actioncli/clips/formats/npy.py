"""NumPy's `.npy`: one bare array of joint positions.

The header is parsed here, by pattern: it is a Python expression, and a file from a stranger is
not to be evaluated, nor its announced size believed before it was compared with the file's.
"""

from __future__ import annotations

import re
import sys
from dataclasses import dataclass, replace
from math import prod
from pathlib import Path
from typing import IO, Any

import numpy as np
from numpy.typing import NDArray

from actioncli.clips.formats.fields import from_fields
from actioncli.clips.formats.files import MEGABYTE
from actioncli.clips.recording import LONGEST_CLIP, Recording
from actioncli.errors import ClipError

MAGIC = b"\x93NUMPY"
LARGEST_ARRAY = 256 * MEGABYTE
_NUMBERED = re.compile(r"\d{1,9}\.npy")
_LONGEST_HEADER = 10_000
_ENTRY = re.compile(
    r"'(descr|fortran_order|shape)':\s*"
    r"(?:'([^']{1,20})'|(True|False)|\(([\d,\s]{0,200})\)|(\[))"
)
_DTYPE = re.compile(r"[<>=|]?(?:[iu][1248]|f[248]|[US][1-9]\d{0,7}|b1)")


@dataclass(frozen=True, slots=True)
class ArrayHeader:
    """What an array announces: its type, its shape, the order of its elements."""

    dtype: np.dtype[Any]
    shape: tuple[int, ...]
    fortran_order: bool

    @property
    def nbytes(self) -> int:
        """Size of the data that must follow."""
        return prod(self.shape) * self.dtype.itemsize


def read(file: Path) -> Recording:
    """Joint positions as (T, J, 3), (T, J x 3) or (T, P, J, 3), in an unknown unit and axes."""
    with file.open("rb") as stream:
        header = read_header(stream, str(file))
        here = stream.tell()
        left = stream.seek(0, 2) - here
        if header.nbytes > left:
            raise ClipError(
                f"{file}: is truncated: its array of shape {header.shape} needs "
                f"{header.nbytes} bytes, {left} are there."
            )
        stream.seek(here)
        array = read_array(stream, header, str(file))
        recording = from_fields({"joints": array}, str(file), named=False)
        if header.nbytes == left:
            return recording
        note = "holds more than one array, of which the first is read"
        return replace(recording, notes=(*recording.notes, note))


def is_sequence(folder: Path) -> bool:
    """Whether a folder is one clip: numbered files of one frame each, as of MediaPipe's values."""
    try:
        files = list(folder.glob("*.npy"))
        if len(files) < 2 or not all(_NUMBERED.fullmatch(file.name) for file in files):
            return False
        with files[0].open("rb") as stream:
            return len(read_header(stream, str(files[0])).shape) == 1
    except (ClipError, OSError, ValueError):
        return False


def read_sequence(folder: Path) -> Recording:
    """The frames of such a folder, in the order of their numbers.

    Raises:
        ClipError: a frame cannot be read, or is unlike the first.
    """
    rows: list[NDArray[Any]] = []
    for file in sorted(folder.glob("*.npy"), key=lambda file: int(file.stem)):
        with file.open("rb") as stream:
            header = read_header(stream, str(file))
            if header.nbytes > MEGABYTE or len(rows) == LONGEST_CLIP:
                raise ClipError(f"{file}: holds more than a frame of a clip may.")
            rows.append(read_array(stream, header, str(file)))
        if rows[-1].shape != rows[0].shape or rows[-1].dtype.kind not in "iuf":
            raise ClipError(f"{file}: is no frame like the first of {folder}: {rows[0].shape}.")
    return from_fields({"joints": np.stack(rows)}, str(folder), named=False)


def read_header(stream: IO[bytes], where: str) -> ArrayHeader:
    """Parse the header of an array.

    Raises:
        ClipError: it is damaged, announces too much, or an array that is not plain numbers
            or text (Python objects would have to be unpickled).
    """
    start = stream.read(len(MAGIC) + 2)
    if not start.startswith(MAGIC):
        raise ClipError(
            f"{where}: is not a NumPy array (it does not begin with the mark of one); save it "
            "by numpy.save."
        )
    width = 2 if start[-2:-1] == b"\x01" else 4
    length = int.from_bytes(stream.read(width), "little")
    if length > _LONGEST_HEADER:
        raise ClipError(f"{where}: is damaged: the array's header announces {length} bytes.")
    header = stream.read(length).decode("latin-1")
    entries = {match[1]: match.groups()[1:] for match in _ENTRY.finditer(header)}
    if set(entries) != {"descr", "fortran_order", "shape"}:
        raise ClipError(f"{where}: is damaged: the array's header cannot be read.")
    kind, order, shape = entries["descr"][0], entries["fortran_order"][1], entries["shape"][2]
    if kind is not None and "O" in kind:
        raise ClipError(
            f"{where}: holds Python objects, which are never loaded because that could run any "
            "program. Save plain numbers: numpy.save(file, numpy.array(poses, dtype=float)), "
            "with the same number of people and joints in each frame."
        )
    if kind is None or not _DTYPE.fullmatch(kind):
        raise ClipError(
            f"{where}: holds an array of type {kind or 'record'!r}; save plain numbers (float32)."
        )
    if order is None or shape is None:
        raise ClipError(f"{where}: is damaged: the array's header cannot be read.")
    sizes = tuple(int(size) for size in shape.replace(",", " ").split())
    announced = ArrayHeader(np.dtype(kind), sizes, order == "True")
    if 0 in sizes:
        raise ClipError(f"{where}: holds an empty array of shape {sizes}.")
    if announced.nbytes > LARGEST_ARRAY or len(sizes) > 8:
        raise ClipError(
            f"{where}: announces an array of shape {sizes}, {announced.nbytes // MEGABYTE} MB; "
            f"at most {LARGEST_ARRAY // MEGABYTE} MB are read."
        )
    return announced


def read_array(stream: IO[bytes], header: ArrayHeader, where: str) -> NDArray[Any]:
    """Read the data that `header` announces, no more."""
    data = bytearray(header.nbytes)
    view, filled = memoryview(data), 0
    while filled < len(data):
        piece = stream.read(min(len(data) - filled, 2**20))
        if not piece:
            raise ClipError(
                f"{where}: is truncated: {filled} of {len(data)} bytes of its array are there."
            )
        view[filled : filled + len(piece)] = piece
        filled += len(piece)
    array = np.frombuffer(data, dtype=header.dtype)
    if header.dtype.kind == "U":
        _check_text(array, where)
    if header.fortran_order:
        return array.reshape(header.shape[::-1]).transpose()
    return array.reshape(header.shape)


def _check_text(array: NDArray[np.str_], where: str) -> None:
    """Refuse numbers that are no characters, which Python's strings cannot hold, and halves of
    pairs, which no encoding can."""
    codes = array.view(np.dtype(np.uint32).newbyteorder(array.dtype.byteorder))
    if ((codes > sys.maxunicode) | ((codes >= 0xD800) & (codes <= 0xDFFF))).any():
        raise ClipError(f"{where}: is damaged: its text holds what are no characters.")
