"""Whatever can be watched, by one notion; and streams that stall, lie, send garbage, come back."""

from __future__ import annotations

import os
import time
from collections.abc import Callable, Iterable
from itertools import cycle, pairwise
from pathlib import Path
from tempfile import NamedTemporaryFile

import cv2
import numpy as np
import pytest

from actioncli.errors import ClipError, UsageError
from actioncli.live.stream import VideoStream
from actioncli.pose import camera, without_password
from actioncli.pose.camera import LiveSource, cameras, open_source, still
from actioncli.pose.frames import Frame, VideoFile
from tests.pose.videos import answering, hosted, number, numbered, part, real_frames, write_video

PICTURES = numbered(40, 192, 128)
GARBAGE = np.random.default_rng(0).integers(0, 255, 3000, np.uint8).tobytes()
# So often a second.
PACE = 0.02


def paced(pictures: Iterable[bytes]) -> list[bytes | float]:
    return [each for picture in pictures for each in (picture, PACE)]


WHOLE = paced(map(part, PICTURES))
FIRST, REST = WHOLE[:40], WHOLE[40:]


@pytest.fixture
def hasty(monkeypatch: pytest.MonkeyPatch) -> None:
    """Seconds that a stream may stall, and for which it may be quiet."""
    monkeypatch.setattr(camera, "PATIENCE", 1.0)
    monkeypatch.setattr(camera, "_SILENT", 0.4)


def seen(source: LiveSource, enough: Callable[[list[int]], bool]) -> tuple[list[int], list[float]]:
    """The numbers of the pictures until they are enough, and when there was none; in order."""
    shown, silent, times = [], [], []
    for frame in source.frames():
        if isinstance(frame, Frame):
            shown.append(number(frame.image))
        else:
            silent.append(frame)
        times.append(frame.time if isinstance(frame, Frame) else frame)
        if enough(shown):
            break
    source.close()
    assert all(before <= after for before, after in pairwise(times))
    return shown, silent


@pytest.mark.usefixtures("hasty")
@pytest.mark.parametrize(
    ("first", "why"),
    [
        (FIRST, "the picture has ended"),
        ([*FIRST, 60.0], "no picture for 1 s"),
        ([*FIRST, *[part(GARBAGE)] * 3, *REST], "the picture has ended"),
        ([*FIRST, *[GARBAGE] * 3, *REST], "the picture has ended"),
        ([*FIRST, part(PICTURES[20], lie=500), *REST], "the picture has ended"),
        ([*FIRST, part(PICTURES[20], lie=-100), *REST], "the picture has ended"),
    ],
    ids=["ends", "stalls", "garbage in parts", "garbage between", "too long", "too short"],
)
def test_a_stream_that_breaks_is_told_and_goes_on(first: list[bytes | float], why: str) -> None:
    told: list[str] = []
    with answering(first, REST, cycle(REST)) as address:
        source = LiveSource(address, 30, told.append)
        shown, silent = seen(source, lambda numbers: bool(numbers) and numbers[-1] == 39)
    assert shown[0] < 20 <= shown[-2]
    assert told == [f"{why}; trying again for 30 s", "the picture is back"]
    assert silent  # what is going on is seen to end


@pytest.mark.usefixtures("hasty")
def test_a_stream_that_lies_about_being_back(monkeypatch: pytest.MonkeyPatch) -> None:
    """A page of a router that starts, nothing, and one picture alone are no stream."""
    monkeypatch.setattr(camera, "OPENING", 1.0)
    told: list[str] = []
    lies: list[list[bytes | float]] = [[b"<html>starting</html>"], [60.0], [WHOLE[0]]]
    with answering(FIRST, *lies, REST, cycle(REST)) as address:
        source = LiveSource(address, 60, told.append)
        begun = time.monotonic()
        shown, _ = seen(source, lambda numbers: bool(numbers) and numbers[-1] == 39)
    assert shown[-2] >= 20
    assert len(told) == 2
    # Pauses grow: half a second, one, two, four.
    assert time.monotonic() - begun > 0.5 + 1 + 2 + 4


@pytest.mark.usefixtures("hasty")
def test_a_stream_that_stays_away_is_an_error() -> None:
    told: list[str] = []
    with answering(FIRST) as address:
        source = LiveSource(address.replace("//", "//me:secret@"), 1.5, told.append)
        frames = source.frames()
        next(frames)
    with pytest.raises(
        ClipError, match=r"127\.0\.0\.1:\d+/: .*, and was not back in 1.5 s"
    ) as error:
        list(frames)
    assert "secret" not in str(error.value)
    assert len(told) == 1
    source.close()


