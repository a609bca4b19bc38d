from __future__ import annotations

import time
from collections.abc import Iterator
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest

from actioncli.errors import ClipError
from actioncli.live.stream import PoseStream, file_frames
from actioncli.pose import camera as streams
from actioncli.pose.camera import LiveSource
from actioncli.pose.frames import Frame, VideoFile
from tests.pose.videos import number, numbered, real_frames, streamed, write_video


def until_lost(source: LiveSource) -> Iterator[Frame | float]:
    """Its frames; that it ends is an error."""
    with pytest.raises(ClipError, match="the picture has ended"):
        yield from source.frames()


def test_a_live_source_gives_the_newest_and_drops_the_rest(tmp_path: Path) -> None:
    path = write_video(tmp_path / "a.mp4", numbered(40))
    source = LiveSource(str(path))
    taken = [frame for frame in until_lost(source) if isinstance(frame, Frame)]
    source.close()
    assert len(taken) >= 1
    assert len(taken) + source.dropped == 40


def test_late_frames_of_a_camera_are_dropped_and_never_queued() -> None:
    """Frames come 60 a second and are taken 20 a second: each taken one is the newest."""
    with streamed(numbered(60, 192, 128), fps=60) as address:
        source = LiveSource(address)
        taken = []
        for frame in until_lost(source):
            assert isinstance(frame, Frame)
            taken.append((number(frame.image), frame.time))
            time.sleep(0.05)
        source.close()
    shown = [n for n, _ in taken]
    assert shown == sorted(set(shown))
    assert shown[-1] == 59
    assert len(shown) + source.dropped == 60
    assert source.dropped > 5
    assert all(before < after for (_, before), (_, after) in pairwise(taken))


def test_a_stream_that_stalls_is_told(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(streams, "PATIENCE", 1.5)
    with streamed(numbered(20), fps=60, stall=30) as address:
        source = LiveSource(address)
        with pytest.raises(ClipError, match=r"http://127.0.0.1:\d+/: no picture for 1.5 s"):
            list(source.frames())
        assert source.silent
        begun = time.monotonic()
        source.close()
        assert time.monotonic() - begun < 5  # though nothing more comes


def test_a_file_is_the_same_every_time(tmp_path: Path) -> None:
    path = write_video(tmp_path / "a.mp4", numbered(40), 30)
    first, second = ([frame.time for frame in file_frames(VideoFile(path))] for _ in range(2))
    assert first == second
    assert len(first) == 20


def test_poses_of_the_last_seconds(real_videos: Path) -> None:
    images = real_frames(real_videos / "wave_two_hands" / "sudC.avi", 20, every=3)
    stream = PoseStream("fast", seconds=1.0)
    assert stream.clip() is None
    for n, image in enumerate(images):
        stream.add(Frame(n / 10, image))
    clip = stream.clip()
    assert clip is not None
    assert len(clip) == 11
    assert clip.fps == pytest.approx(10)
    assert stream.body is not None
    stream.add(Frame(2.0, np.zeros_like(images[0])))
    assert stream.body is None
    assert stream.clip() is None
    for n, image in enumerate(images[:3]):
        stream.add(Frame(2.7 + n / 10, image))
    after = stream.clip()
    assert after is not None
    assert len(after) == 3  # nothing from before the break
