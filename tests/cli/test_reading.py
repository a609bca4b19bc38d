"""How many clips are read at the same time, and what comes of each."""

from pathlib import Path

import numpy as np
import pytest

from actioncli import Clip, ClipError
from actioncli.cli import reading
from actioncli.cli.reading import read_each, sharing
from actioncli.pose import ReadOptions

CLIP = Clip(np.arange(18).reshape(2, 3, 3), ["a", "b", "c"])


def paths(videos: int, others: int = 0) -> list[Path]:
    return [Path(f"{n}.mp4") for n in range(videos)] + [Path(f"{n}.npz") for n in range(others)]


@pytest.mark.parametrize(
    ("cores", "videos", "processes"),
    [(1, 5, 1), (2, 1, 1), (2, 2, 2), (4, 3, 1), (4, 40, 4), (32, 7, 1), (32, 8, 8), (32, 99, 8)],
)
def test_videos_are_shared_where_there_are_enough(
    monkeypatch: pytest.MonkeyPatch, cores: int, videos: int, processes: int
) -> None:
    monkeypatch.setattr(reading, "cores", lambda: cores)
    assert sharing(paths(videos), ReadOptions()) == processes
    assert sharing(paths(videos, others=100), ReadOptions()) == processes
    # Its threads would be lost in another process.
    assert sharing(paths(videos), ReadOptions(metrabs=Path("model"))) == 1
    assert sharing(paths(0, others=100), ReadOptions()) == 1


def test_each_clip_comes_with_what_was_read_or_what_is_wrong_once_it_is_wanted(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(reading, "cores", lambda: 1)
    asked = []

    def read(path: Path, options: ReadOptions, shown: bool) -> Clip:
        asked.append(path.stem)
        if path.stem == "1":
            raise ClipError(f"{path}: broken")
        assert shown
        return CLIP

    clips = read_each(paths(3), ReadOptions(), shown=True, read=read)
    assert (next(clips), asked) == ((Path("0.mp4"), CLIP), ["0"])
    broken, last = clips
    assert (str(broken[0]), str(broken[1])) == ("1.mp4", "1.mp4: broken")
    assert last == (Path("2.mp4"), CLIP)
