from pathlib import Path

import cv2
import numpy as np
import pytest

from actioncli.errors import ClipError
from actioncli.pose.frames import VideoFile

from .videos import number, numbered, rotate_in_header, slow_down_second_half, write_video


def numbers(video: VideoFile, **options: float) -> list[int]:
    """Which frames of `numbered` come out."""
    return [number(frame.image) for frame in video.frames(**options)]


@pytest.mark.parametrize(
    ("name", "fourcc"),
    [
        ("a.mp4", "mp4v"),
        ("a.avi", "MJPG"),
        ("a.webm", "VP80"),
        ("b.webm", "VP90"),
        ("a.mkv", "MJPG"),
    ],
)
def test_every_frame_at_its_time(tmp_path: Path, name: str, fourcc: str) -> None:
    video = VideoFile(write_video(tmp_path / name, numbered(30), 25, fourcc))
    frames = list(video.frames())
    np.testing.assert_allclose([frame.time for frame in frames], np.arange(30) / 25, atol=2e-3)
    assert frames[0].image.shape == (64, 96, 3)
    assert numbers(VideoFile(video.path)) == list(range(30))
    assert video.shortfall() is None


def test_gif(tmp_path: Path) -> None:
    animation = cv2.Animation()
    animation.frames, animation.durations = numbered(10), [50] * 10
    try:
        assert cv2.imwriteanimation(str(tmp_path / "a.gif"), animation)
    except cv2.error:
        pytest.skip("this OpenCV reads GIF but cannot write it")
    video = VideoFile(tmp_path / "a.gif")
    times = [frame.time for frame in video.frames()]
    np.testing.assert_allclose(times, np.arange(10) / 20, atol=2e-3)


def test_a_part_of_it(tmp_path: Path) -> None:
    path = write_video(tmp_path / "a.mp4", numbered(30), 25)
    assert numbers(VideoFile(path), start=0.4, end=0.6) == [10, 11, 12, 13, 14, 15]
    assert numbers(VideoFile(path), rate=12.5) == list(range(0, 30, 2))
    assert len(numbers(VideoFile(path), rate=15)) == 18
    assert numbers(VideoFile(path), rate=100) == list(range(30))


def test_reading_can_stop_early_and_opencv_has_its_threads_back(tmp_path: Path) -> None:
    video = VideoFile(write_video(tmp_path / "a.mp4", numbered(30), 25))
    before = cv2.getNumThreads()
    cv2.setNumThreads(2)
    try:
        frames = video.frames()
        next(frames)
        assert cv2.getNumThreads() == 1
        frames.close()  # ends the decoding thread, or the test would hang
        assert cv2.getNumThreads() == 2
    finally:
        cv2.setNumThreads(before)


def test_rotation_of_phones(tmp_path: Path) -> None:
    path = write_video(tmp_path / "a.mp4", numbered(5))
    rotate_in_header(path)
    image = next(VideoFile(path).frames()).image
    assert image.shape == (96, 64, 3)
    assert image[:, -10:].mean() > 200  # what was up is now on the right
    assert image[:, :10].mean() < 100


def test_variable_frame_rate(tmp_path: Path) -> None:
    path = write_video(tmp_path / "a.mp4", numbered(20), 25)
    slow_down_second_half(path, 3)
    video = VideoFile(path)
    steps = np.diff([frame.time for frame in video.frames()])
    np.testing.assert_allclose(steps, [0.04] * 10 + [0.12] * 9, atol=2e-3)
    assert video.shortfall() is None
    video.announced = 40  # as a browser's recording has it: a guess from the shortest step
    assert video.shortfall() is None


@pytest.mark.parametrize(
    ("name", "fourcc"), [("a.avi", "MJPG"), ("a.webm", "VP80"), ("a.mkv", "MJPG")]
)
def test_cut_off_file_is_told(tmp_path: Path, name: str, fourcc: str) -> None:
    path = write_video(tmp_path / name, numbered(40), 25, fourcc)
    path.write_bytes(path.read_bytes()[: path.stat().st_size // 2])
    video = VideoFile(path)
    decoded = len(list(video.frames()))
    told = video.shortfall()
    assert told is not None
    assert "40 frames" in told
    assert f"{decoded} could" in told
    reading = video.frames(end=0.1)
    assert video.shortfall() is None or list(reading) == []


@pytest.mark.parametrize(
    ("content", "message"), [(None, "No such file"), (b"", "empty"), (b"no video", "not a video")]
)
def test_what_is_no_video(tmp_path: Path, content: bytes | None, message: str) -> None:
    path = tmp_path / "a.mp4"
    if content is not None:
        path.write_bytes(content)
    with pytest.raises(ClipError, match=message) as told:
        VideoFile(path)
    assert "a.mp4" in str(told.value)


def test_a_browsers_recording_does_not_tell_its_length(tmp_path: Path) -> None:
    path = write_video(tmp_path / "recorded.webm", numbered(30), fourcc="VP80")
    data = bytearray(path.read_bytes())
    at = data.index(b"\x44\x89\x88")  # the length, which a browser does not know when it begins
    data[at : at + 11] = b"\xec\x89" + bytes(9)  # nothing, of the same size
    path.write_bytes(data)
    video = VideoFile(path)
    assert video.duration == video.announced == 0
    assert [number(frame.image) for frame in video.frames()] == list(range(30))
    assert video.shortfall() is None
