"""Every reader gets files that were damaged by chance or made to hurt.

Whatever a file holds, reading it gives a clip or the documented error; that it does so in bounded
time and memory is tested in `tests/security/test_files.py`.
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
DAMAGE = settings(max_examples=cases(200), deadline=5000)
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
        write_json(folder / "a.json", BODY, fps=30, unit="m", up="y", confidence=seen),
        write_csv(folder / "a.csv", BODY),
        write_ntu(folder / "a.skeleton", ntu),
        write_trc(folder / "a.trc", BODY),
        write_bvh(folder / "a.bvh", BODY),
    ]
    for file in files:
        read_clip(file)
    return Intact((file.suffix, file.read_bytes()) for file in files)


def check(read: Callable[..., object], file: Path, content: bytes, **options: Any) -> None:
    """Reading gives something or the documented error, which names the file."""
    file.write_bytes(content)
    try:
        read(file, **options)
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


@pytest.mark.parametrize("suffix", CLIP_SUFFIXES)
@DAMAGE
@given(damage=damages(), settled=st.booleans())
def test_damaged_clips(
    folder: Path, intact: Intact, suffix: str, damage: Callable[[bytes], bytes], settled: bool
) -> None:
    options = {"unit": "m", "up": "y"} if settled else {}
    check(read_clip, folder / f"b{suffix}", damage(intact[suffix]), **options)


@pytest.mark.parametrize("suffix", CLIP_SUFFIXES)
@DAMAGE
@given(content=st.binary(max_size=200))
def test_random_bytes(folder: Path, suffix: str, content: bytes) -> None:
    check(read_clip, folder / f"b{suffix}", content)


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
    check(read_clip, folder / f"b{suffix}", header + text.encode("utf-8", "surrogatepass"))


@DAMAGE
@given(damage=damages())
def test_damaged_collections(folder: Path, damage: Callable[[bytes], bytes]) -> None:
    intact = folder / "collection.npz"
    if not intact.exists():
        np.savez(
            intact, joints_mm=(1000 * np.concatenate([BODY, BODY])).astype(np.int16),
            lengths=np.array([5, 5]), labels=np.array(["a", "b"]), subjects=np.array(["s", "s"]),
            joint_names=np.array(DEFAULT_JOINTS), fps=np.float32(30),
        )  # fmt: skip
    check(read_collection, folder / "damaged.npz", damage(intact.read_bytes()))