def test_pictures_of_another_size(real_videos: Path) -> None:
    """The person is followed anew; nothing of the smaller picture is taken for the larger one's."""
    images = real_frames(real_videos / "wave_two_hands" / "sudC.avi", 12, every=3)
    small = paced(part(cv2.resize(image, None, fx=0.5, fy=0.5)) for image in images)
    large: list[bytes | float] = [*paced(part(image) for image in images), 60.0]
    with answering(small, large) as address:
        stream = VideoStream(address, "fast", 10, retry=30)
        sizes, clip = [], None
        for _ in stream.times():
            sizes.append(stream.poses.size)
            clip = stream.clip()
            if sizes[-1] != sizes[0] and clip is not None and len(clip) > 1:
                break
        stream.close()
    assert len(set(sizes)) == 2
    assert clip is not None
    assert len(clip) < len(sizes)


@pytest.mark.parametrize("name", ["a.mp4", "a.avi"])
def test_an_address_that_is_a_file_is_played_as_one(tmp_path: Path, name: str) -> None:
    write_video(tmp_path / name, numbered(40), 10, "mp4v" if name.endswith("4") else "MJPG")
    with hosted(tmp_path) as address:
        at_address = open_source(address + name)
        assert isinstance(at_address, VideoFile)
        times = [(number(frame.image), frame.time) for frame in at_address.frames()]
    assert times == [
        (number(frame.image), frame.time) for frame in VideoFile(tmp_path / name).frames()
    ]
    assert len(times) == 40


def test_a_file_at_an_address_that_is_cut_off_is_told(tmp_path: Path) -> None:
    noise = np.random.default_rng(0).integers(0, 255, (20, 64, 64, 3), np.uint8)
    video = write_video(tmp_path / "a.avi", noise, 10, "MJPG")
    video.write_bytes(video.read_bytes()[: video.stat().st_size // 2])
    with hosted(tmp_path) as address:
        source = open_source(address + "a.avi")
        assert isinstance(source, VideoFile)
        list(source.frames())
    assert "the file announces 20 frames and" in (source.shortfall() or "")


@pytest.mark.parametrize(
    ("source", "why"),
    [
        ("nothing.mp4", "cannot read the video: No such file"),
        ("77", "camera 77: cannot be opened"),
        *[(number, "there is none; cameras are numbered from 0") for number in (-1, 100, 10**20)],
        ("http://127.0.0.1:1/", r"cannot be opened\. Is the address right"),
    ],
)
def test_what_is_no_source(source: int | str, why: str) -> None:
    with pytest.raises(ClipError, match=why):
        open_source(source)


def test_what_sends_no_pictures() -> None:
    with pytest.raises(UsageError, match="such an address sends no pictures"):
        open_source("file:///tmp/a.mp4")


@pytest.mark.skipif(not Path("/dev/null").is_char_device(), reason="devices are not files here")
def test_a_character_device_is_a_camera(tmp_path: Path) -> None:
    link = tmp_path / "camera"
    link.symlink_to("/dev/null")
    for device in ("/dev/null", link):
        with pytest.raises(ClipError, match=f"{device}: cannot be opened. `actioncli cameras`"):
            open_source(device)


def test_the_cameras_of_this_machine() -> None:
    assert all(isinstance(number, int) and name for number, name in cameras())


def test_a_still(tmp_path: Path) -> None:
    assert still(write_video(tmp_path / "a.mp4", PICTURES)).shape == (128, 192, 3)
    with answering([*WHOLE, 60.0]) as address:
        assert still(address).shape == (128, 192, 3)
    picture = cv2.imencode(".jpg", PICTURES[0])[1].tobytes()
    with answering([picture], kind="image/jpeg") as address:
        assert still(address).shape == (128, 192, 3)


def test_no_password_is_shown() -> None:
    assert without_password("rtsp://me:a:b@host:5/x@y") == "rtsp://host:5/x@y"
    assert without_password("0") == "0"


def test_a_file_in_memory_is_no_camera() -> None:
    memory = Path("/dev/shm")
    if not os.access(memory, os.W_OK):
        pytest.skip("there is no such folder")
    with NamedTemporaryFile(dir=memory, suffix=".mp4") as file:
        assert not camera.is_device(Path(file.name))
    assert camera.is_device(Path(file.name).with_name("video99"))
