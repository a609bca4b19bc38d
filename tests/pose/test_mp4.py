from pathlib import Path

import numpy as np
import pytest

from actioncli.pose.frames import VideoFile
from actioncli.pose.mp4 import _is_whole, mp4_writer
from tests.forking import files_up_to

NOISE = np.random.default_rng(0).integers(0, 255, (40, 64, 96, 3), np.uint8)


def write_noise(path: Path, codec: str = "mp4v") -> None:
    with mp4_writer(path, 12.5, (codec,)) as write:
        for image in NOISE:
            write(image)


@pytest.mark.parametrize("codec", ["vp09", "mp4v"])
def test_every_frame_is_there(tmp_path: Path, codec: str) -> None:
    write_noise(tmp_path / "a.mp4", codec)
    video = VideoFile(tmp_path / "a.mp4")
    assert video.fps == 12.5
    assert len(list(video.frames())) == len(NOISE)


def test_the_first_codec_that_is_known(tmp_path: Path) -> None:
    with mp4_writer(tmp_path / "a.mp4", 10, ("none", "mp4v")) as write:
        write(NOISE[0])
    with (
        pytest.raises(OSError, match="writes no MP4"),
        mp4_writer(tmp_path / "b.mp4", 10, ("none",)) as write,
    ):
        write(NOISE[0])


@pytest.mark.parametrize("most", [1000, 50_000])
def test_a_full_disk_is_told(tmp_path: Path, most: int, capfd: pytest.CaptureFixture[str]) -> None:
    with files_up_to(most), pytest.raises(OSError, match="incomplete"):
        write_noise(tmp_path / "a.mp4")
    assert capfd.readouterr() == ("", "")


def test_whole_is_whole_to_the_last_byte(tmp_path: Path) -> None:
    file = tmp_path / "a.mp4"
    with mp4_writer(file, 10, ("mp4v",)) as write:
        write(NOISE[0])
    content = file.read_bytes()
    for size in range(0, len(content), 7):
        file.write_bytes(content[:size])
        assert not _is_whole(file)
    file.write_bytes(content + bytes(7))
    assert not _is_whole(file)
    # As of more than 4 GB: the size stands behind the kind.
    at = content.index(b"mdat") - 4
    size = int.from_bytes(content[at : at + 4], "big")
    large = b"\0\0\0\1mdat" + (size + 8).to_bytes(8, "big")
    file.write_bytes(content[:at] + large + content[at + 8 :])
    assert _is_whole(file)
