from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from actioncli.errors import ClipError
from actioncli.pose.frames import Frame
from actioncli.pose.stream import LiveSource, PoseStream, file_frames

from .videos import numbered, real_frames, write_video


def test_a_live_source_gives_the_newest_and_drops_the_rest(tmp_path: Path) -> None:
    path = write_video(tmp_path / "a.mp4", numbered(40))
    source = LiveSource(str(path))
    taken = 0
    for _ in source.frames():
        taken += 1
    source.close()
    assert taken >= 1
    assert taken + source.dropped == 40


def test_no_camera() -> None:
    with pytest.raises(ClipError, match="camera 99: cannot be opened"):
        LiveSource(99)


def test_a_file_is_the_same_every_time(tmp_path: Path) -> None:
    path = write_video(tmp_path / "a.mp4", numbered(40), 30)
    first, second = ([frame.time for frame in file_frames(path)] for _ in range(2))
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
