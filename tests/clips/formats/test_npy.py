from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest

from actioncli.clips.checks import noted, require_usable
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


@pytest.mark.parametrize(
    ("shape", "cut"),
    [
        ((3, 3, 40, 25, 2), "a[0].transpose(1, 3, 2, 0)"),
        ((1, 3, 40, 25, 1), "a[0].transpose(1, 3, 2, 0)"),
        ((3, 40, 25, 2), "a.transpose(1, 3, 2, 0)"),
        ((4, 40, 150), "a[0].reshape(-1, 2, 25, 3)"),
    ],
)
def test_arrays_of_ntu_rgb_d_come_with_the_line_that_cuts_one_out(
    tmp_path: Path, shape: tuple[int, ...], cut: str
) -> None:
    body = np.repeat(waving(40, LAYOUTS["kinect_v2_25"])[:, None], 2, axis=1)
    a = body.reshape(40, 150)[None] if shape[-1] == 150 else body.transpose(3, 0, 2, 1)
    a = np.resize(a[..., : shape[-1]] if shape[-1] == 1 else a, shape)
    np.save(tmp_path / "a.npy", a)
    with pytest.raises(ClipError, match=re.escape(f"numpy.save('clip.npy', {cut})")):
        read(tmp_path / "a.npy")
    order = {
        "a[0].tr": lambda: a[0].transpose(1, 3, 2, 0),
        "a.trans": lambda: a.transpose(1, 3, 2, 0),
    }
    one = order.get(cut[:7], lambda: a[0].reshape(-1, 2, 25, 3))()
    np.save(tmp_path / "a.npy", one)
    np.testing.assert_allclose(read(tmp_path / "a.npy").positions[:, 0], body[:, 0], atol=1e-6)


@pytest.mark.parametrize("width", [132, 258, 1662])
@pytest.mark.parametrize("height", [0.3, 0.8])
def test_mediapipes_landmarks_in_a_picture_are_read_and_told(
    tmp_path: Path, width: int, height: float
) -> None:
    body = waving(40, LAYOUTS["blazepose_33"])
    hips = body[:, 23:25].mean(axis=1, keepdims=True)
    seen = (body - hips) * [height, -height, height] / 2 + [0.4, 0.6, 0]
    rows = np.zeros((40, width))
    rows[:, :132] = np.concatenate([seen, np.ones((40, 33, 1))], axis=2).reshape(40, -1)
    np.save(tmp_path / "a.npy", rows)
    clip = noted(read_clip(tmp_path / "a.npy"))
    assert any("landmarks in the picture" in note for note in clip.notes)
    require_usable(clip)
    line = [clip.joints[:, at] - clip.joints[:, 11] for at in (13, 15)]
    whole = [body[:, at] - body[:, 11] for at in (13, 15)]
    ratio = np.linalg.norm(line, axis=2) / np.linalg.norm(whole, axis=2)
    np.testing.assert_allclose(ratio, ratio[0, 0], rtol=1e-4)
    # The same without a depth is none, and without their visibilities nothing says what z is.
    flat = np.concatenate([seen * [1, 1, 0], np.ones((40, 33, 1))], axis=2)
    for other in (flat.reshape(40, -1), seen):
        np.save(tmp_path / "a.npy", other)
        with pytest.raises(ClipError, match=r"no depth|as in a picture"):
            require_usable(read_clip(tmp_path / "a.npy"))


def test_more_than_one_array_is_told(tmp_path: Path) -> None:
    with (tmp_path / "a.npy").open("wb") as stream:
        for _ in range(2):
            np.save(stream, waving())
    assert "holds more than one array, of which the first is read" in read(tmp_path / "a.npy").notes


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
