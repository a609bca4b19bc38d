from __future__ import annotations

import zipfile
from pathlib import Path

import numpy as np
import pytest

from actioncli.clips.formats.npz import read
from actioncli.clips.read import read_clip
from actioncli.clips.skeleton import DEFAULT_JOINTS, LAYOUTS, select_joints
from actioncli.errors import ClipError

from ..bodies import waving, write_npz


def test_what_metrabs_users_save(tmp_path: Path) -> None:
    people = np.stack([1000 * waving(), 900 * waving()], axis=1)
    np.savez_compressed(
        tmp_path / "a.npz",
        poses3d=people,
        poses2d=people[..., :2],
        boxes=np.zeros((40, 2, 5)),
        joint_names=np.array([name.encode() for name in DEFAULT_JOINTS]),
        fps=29.97,
        unit="mm",
        up=np.array(["-y"]),
        layout="default_15",
    )
    recording = read(tmp_path / "a.npz")
    np.testing.assert_array_equal(recording.positions, people.astype(np.float32))
    assert recording.joint_names == DEFAULT_JOINTS
    assert (recording.fps, recording.unit, recording.up) == (29.97, "mm", "-y")
    assert recording.layout == "default_15"


def test_a_single_unnamed_array(tmp_path: Path) -> None:
    np.savez(tmp_path / "a.npz", waving())
    assert read(tmp_path / "a.npz").positions.shape == (40, 1, 15, 3)
    np.savez(tmp_path / "b.npz", keypoints=waving())
    assert read(tmp_path / "b.npz").positions.shape == (40, 1, 15, 3)


@pytest.mark.parametrize(
    ("low", "high", "told"),
    [
        (0, 1.02, []),
        (-0.5, 1, ["confidence is negative for 33.3% of the joint positions"]),
        (0, 97, ["confidence reaches 97 instead of 1: taken for parts of 100"]),
        (0, 2.5, ["confidence reaches 2.5 instead of 1: of which more than 1 counts as 1"]),
        (0, 4000, ["confidence reaches 4e+03 instead of 1: of which more than 1 counts as 1"]),
        (np.nan, np.nan, ["confidence is NaN for 100.0% of the joint positions"]),
        (-1, 97, ["confidence is negative", "confidence reaches 97"]),
    ],
)
def test_confidence_that_is_none_is_told(
    tmp_path: Path, low: float, high: float, told: list[str]
) -> None:
    confidence = np.linspace(low, high, 600).reshape(40, 15)
    recording = read(write_npz(tmp_path / "a.npz", waving(), confidence=confidence))
    assert recording.confidence is not None
    assert recording.confidence.shape == (40, 1, 15)
    assert recording.confidence.min() >= 0
    assert recording.confidence.max() <= 1
    assert len(recording.notes) == len(told)
    assert all(note.startswith(start) for note, start in zip(recording.notes, told, strict=True))
    if high == 97:
        assert recording.confidence.max() == np.float32(0.97)


def test_confidence_in_steps_and_where_nobody_is(tmp_path: Path) -> None:
    body, steps = waving(), np.tile(np.arange(15) % 4, (40, 1))
    recording = read(write_npz(tmp_path / "a.npz", body, confidence=steps))
    np.testing.assert_array_equal(recording.confidence[:, 0], (steps / 3).astype(np.float32))
    body[3], steps = np.nan, np.where(np.arange(40)[:, None] == 3, np.nan, 1.0) * np.ones(15)
    assert read(write_npz(tmp_path / "b.npz", body, confidence=steps)).notes == ()


