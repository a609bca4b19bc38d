"""Every reader gets files that were damaged by chance or made to hurt.

Whatever a file holds, reading it gives a clip or the documented error; that it does so in bounded
time and memory is tested in `tests/security/test_files.py`.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest
from cases import cases
from fuzz.readers import CORPUS, READERS, Reader
from hypothesis import given, settings
from hypothesis import strategies as st

from actioncli.errors import ClipError

FORMATS = ("npy", "npz", "json", "csv", "ntu", "trc", "bvh")
DAMAGE = settings(max_examples=cases(200), deadline=5000)
# What breaks parsers that believe what they read.
TOKENS = [
    b"-1", b"0", b"99999999999999", b"nan", b"inf", b"-1e999", b"1e39", b"\0", b"\xff\xfe", b"\n",
    b"{", b"}", b"[", b"]", b",", b"\t", b'"', b"null", b"'shape': (", b"|O", b"<U9", b"True",
    b"\xed\xa0\x80", "½".encode(), "٣".encode(), b"1_0", b"0x10",
]  # fmt: skip
PIECES = st.sampled_from(TOKENS) | st.binary(max_size=8)


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("damage")


def check(reader: Reader, folder: Path, content: bytes) -> None:
    """Reading gives something or the documented error, which names the file."""
    file = folder / f"a{reader.suffix}"
    file.write_bytes(content)
    try:
        reader.read(file)
    except ClipError as error:
        message = str(error)
        assert str(file) in message, message
        assert message.endswith((".", ")")), message


SHARES = st.floats(0, 1, exclude_max=True)


@st.composite
def damages(draw: st.DrawFn) -> Callable[[bytes], bytes]:
    """Ways to cut a file off, to flip some of its bits or to exchange some of its pieces."""
    kind = draw(st.sampled_from(["cut", "flip", "replace", "replace"]))
    if kind == "cut":
        share = draw(SHARES)
        return lambda content: content[: int(share * len(content))]
    flips = st.tuples(SHARES, st.integers(0, 7))
    edits = st.tuples(SHARES, st.integers(0, 30), PIECES)
    chosen = draw(st.lists(flips if kind == "flip" else edits, min_size=1, max_size=6))

    def damaged(content: bytes) -> bytes:
        for share, number, *piece in chosen:
            at = int(share * len(content))
            if piece:
                # Headers are short and matter most: half of the edits hit the first 500 bytes.
                at = int(share * 500) if number % 2 else at
                content = content[:at] + piece[0] + content[at + number :]
            else:
                content = content[:at] + bytes([content[at] ^ 1 << number]) + content[at + 1 :]
        return content

    return damaged


@pytest.mark.parametrize("name", [*FORMATS, "collection"])
@DAMAGE
@given(damage=damages())
def test_damaged_files(folder: Path, name: str, damage: Callable[[bytes], bytes]) -> None:
    check(READERS[name], folder, damage((CORPUS / name / "seed").read_bytes()))


@pytest.mark.parametrize("name", FORMATS)
@DAMAGE
@given(content=st.binary(max_size=200))
def test_random_bytes(folder: Path, name: str, content: bytes) -> None:
    check(READERS[name], folder, content)


HEADERS = {
    "npy": [b"\x93NUMPY\x01\x00\x76\x00", b"\x93NUMPY\x01\x00\x10\x00{'descr': "],
    "npz": [b"PK\x03\x04"],
    "json": [b'{"joints": [[[', b'{"frames": [{"joints": ', b'[{"lsho": ['],
    "csv": [b"lsho_x,lsho_y,lsho_z\n", b"time,id,x0;y0;z0\n"],
    "ntu": [b"2\n1\n", b"3\n1\n7 0 0\n25\n"],
    "trc": [b"PathFileType\t4\nDataRate\tUnits\n30\tmm\nFrame#\tTime\ta\tb\n"],
    "bvh": [
        b"HIERARCHY\nROOT a\n{\nOFFSET 0 0 0\nCHANNELS 3 Xposition Yposition Zposition\n",
        b"HIERARCHY\nROOT a\n{\nCHANNELS 1 Xposition\n}\nMOTION\nFrames: 2\nFrame Time: 0.1\n",
    ],
}
SYNTAX = "0 1 2.5 -3 nan inf 1e400 { } JOINT End Site OFFSET CHANNELS MOTION , : ; Frames: [ ] null"
WORDS = st.lists(
    st.sampled_from([*SYNTAX.split(), "\t", "\n"]) | st.text(max_size=3), max_size=40
).map(" ".join)


@pytest.mark.parametrize("name", FORMATS)
@DAMAGE
@given(data=st.data(), text=WORDS)
def test_a_header_and_nonsense(folder: Path, name: str, data: st.DataObject, text: str) -> None:
    header = data.draw(st.sampled_from(HEADERS[name]))
    check(READERS[name], folder, header + text.encode("utf-8", "surrogatepass"))
