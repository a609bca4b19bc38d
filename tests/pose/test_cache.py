from __future__ import annotations

import os
import time
from pathlib import Path

import numpy as np
import pytest

from actioncli.pose import cache
from actioncli.pose.poses import Poses
from tests.forking import files_up_to


def poses(frames: int = 5) -> Poses:
    rng = np.random.default_rng(frames)
    return Poses(
        times=np.arange(frames) / 15,
        world=rng.random((frames, 33, 3), np.float32),
        visibility=rng.random((frames, 33), np.float32),
        points=rng.random((frames, 33, 2), np.float32),
        frames=np.arange(frames) / 15,
        size=(640, 480),
        notes=("größer als sonst",),
    )


def test_what_is_kept_comes_back() -> None:
    cache.keep("a", poses())
    back = cache.load("a")
    assert back is not None
    for name in ("times", "world", "visibility", "points", "frames"):
        np.testing.assert_array_equal(getattr(back, name), getattr(poses(), name))
    assert (back.size, back.notes) == (poses().size, poses().notes)
    assert cache.load("b") is None


def test_key_tells_content_and_settings_apart(tmp_path: Path) -> None:
    video = tmp_path / "v"
    video.write_bytes(b"one")
    keys = {cache.cache_key(video, {"rate": 15}), cache.cache_key(video, {"rate": 30})}
    video.write_bytes(b"two")
    keys.add(cache.cache_key(video, {"rate": 15}))
    assert len(keys) == 3


def test_least_recently_used_goes_first(monkeypatch: pytest.MonkeyPatch) -> None:
    cache.keep("a", poses())
    size = next(cache.cache_folder().iterdir()).stat().st_size
    monkeypatch.setattr(cache, "LARGEST", int(2.5 * size))
    for age, key in ((300, "b"), (200, "a")):
        cache.keep(key, poses())
        path = cache.cache_folder() / (key + cache.SUFFIX)
        os.utime(path, (path.stat().st_mtime - age,) * 2)
    assert cache.load("b") is not None  # used now, so "a" is the oldest
    cache.keep("c", poses())
    assert {path.stem for path in cache.cache_folder().iterdir()} == {"b", "c"}


def test_no_place_to_keep_is_no_error(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "file").touch()
    monkeypatch.setenv("ACTIONCLI_HOME", str(tmp_path / "file"))
    cache.keep("a", poses())
    assert cache.load("a") is None


def test_a_full_disk_keeps_nothing_and_is_no_error() -> None:
    with files_up_to(1000):
        cache.keep("a", poses())
    assert list(cache.cache_folder().iterdir()) == []


def test_ctrl_c_leaves_nothing_behind(monkeypatch: pytest.MonkeyPatch) -> None:
    def interrupted(*_: object, **__: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr(cache.np, "savez_compressed", interrupted)
    with pytest.raises(KeyboardInterrupt):
        cache.keep("a", poses())
    assert list(cache.cache_folder().iterdir()) == []


def test_what_a_killed_process_left_is_taken_away() -> None:
    folder = cache.cache_folder()
    folder.mkdir(parents=True)
    for name, age in (("old.part", 7200), ("new.part", 60)):
        (folder / name).touch()
        os.utime(folder / name, (time.time() - age,) * 2)
    cache.keep("a", poses())
    assert {path.name for path in folder.iterdir()} == {"new.part", "a.npz"}


def test_no_pickle_is_read() -> None:
    cache.cache_folder().mkdir(parents=True)
    np.savez(cache.cache_folder() / "a.npz", times=np.array([object()], dtype=object))
    assert cache.load("a") is None