@pytest.mark.parametrize(
    ("fields", "message"),
    [
        ({"boxes": np.ones(3), "names": np.ones(3)}, "holds 'boxes', 'names'.*poses3d or joints"),
        ({"joints": waving(), "joint_names": np.ones(15)}, "joint_names must be a list"),
        ({"joints": waving(), "fps": np.ones(3)}, "fps must be one number"),
        ({"joints": waving(), "fps": "fast"}, "fps must be one number"),
        ({"joints": waving(), "unit": np.array(["m", "m"])}, "unit must be one word"),
        ({"joints": waving(), "confidence": np.ones((40, 3))}, "confidence must be"),
        ({"joints": np.array([1, None])}, "holds Python objects"),
        ({"joints_mm": np.ones((3, 1, 3)), "lengths": np.ones(7)}, "a collection of 7 clips"),
    ],
)
def test_fields_that_do_not_fit(
    tmp_path: Path, fields: dict[str, np.ndarray], message: str
) -> None:
    np.savez(tmp_path / "a.npz", **fields)
    with pytest.raises(ClipError, match=rf"a\.npz.*{message}"):
        read(tmp_path / "a.npz")


def write_zip(file: Path, content: bytes, method: int = zipfile.ZIP_DEFLATED) -> Path:
    with zipfile.ZipFile(file, "w", method) as archive:
        archive.writestr("joints.npy", content)
    return file


def test_an_array_that_announces_too_much(tmp_path: Path) -> None:
    header = b"{'descr': '<f4', 'fortran_order': False, 'shape': (900000000, 3), }\n"
    start = b"\x93NUMPY\x01\x00" + len(header).to_bytes(2, "little") + header
    with pytest.raises(ClipError, match=r"10800 MB; at most 256 MB"):
        read(write_zip(tmp_path / "a.npz", start + bytes(1000)))
    small = start.replace(b"900000000", b"900000   ")
    with pytest.raises(ClipError, match="truncated"):
        read(write_zip(tmp_path / "b.npz", small + bytes(1000)))


def test_archives_that_numpy_never_writes(tmp_path: Path) -> None:
    for method in (zipfile.ZIP_BZIP2, zipfile.ZIP_LZMA):
        with pytest.raises(ClipError, match=r"numpy\.savez never uses"):
            read(write_zip(tmp_path / "a.npz", b"x", method))
    with zipfile.ZipFile(tmp_path / "b.npz", "w") as archive:
        archive.writestr("word/document.xml", "hello")
    with pytest.raises(ClipError, match="not a NumPy array"):
        read(tmp_path / "b.npz")
    (tmp_path / "c.npz").write_bytes((tmp_path / "b.npz").read_bytes() + b"more")
    with pytest.raises(ClipError, match="directory is missing"):
        read(tmp_path / "c.npz")


def test_a_directory_that_is_cut_off_or_too_large(tmp_path: Path) -> None:
    whole = write_npz(tmp_path / "a.npz", waving()).read_bytes()
    (tmp_path / "a.npz").write_bytes(whole[:-100])
    with zipfile.ZipFile(tmp_path / "b.npz", "w") as archive:
        for at in range(20_000):
            archive.writestr(f"{at}.npy", b"")
    for name in "ab":
        with pytest.raises(ClipError, match=rf"{name}\.npz: is a damaged.*missing or too large"):
            read(tmp_path / f"{name}.npz")


@pytest.mark.parametrize("key", ["joints3d", "smpl_joints3d", "pred_keypoints_3d", "Joints_3D"])
def test_what_vibe_and_pymaf_give(tmp_path: Path, key: str) -> None:
    """49 joints without names, beside SMPL's angles and pictures' places."""
    body = waving(joints=LAYOUTS["spin_49"])
    more = {"pose": np.zeros((40, 72)), "betas": np.zeros((40, 10)), "joints2d": body[..., :2]}
    np.savez(tmp_path / "a.npz", **{key: body}, **more)
    clip = read_clip(tmp_path / "a.npz")
    assert "layout inferred from 49 joints: spin_49" in clip.notes
    found = select_joints(clip.joints, clip.joint_names, DEFAULT_JOINTS)
    wanted = select_joints(waving().astype(np.float32), DEFAULT_JOINTS, DEFAULT_JOINTS)
    np.testing.assert_allclose(found, wanted, atol=1e-4)
    np.savez(tmp_path / "b.npz", **more)
    with pytest.raises(ClipError, match="are angles: save its joints"):
        read_clip(tmp_path / "b.npz")
