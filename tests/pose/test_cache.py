import os
import time
from pathlib import Path

import numpy as np
import pytest

from actioncli.pose import cache
from actioncli.pose.poses import Poses
from tests.forking import files_up_to

KEY = {letter: 64 * letter for letter in "abc"}


def kept() -> set[str]:
    """Names of what is in the cache, but for its mark."""
    return {path.name for path in cache.cache_folder().iterdir()} - {".actioncli-poses"}


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
    cache.keep(KEY["a"], poses())
    back = cache.load(KEY["a"])
    assert back is not None
    for name in ("times", "world", "visibility", "points", "frames"):
        np.testing.assert_array_equal(getattr(back, name), getattr(poses(), name))
    assert (back.size, back.notes) == (poses().size, poses().notes)
    assert cache.load(KEY["b"]) is None


def test_key_tells_content_and_settings_apart(tmp_path: Path) -> None:
    video = tmp_path / "v"
    video.write_bytes(b"one")
    keys = {cache.cache_key(video, {"rate": 15}), cache.cache_key(video, {"rate": 30})}
    video.write_bytes(b"two")
    keys.add(cache.cache_key(video, {"rate": 15}))
    assert len(keys) == 3


def test_least_recently_used_goes_first(monkeypatch: pytest.MonkeyPatch) -> None:
    cache.keep(KEY["a"], poses())
    size = next(cache.cache_folder().glob("*.npz")).stat().st_size
    monkeypatch.setattr(cache, "LARGEST", int(2.5 * size))
    for age, key in ((300, "b"), (200, "a")):
        cache.keep(KEY[key], poses())
        path = cache.cache_folder() / (KEY[key] + cache.SUFFIX)
        os.utime(path, (path.stat().st_mtime - age,) * 2)
    assert cache.load(KEY["b"]) is not None  # used now, so "a" is the oldest
    cache.keep(KEY["c"], poses())
    assert kept() == {KEY["b"] + ".npz", KEY["c"] + ".npz"}


def test_no_place_to_keep_is_no_error(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "file").touch()
    monkeypatch.setenv("ACTIONCLI_HOME", str(tmp_path / "file"))
    cache.keep(KEY["a"], poses())
    assert cache.load(KEY["a"]) is None


def test_a_full_disk_keeps_nothing_and_is_no_error() -> None:
    with files_up_to(1000):
        cache.keep(KEY["a"], poses())
    assert kept() == set()


def test_ctrl_c_leaves_nothing_behind(monkeypatch: pytest.MonkeyPatch) -> None:
    def interrupted(*_: object, **__: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr(cache.np, "savez_compressed", interrupted)
    with pytest.raises(KeyboardInterrupt):
        cache.keep(KEY["a"], poses())
    assert kept() == set()


def test_what_a_killed_process_left_is_taken_away() -> None:
    folder = cache.cache_folder()
    folder.mkdir(parents=True)
    old, new = "tmp12345678.part", "tmpabcdefgh.part"
    for name, age in ((old, 7200), (new, 60)):
        (folder / name).touch()
        os.utime(folder / name, (time.time() - age,) * 2)
    cache.keep(KEY["a"], poses())
    assert kept() == {new, KEY["a"] + ".npz"}


def test_no_pickle_is_read() -> None:
    cache.cache_folder().mkdir(parents=True)
    np.savez(cache.cache_folder() / (KEY["a"] + ".npz"), times=np.array([object()], dtype=object))
    assert cache.load(KEY["a"]) is None


def test_a_folder_of_the_users_is_left_alone(monkeypatch: pytest.MonkeyPatch) -> None:
    """Of the same name, with poses of another program for example."""
    monkeypatch.setattr(cache, "LARGEST", 10)
    folder = cache.cache_folder()
    folder.mkdir(parents=True, mode=0o755)
    folder.chmod(0o755)
    for name in ("holiday.npz", "old.part", 64 * "f" + ".npz"):
        (folder / name).write_bytes(b"mine" * 100)
        os.utime(folder / name, (1, 1))
    cache.keep(KEY["a"], poses())
    assert kept() == {"holiday.npz", "old.part", 64 * "f" + ".npz"}
    (folder / ".actioncli-poses").touch()  # what only looks like the mark
    cache.keep(KEY["a"], poses())
    assert len(kept()) == 3
    assert folder.stat().st_mode & 0o777 == 0o755


def test_in_its_own_folder_the_cache_deletes_only_what_it_made(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    cache.keep(KEY["a"], poses())
    mine = cache.cache_folder() / "holiday.npz"
    mine.write_bytes(b"mine" * 100)
    monkeypatch.setattr(cache, "LARGEST", 10)
    cache.keep(KEY["b"], poses())
    assert kept() == {"holiday.npz"}


def test_a_cache_of_an_earlier_release_is_adopted() -> None:
    folder = cache.cache_folder()
    cache.keep(KEY["a"], poses())
    (folder / ".actioncli-poses").unlink()
    cache.keep(KEY["b"], poses())
    assert (folder / ".actioncli-poses").is_file()
    assert cache.load(KEY["a"]) is not None


def test_an_empty_folder_keeps_its_mode() -> None:
    folder = cache.cache_folder()
    folder.mkdir(parents=True)
    folder.chmod(0o755)
    cache.keep(KEY["a"], poses())
    assert folder.stat().st_mode & 0o777 == 0o755
    assert (folder / f"{KEY['a']}.npz").stat().st_mode & 0o777 == 0o600
