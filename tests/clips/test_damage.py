"""Every reader gets files that were damaged by chance or made to hurt.

Whatever a file holds, reading it gives a clip or the documented error, in bounded time and
memory.
"""

from __future__ import annotations

import tempfile
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from cases import cases
from hypothesis import given, settings
from hypothesis import strategies as st

from actioncli.clips.collection import read_collection
from actioncli.clips.read import CLIP_SUFFIXES, read_clip
from actioncli.clips.skeleton import DEFAULT_JOINTS, LAYOUTS
from actioncli.errors import ClipError
from tests.security.limits import run_limited

from .bodies import (
    kinect_v2,
    waving,
    write_bvh,
    write_csv,
    write_json,
    write_npy,
    write_npz,
    write_ntu,
    write_trc,
)

BODY = waving(5).round(3)
DAMAGE = settings(max_examples=cases(100), deadline=5000)
# What breaks parsers that believe what they read.
TOKENS = [
    b"-1", b"0", b"99999999999999", b"nan", b"inf", b"-1e999", b"1e39", b"\0", b"\xff\xfe", b"\n",
    b"{", b"}", b"[", b"]", b",", b"\t", b'"', b"null", b"'shape': (", b"|O", b"<U9", b"True",
    b"\xed\xa0\x80", "½".encode(), "٣".encode(), b"1_0", b"0x10",
]  # fmt: skip
PIECES = st.sampled_from(TOKENS) | st.binary(max_size=8)


@pytest.fixture(scope="module")
def folder() -> Iterator[Path]:
    with tempfile.TemporaryDirectory() as name:
        yield Path(name)


class Intact(dict[str, bytes]):
    """File contents by suffix, too long to print."""

    def __repr__(self) -> str:
        return "intact"


@pytest.fixture(scope="module")
def intact(folder: Path) -> Intact:
    """A valid small file of each format."""
    seen = np.ones((5, 15)).tolist()
    ntu = [[("1", frame), ("2", frame)] for frame in kinect_v2(BODY)]
    files = [
        write_npy(folder / "a.npy", waving(5, LAYOUTS["smpl_24"]).astype(np.float32)),
        write_npz(folder / "a.npz", np.stack([BODY, BODY], axis=1), fps=30.0, unit="m", up="y"),
        write_json(
            folder / "a.json",
            BODY,
            fps=30,
            unit="m",
            up="y",
            confidence=seen,
        ),
        write_csv(folder / "a.csv", BODY),
        write_ntu(folder / "a.skeleton", ntu),
        write_trc(folder / "a.trc", BODY),
        write_bvh(folder / "a.bvh", BODY),
    ]
    for file in files:
        read_clip(file)
    return Intact((file.suffix, file.read_bytes()) for file in files)


def outcome(read: Callable[..., object], file: Path, content: bytes, **options: Any) -> str:
    """The documented error's message, or nothing; any other error fails the test."""
    file.write_bytes(content)
    try:
        read(file, **options)
    except ClipError as error:
        return str(error)
    return ""


def check(file: Path, content: bytes, **options: Any) -> None:
    message = outcome(read_clip, file, content, **options)
    assert not message or (str(file) in message and message.endswith((".", ")"))), message


def cut(content: bytes, at: float) -> bytes:
    return content[: int(at * len(content))]


@pytest.mark.parametrize("suffix", CLIP_SUFFIXES)
@DAMAGE
@given(at=st.floats(0, 1), settled=st.booleans())
def test_truncation(folder: Path, intact: Intact, suffix: str, at: float, settled: bool) -> None:
    options = {"unit": "m", "up": "y"} if settled else {}
    check(folder / f"b{suffix}", cut(intact[suffix], at), **options)


@pytest.mark.parametrize("suffix", CLIP_SUFFIXES)
@DAMAGE
@given(
    flips=st.lists(
        st.tuples(st.floats(0, 1, exclude_max=True), st.integers(0, 7)), min_size=1, max_size=8
    )
)
def test_flipped_bits(
    folder: Path, intact: Intact, suffix: str, flips: list[tuple[float, int]]
) -> None:
    content = bytearray(intact[suffix])
    for at, bit in flips:
        content[int(at * len(content))] ^= 1 << bit
    check(folder / f"b{suffix}", bytes(content), unit="m", up="y")


@pytest.mark.parametrize("suffix", CLIP_SUFFIXES)
@DAMAGE
@given(
    edits=st.lists(
        st.tuples(st.floats(0, 1), st.integers(0, 30), PIECES),
        min_size=1, max_size=5,
    )
)  # fmt: skip
def test_replaced_pieces(
    folder: Path, intact: Intact, suffix: str, edits: list[tuple[float, int, bytes]]
) -> None:
    content = intact[suffix]
    for at, length, piece in edits:
        # Headers are short and matter most: half of the edits hit the first 500 bytes.
        start = int(at * (500 if length % 2 else len(content)))
        content = content[:start] + piece + content[start + length :]
    check(folder / f"b{suffix}", content, unit="m", up="y")


@pytest.mark.parametrize("suffix", CLIP_SUFFIXES)
@DAMAGE
@given(content=st.binary(max_size=200))
def test_random_bytes(folder: Path, suffix: str, content: bytes) -> None:
    check(folder / f"b{suffix}", content)


