import re
import subprocess
import sys
from pathlib import Path

import cv2
import numpy as np
import pytest

from actioncli.clips.skeleton import LAYOUTS
from actioncli.errors import ClipError, UsageError
from actioncli.pose import ReadOptions, cache
from actioncli.pose.read import read_clip
from actioncli.pose.region import Image
from actioncli.pose.video import Progress, read_poses

from .videos import numbered, real_frames, rotate_in_header, write_video

MINUTE = 1800  # frames, 30 a second


@pytest.fixture(scope="session")
def waving(real_videos: Path) -> list[Image]:
    """24 frames in which a man raises both arms, 10 a second."""
    images = real_frames(real_videos / "wave_two_hands" / "sudC.avi", 24, every=3)
    return [cv2.resize(image[:, 120:520], (400, 480)) for image in images]


@pytest.fixture(scope="session")
def clapping(real_videos: Path) -> list[Image]:
    """24 frames in which another one claps before his chest."""
    return [image[:, 120:520] for image in real_frames(real_videos / "clap" / "sudB.avi", 24, 3)]


@pytest.fixture(scope="session")
def waving_video(waving: list[Image], tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_video(tmp_path_factory.mktemp("video") / "wave.mp4", waving, 10)


def test_clip_of_a_person(waving_video: Path) -> None:
    clip = read_clip(waving_video, start=0)
    assert clip.joint_names == LAYOUTS["blazepose_33"]  # his legs are in view
    assert clip.fps == pytest.approx(10, rel=0.01)
    assert len(clip) == 24
    assert clip.confidence is not None
    joints = dict(zip(clip.joint_names, clip.joints.transpose(1, 0, 2), strict=True))
    # Metres, y up: a grown man stands, and his hands come above his head.
    assert 1.2 < np.median(joints["nose"][:, 1] - joints["lank"][:, 1]) < 1.9
    assert (joints["lwri"][:, 1] - joints["nose"][:, 1]).max() > 0.1
    # He faces the camera: his left side at smaller x, his nose nearer (smaller z) than his ears.
    assert (joints["lsho"][:, 0] < joints["rsho"][:, 0]).mean() > 0.9
    assert np.median(joints["nose"][:, 2] - joints["lear"][:, 2]) < 0


def test_the_same_every_time(waving_video: Path) -> None:
    first, second = (read_clip(waving_video, end=1, cache=False) for _ in range(2))
    np.testing.assert_array_equal(first.joints, second.joints)
    assert not cache.cache_folder().exists()


def test_qualities_agree(waving_video: Path) -> None:
    fast, accurate = (
        read_clip(waving_video, start=0, end=0.7, quality=quality)
        for quality in ("fast", "accurate")
    )
    assert not np.array_equal(fast.joints, accurate.joints)
    assert np.median(np.linalg.norm(fast.joints - accurate.joints, axis=2)) < 0.1


def test_fewer_frames_show_the_same(waving_video: Path) -> None:
    every, half = (read_poses(waving_video, rate=rate).to_clip("") for rate in (None, 5))
    assert half.fps == pytest.approx(5, rel=0.01)
    assert half.duration == pytest.approx(every.duration, abs=0.21)
    away = np.linalg.norm(half.joints[:10] - every.joints[:20:2], axis=2)
    assert np.median(away) < 0.03


def test_poses_are_kept_for_the_content(
    waving_video: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    first = read_clip(waving_video, start=0, end=0.5)
    renamed = tmp_path / "renamed.mp4"
    renamed.write_bytes(waving_video.read_bytes())
    (kept,) = cache.cache_folder().glob("*.npz")
    with monkeypatch.context() as patch:
        patch.setattr("actioncli.pose.video.Tracker", None)  # looking at frames would fail
        again = read_clip(renamed, start=0, end=0.5)
    np.testing.assert_array_equal(first.joints, again.joints)
    assert again.source == str(renamed)
    read_clip(waving_video, start=0, end=0.6)
    assert len(list(cache.cache_folder().glob("*.npz"))) == 2
    with_hands = read_clip(waving_video, start=0, end=0.5, hands=True)
    assert with_hands.joint_names == LAYOUTS["holistic_75"]
    np.testing.assert_array_equal(with_hands.joints[:, :33], first.joints)
    kept.write_bytes(b"damaged")
    restored = read_clip(waving_video, start=0, end=0.5)
    np.testing.assert_array_equal(first.joints, restored.joints)


def test_phone_held_upright(waving: list[Image], tmp_path: Path) -> None:
    lying = [np.ascontiguousarray(np.rot90(image)) for image in waving[:8]]
    path = write_video(tmp_path / "phone.mp4", lying, 10)
    rotate_in_header(path)
    poses = read_poses(path, ReadOptions(cache=False))
    assert poses.size == (400, 480)
    assert len(poses.times) == 8
    assert (poses.points[:, 0, 1] < poses.points[:, 27, 1]).all()  # nose above ankle


def test_who_moves_most_is_followed(
    waving: list[Image], clapping: list[Image], tmp_path: Path
) -> None:
    both = [np.hstack(pair) for pair in zip(clapping, waving, strict=True)]
    path = write_video(tmp_path / "two.mp4", both, 10)
    poses = read_poses(path)
    assert np.median(poses.points[:, 0, 0]) > 400
    assert "followed person 2 of 2 from the left, who moves most; --person chooses" in poses.notes
    left = read_poses(path, ReadOptions(person=1))
    assert np.median(left.points[:, 0, 0]) < 400
    with pytest.raises(ClipError, match="no person 3; 2 can be followed"):
        read_poses(path, ReadOptions(person=3))


def test_a_loss_and_a_jump_are_told(waving: list[Image], tmp_path: Path) -> None:
    nobody = np.zeros_like(waving[0])
    left = [np.hstack([image, nobody]) for image in waving[:12]]
    right = [np.hstack([nobody, image]) for image in waving[12:]]
    gone = [np.hstack([nobody, nobody])] * 8
    clip = read_clip(write_video(tmp_path / "j.mp4", [*left, *gone, *right], 10), start=0)
    assert any("nobody was seen from 1.1 s to 2.0 s" in note for note in clip.notes), clip.notes
    assert any("at 2.0 s another body may be followed" in note for note in clip.notes)
    assert clip.confidence is not None
    assert (clip.confidence[12:20] == 0).all()
    assert clip.confidence[5].max() > 0.9


def test_progress(waving_video: Path) -> None:
    told: list[Progress] = []
    read_poses(waving_video, ReadOptions(end=0.45), told.append)
    assert [step.frames for step in told] == [1, 2, 3, 4, 5]
    assert told[-1].seconds == pytest.approx(0.4)
    assert told[-1].total == pytest.approx(0.45)


@pytest.mark.parametrize(
    ("frames", "options", "message"),
    [
        (10, {}, "no person was found in any of 6 frames"),
        (1, {}, "one frame"),
        (10, {"start": 5}, "no frame could be decoded from 5 s on"),
    ],
)
def test_nobody_and_nothing(
    tmp_path: Path, frames: int, options: dict[str, float], message: str
) -> None:
    with pytest.raises(ClipError, match=message):
        read_clip(write_video(tmp_path / "empty.mp4", numbered(frames)), **options)


def test_somebody_in_few_frames(waving: list[Image], tmp_path: Path) -> None:
    frames = [*waving[:3], *[np.zeros_like(waving[0])] * 9]
    path = write_video(tmp_path / "few.mp4", frames, 10)
    with pytest.raises(ClipError, match="found in 3 of 12 frames"):
        read_clip(path)
    assert len(read_clip(path, start=0, end=0.25)) == 3


def test_no_frames(tmp_path: Path) -> None:
    """A file whose header promises frames, and which ends there."""
    path = write_video(tmp_path / "cut.avi", numbered(10), fourcc="MJPG")
    content = path.read_bytes()
    path.write_bytes(content[: content.index(b"movi") + 4])
    with pytest.raises(ClipError, match=r"cut\.avi: (no frame could be decoded|not a video)"):
        read_clip(path)


def test_a_file_that_was_cut_off_is_told(waving: list[Image], tmp_path: Path) -> None:
    path = write_video(tmp_path / "cut.avi", waving, 10, "MJPG")
    content = path.read_bytes()
    path.write_bytes(content[: len(content) // 2])
    (told,) = [note for note in read_clip(path, start=0).notes if "announces" in note]
    assert re.match(r"the file announces 24 frames and 1\d could be decoded", told)


def test_a_picture_of_8_million_pixels(waving: list[Image], tmp_path: Path) -> None:
    large = [cv2.resize(image, (3840, 2160)) for image in waving[:3]]
    poses = read_poses(
        write_video(tmp_path / "4k.avi", large, 10, "MJPG"), ReadOptions(cache=False)
    )
    assert poses.size == (3840, 2160)
    assert len(poses.times) == 3
    assert (poses.points[:, 0] > 200).all()  # in pixels of that picture


@pytest.mark.nightly
@pytest.mark.parametrize("quality", ["fast", "accurate"])
def test_memory_for_a_minute_of_such_pictures(
    waving: list[Image], tmp_path: Path, quality: str
) -> None:
    scaled = [cv2.resize(image, (1800, 2160)) for image in waving[:12]]
    large = [cv2.copyMakeBorder(i, 0, 0, 1020, 1020, cv2.BORDER_REPLICATE) for i in scaled]
    frames = (large[abs(n // 3 % 22 - 11)] for n in range(MINUTE))
    path = write_video(tmp_path / "4k.mp4", frames, 30)
    look = (
        "import sys; from pathlib import Path;"
        "from actioncli.pose import ReadOptions;"
        "from actioncli.pose.video import read_poses;"
        "options = ReadOptions(cache=False, quality=sys.argv[2]);"
        "poses = read_poses(Path(sys.argv[1]), options);"
        # Not `getrusage`, which also counts the process that started this one.
        "peak = Path('/proc/self/status').read_text().split('VmHWM:')[1].split()[0];"
        "print(len(poses.times), peak)"
    )
    words = [sys.executable, "-c", look, str(path), quality]
    done = subprocess.run(words, capture_output=True, text=True, check=True)
    seen, memory = map(int, done.stdout.split())
    assert seen == MINUTE // 2
    assert memory < 600_000  # kB


def test_an_end_after_the_end_is_the_end(waving_video: Path) -> None:
    clip = read_clip(waving_video, start=1, end=100)
    assert clip.duration == pytest.approx(1.3)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"start": -1.0}, "--start"),
        ({"start": 2.0, "end": 1.0}, "--start"),
        ({"quality": "best"}, "fast or accurate"),
        ({"person": 0}, "counts from 1"),
    ],
)
def test_options_without_sense(tmp_path: Path, options: dict[str, object], message: str) -> None:
    path = write_video(tmp_path / "a.mp4", numbered(3))
    with pytest.raises(UsageError, match=message):
        read_clip(path, **options)
