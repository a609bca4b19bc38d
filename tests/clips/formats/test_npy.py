from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from actioncli.clips.formats.npy import read
from actioncli.clips.read import find_clips, read_clip
from actioncli.clips.skeleton import LAYOUTS
from actioncli.errors import ClipError

from ..bodies import waving


def header(text: str) -> bytes:
    content = text.encode("latin-1") + b"\n"
    return b"\x93NUMPY\x01\x00" + len(content).to_bytes(2, "little") + content


@pytest.mark.parametrize("dtype", ["<f4", ">f4", "<f8", "<f2", "<i2", ">i4", "<i8", "u1"])
def test_numbers_of_all_kinds(tmp_path: Path, dtype: str) -> None:
    body = (20 * waving()).astype(dtype)
    np.save(tmp_path / "a.npy", body)
    recording = read(tmp_path / "a.npy")
    np.testing.assert_array_equal(recording.positions[:, 0], body.astype(np.float32))
    assert recording.positions.dtype == np.float32


@pytest.mark.parametrize("version", [(1, 0), (2, 0), (3, 0)])
def test_all_versions_and_orders(tmp_path: Path, version: tuple[int, int]) -> None:
    body = waving().astype(np.float32)
    for array in (body, np.asfortranarray(body)):
        with (tmp_path / "a.npy").open("wb") as stream:
            np.lib.format.write_array(stream, array, version=version)
        np.testing.assert_array_equal(read(tmp_path / "a.npy").positions[:, 0], body)


def test_shapes(tmp_path: Path) -> None:
    body = waving().astype(np.float32)
    for shape in [(40, 45), (40, 15, 3), (40, 1, 15, 3), (1, 40, 15, 3), (1, 40, 1, 15, 3)]:
        np.save(tmp_path / "a.npy", body.reshape(shape))
        np.testing.assert_array_equal(read(tmp_path / "a.npy").positions[:, 0], body)
    for shape in [(40, 9, 5), (1800,), (40, 5, 3, 3, 1), (20, 30, 3, 1)]:
        np.save(tmp_path / "a.npy", np.resize(body, shape))
        with pytest.raises(ClipError, match=r"a\.npy: joint positions must be"):
            read(tmp_path / "a.npy")
    np.save(tmp_path / "a.npy", body[..., :2])
    with pytest.raises(ClipError, match="2D"):
        read(tmp_path / "a.npy")
    np.save(tmp_path / "a.npy", np.zeros((40, 33, 4)))
    with pytest.raises(ClipError, match="confidence"):
        read(tmp_path / "a.npy")


def test_objects_are_never_unpickled(tmp_path: Path) -> None:
    ragged = np.empty(2, object)
    ragged[:] = [np.zeros((1, 15, 3)), np.zeros((2, 15, 3))]
    np.save(tmp_path / "a.npy", ragged, allow_pickle=True)
    with pytest.raises(ClipError, match=r"holds Python objects.*numpy\.save"):
        read(tmp_path / "a.npy")


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (b"hello, this is a text", "not a NumPy array"),
        (b"\x93NUMPY\x01", "not a NumPy array|damaged"),
        (header("{'descr': '<f4', 'fortran_order': False, 'shape': (9999999999, 15, 3), }"), "MB"),
        (header("{'descr': '<f4', 'fortran_order': False, 'shape': (-1, 15, 3), }"), "damaged"),
        (header("{'descr': '<f4', 'fortran_order': False, 'shape': (0, 15, 3), }"), "empty array"),
        (header("{'descr': '<f4', 'fortran_order': False, 'shape': (40, 15, 3), }"), "truncated"),
        (header("{'descr': '<f4', 'fortran_order': __import__('os'), 'shape': (1,)}"), "damaged"),
        (header("{'descr': [('x', '<f4')], 'fortran_order': False, 'shape': (4,), }"), "record"),
        (header("{'descr': '<c8', 'fortran_order': False, 'shape': (4,), }"), "type '<c8'"),
        (header("(" * 9000), "damaged"),
        (b"\x93NUMPY\x02\x00\xff\xff\xff\xff{", "damaged"),
    ],
)
def test_damaged_headers(tmp_path: Path, content: bytes, message: str) -> None:
    (tmp_path / "a.npy").write_bytes(content)
    with pytest.raises(ClipError, match=rf"a\.npy: .*({message})"):
        read(tmp_path / "a.npy")


def test_text_and_complex_numbers_are_no_positions(tmp_path: Path) -> None:
    for body in (waving().astype("U8"), waving() > 1):
        np.save(tmp_path / "a.npy", body)
        with pytest.raises(ClipError, match="must be numbers"):
            read(tmp_path / "a.npy")


def test_a_folder_of_numbered_frames_is_a_clip(tmp_path: Path) -> None:
    """As MP_Data: a folder an action, in it one a sequence, in it a file a frame."""
    body = waving(12, LAYOUTS["holistic_75"])
    hands = body[:, 33:].copy()
    hands[:4, :21] = hands[:, 21:] = 0  # not found
    pose = np.concatenate([body[:, :33], np.ones((12, 33, 1))], axis=2).reshape(12, -1)
    values = [pose, np.concatenate([pose, np.ones((12, 3 * 468)), hands.reshape(12, -1)], axis=1)]
    for action, sequence in (("hello", 0), ("hello", 1), ("thanks", 0)):
        folder = tmp_path / "MP_Data" / action / str(sequence)
        folder.mkdir(parents=True)
        for frame, row in enumerate(values[sequence]):
            np.save(folder / f"{frame}.npy", row)
    found = find_clips([tmp_path / "MP_Data" / "hello"])
    assert [clip.name for clip in found] == ["0", "1"]
    np.save(tmp_path / "whole.npy", values[1])
    for file, joints in zip([*found, tmp_path / "whole.npy"], (33, 54, 54), strict=True):
        clip = read_clip(file, up="y")
        assert clip.joint_names == LAYOUTS["holistic_75"][:joints]
        np.testing.assert_allclose(clip.joints[4:], body[4:, :joints], atol=1e-5)
        assert clip.confidence is not None
        np.testing.assert_array_equal(clip.confidence[:, :33], 1)
        np.testing.assert_array_equal(
            clip.confidence[3:5, 33:], [[0] * (joints - 33), [1] * (joints - 33)]
        )
    # Numbered clips stay what they are.
    for number in range(3):
        np.save(tmp_path / f"{number}.npy", body)
    assert [clip.name for clip in find_clips([tmp_path])][:3] == ["0.npy", "1.npy", "2.npy"]
    np.save(folder / "3.npy", np.zeros(7))
    with pytest.raises(ClipError, match="is no frame like the first"):
        read_clip(folder)