HEADERS = {
    ".npy": [b"\x93NUMPY\x01\x00\x76\x00", b"\x93NUMPY\x01\x00\x10\x00{'descr': "],
    ".npz": [b"PK\x03\x04"],
    ".json": [b'{"joints": [[[', b'{"frames": [{"joints": ', b'[{"lsho": ['],
    ".csv": [b"lsho_x,lsho_y,lsho_z\n", b"time,id,x0;y0;z0\n"],
    ".skeleton": [b"2\n1\n", b"3\n1\n7 0 0\n25\n"],
    ".trc": [b"PathFileType\t4\nDataRate\tUnits\n30\tmm\nFrame#\tTime\ta\tb\n"],
    ".bvh": [
        b"HIERARCHY\nROOT a\n{\nOFFSET 0 0 0\nCHANNELS 3 Xposition Yposition Zposition\n",
        b"HIERARCHY\nROOT a\n{\nCHANNELS 1 Xposition\n}\nMOTION\nFrames: 2\nFrame Time: 0.1\n",
    ],
}
SYNTAX = "0 1 2.5 -3 nan inf 1e400 { } JOINT End Site OFFSET CHANNELS MOTION , : ; Frames: [ ] null"
WORDS = st.lists(
    st.sampled_from([*SYNTAX.split(), "\t", "\n"]) | st.text(max_size=3), max_size=40
).map(" ".join)


@pytest.mark.parametrize("suffix", CLIP_SUFFIXES)
@DAMAGE
@given(data=st.data(), text=WORDS)
def test_a_header_and_nonsense(folder: Path, suffix: str, data: st.DataObject, text: str) -> None:
    header = data.draw(st.sampled_from(HEADERS[suffix]))
    check(folder / f"b{suffix}", header + text.encode("utf-8", "surrogatepass"))


@DAMAGE
@given(
    at=st.floats(0, 1),
    flips=st.lists(st.tuples(st.floats(0, 1, exclude_max=True), st.integers(0, 7)), max_size=6),
)
def test_damaged_collections(folder: Path, at: float, flips: list[tuple[float, int]]) -> None:
    intact = folder / "collection.npz"
    if not intact.exists():
        np.savez(
            intact, joints_mm=(1000 * np.concatenate([BODY, BODY])).astype(np.int16),
            lengths=np.array([5, 5]), labels=np.array(["a", "b"]), subjects=np.array(["s", "s"]),
            joint_names=np.array(DEFAULT_JOINTS), fps=np.float32(30),
        )  # fmt: skip
    content = bytearray(intact.read_bytes())
    for place, bit in flips:
        content[int(place * len(content))] ^= 1 << bit
    file = folder / "damaged.npz"
    damaged = bytes(content) if flips else cut(bytes(content), at)
    message = outcome(read_collection, file, damaged)
    assert not message or str(file) in message


BOMBS = """
import sys, zipfile
import numpy as np
from pathlib import Path
from actioncli.clips.collection import read_collection
from actioncli.clips.read import read_clip
from actioncli.errors import ClipError
from tests.security.limits import run_limited

here = Path(sys.argv[1])
large = np.zeros((2**18, 21, 3), np.float32)
np.savez_compressed(here / "zeros.npz", joints=large)
many = zipfile.ZipFile(here / "bomb.npz", "w", zipfile.ZIP_DEFLATED)
header = b"{'descr': '<f8', 'fortran_order': False, 'shape': (31000000, 1), }\\n"
start = b"\\x93NUMPY\\x01\\x00" + len(header).to_bytes(2, "little") + header
with many.open("joints.npy", "w") as member:
    member.write(start)
    for _ in range(248):
        member.write(bytes(10**6))
many.close()
(here / "announced.npy").write_bytes(start.replace(b"31000000, 1", b"31000000000"))
np.save(here / "longest.npy", np.random.default_rng(0).normal(size=(2**18, 20, 3)))
(here / "lists.json").write_text("[" + "[[],[]]," * 600_000 + "[]]")
(here / "numbers.json").write_text("[" + "1," * 3_900_000 + "1]")
name = "a" * 50_000_000
(here / "names.json").write_text('{"joints": [[1,2,3]], "joint_names": ["%s", "b"]}' % name)
(here / "rows.csv").write_text("a_x,a_y,a_z\\n" + "1,2,3\\n" * 1_000_000)
with open(here / "frames.skeleton", "w") as file:
    file.write("16000000\\n" + "0\\n" * 16_000_000)
with open(here / "huge.trc", "wb") as file:
    file.truncate(300_000_000)
with open(here / "sparse.npy", "wb") as file:
    file.truncate(5_000_000_000)

for file in sorted(here.iterdir()):
    for read in (read_clip, read_collection):
        try:
            read(file)
            print(file.name, "read")
        except ClipError as error:
            print(file.name, error)
"""


def test_bombs_take_less_than_a_gigabyte(tmp_path: Path) -> None:
    told = run_limited(BOMBS, tmp_path, seconds=120)
    assert not any(line.endswith(" read") for line in told)
    assert not any("more memory than there is" in line for line in told), told
