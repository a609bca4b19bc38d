from __future__ import annotations

import time
from pathlib import Path

import numpy as np
import pytest

from actioncli.clips.collection import Collection, read_collection
from actioncli.clips.skeleton import DEFAULT_JOINTS, LAYOUTS
from actioncli.errors import ClipError

from .bodies import waving, write_npy, write_npz

NAMES = LAYOUTS["kinect_v1_20"]


def fields(clips: int = 3) -> dict[str, np.ndarray]:
    bodies = [1000 * waving(20 + at, NAMES) for at in range(clips)]
    return {
        "joints_mm": np.concatenate(bodies).astype(np.int16),
        "lengths": np.array([len(body) for body in bodies], np.int32),
        "labels": np.array([f"action {at}" for at in range(clips)]),
        "subjects": np.array([f"s{at}" for at in range(clips)]),
        "joint_names": np.array(NAMES),
        "fps": np.float32(25),
    }


def save(file: Path, **changes: np.ndarray | None) -> Path:
    content = {key: value for key, value in (fields() | changes).items() if value is not None}
    np.savez_compressed(file, **content)
    return file


def test_an_archive_gives_its_clips(tmp_path: Path) -> None:
    collection = read_collection(save(tmp_path / "kinect.npz"))
    assert collection.name == "kinect"
    assert collection.labels == ("action 0", "action 1", "action 2")
    assert collection.subjects == ("s0", "s1", "s2")
    assert [len(clip) for clip in collection.clips] == [20, 21, 22]
    assert collection.notes == ()
    for at, clip in enumerate(collection.clips):
        assert (clip.fps, clip.joint_names) == (25, NAMES)
        np.testing.assert_allclose(clip.joints, waving(20 + at, NAMES), atol=1e-3)


def test_still_and_lost_clips_are_skipped_and_counted(tmp_path: Path) -> None:
    content = fields(4)
    starts = np.concatenate([[0], np.cumsum(content["lengths"])])
    content["joints_mm"][: starts[1]] = content["joints_mm"][0]
    content["joints_mm"][starts[1] : starts[2]] = 0
    content["joints_mm"][starts[2] + 4] = 0
    collection = read_collection(save(tmp_path / "kinect.npz", **content))
    assert collection.labels == ("action 2", "action 3")
    assert collection.notes == ("2 of 4 clips skipped (still or mostly gap)",)
    np.testing.assert_allclose(collection.clips[0].joints, waving(22, NAMES), atol=0.03)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"labels": None, "fps": None}, "not a collection: it lacks labels, fps"),
        (
            {"joints_mm": fields()["joints_mm"][:-1]},
            "lengths add up to 63 frames, joints_mm has 62",
        ),
        ({"joints_mm": fields()["joints_mm"][..., :2]}, "joints_mm must be"),
        ({"lengths": np.array([-5, 40, 28])}, "lengths must be"),
        ({"lengths": np.array([20.0, 21.0, 22.0])}, "lengths must be"),
        ({"labels": np.array(["a", "b"])}, "labels must be 3 words"),
        ({"labels": np.array([1, 2, 3])}, "labels must be 3 words"),
        ({"subjects": np.array([["a"], ["b"], ["c"]])}, "subjects must be 3 words"),
        ({"joint_names": np.array(NAMES[:-1])}, "joint_names must be 20 words"),
        ({"joint_names": np.array(["a"] * 20)}, "twice"),
        ({"fps": np.float32("nan")}, "fps must be"),
        ({"fps": np.float32(0)}, "fps must be"),
        ({"fps": np.float64(1e-300)}, "fps must be one number from 0.001 to 1,000,000"),
        ({"joints_mm": np.ones((63, 20, 3), np.int16)}, "none of its 3 clips moves"),
        ({"labels": np.array(["a", "b", None])}, "holds Python objects"),
    ],
)
def test_a_damaged_archive_is_named(
    tmp_path: Path, changes: dict[str, np.ndarray | None], message: str
) -> None:
    with pytest.raises(ClipError, match=rf"kinect\.npz.*{message}"):
        read_collection(save(tmp_path / "kinect.npz", **changes))


def test_a_folder_of_labels(tmp_path: Path) -> None:
    for name in ("wave/S001C002P003R002A013.npy", "wave/a1_s2_t3.npy", "clap/anna.npy"):
        (tmp_path / name).parent.mkdir(exist_ok=True)
        write_npy(tmp_path / name, waving(joints=LAYOUTS["smpl_24"]))
    (tmp_path / "README.md").touch()
    (tmp_path / "empty").mkdir()
    collection = read_collection(tmp_path)
    assert collection.labels == ("clap", "wave", "wave")
    assert collection.subjects == ("", "P003", "s2")
    assert collection.name == tmp_path.name
    assert len(collection) == 3


def test_what_is_no_collection(tmp_path: Path) -> None:
    write_npz(tmp_path / "clip.npz", waving(), fps=30)
    (tmp_path / "text.npz").write_text("text")
    for name, message in [
        ("clip.npz", "it lacks"),
        ("none.npz", "no such file"),
        ("text.npz", r"not an \.npz archive"),
        ("", "holds no clips"),
    ]:
        with pytest.raises(ClipError, match=message):
            read_collection(tmp_path / name)
    (tmp_path / "wave").mkdir()
    (tmp_path / "wave" / "bad.npy").write_text("text")
    with pytest.raises(ClipError, match=r"bad\.npy"):
        read_collection(tmp_path)


def test_lengths_must_agree() -> None:
    with pytest.raises(ClipError, match="belong together"):
        Collection((), ("wave",), (), "mine")


def test_recorded_collections(shared: Path) -> None:
    for file in sorted((shared / "data").glob("*.npz")):
        with np.load(file) as stored:
            clips, frames = len(stored["lengths"]), len(stored["joints_mm"])
        start = time.perf_counter()
        collection = read_collection(file)
        elapsed = time.perf_counter() - start
        assert len(collection) == clips, collection.notes
        assert frames - 10 <= sum(map(len, collection.clips)) <= frames
        # 3,000 clips in 2 s are asked for; about 0.6 s were measured.
        assert elapsed < 2 + clips / 1000


def test_joints_that_were_not_found_have_no_confidence(tmp_path: Path) -> None:
    rng = np.random.default_rng(0)
    joints = rng.integers(-500, 500, (20, 15, 3)).astype(np.int16)
    visibility = np.full((20, 15), 80, np.uint8)
    joints[5, 14] = -32768
    arrays = {
        "joints_mm": joints, "lengths": np.array([12, 8]), "labels": np.array(["a", "b"]),
        "subjects": np.array(["s", "s"]), "joint_names": np.array(DEFAULT_JOINTS), "fps": 15.0,
    }  # fmt: skip
    np.savez(tmp_path / "seen.npz", **arrays, visibility=visibility)
    first, second = read_collection(tmp_path / "seen.npz").clips
    expected = np.full((12, 15), 0.8, np.float32)
    expected[5, 14] = 0
    assert first.confidence is not None
    assert second.confidence is not None
    np.testing.assert_array_equal(first.confidence, expected)
    np.testing.assert_array_equal(second.confidence, expected[:8] * 0 + np.float32(0.8))
    assert np.isnan(first.joints[5, 14]).all()
    for wrong in (visibility[1:], visibility + 30, visibility.astype("U2")):
        np.savez(tmp_path / "wrong.npz", **arrays, visibility=wrong)
        with pytest.raises(ClipError, match="visibility must be percent"):
            read_collection(tmp_path / "wrong.npz")
