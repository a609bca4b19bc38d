"""Folders that others may write: links that they lay are not followed, and what holds somebody's
movements is private."""

import os
import stat
from pathlib import Path

import numpy as np
import pytest
from clips.bodies import waving

from actioncli import Clip
from actioncli.clips.skeleton import DEFAULT_JOINTS
from actioncli.clips.write import write_clip
from actioncli.errors import UsageError
from actioncli.live.events import Event
from actioncli.live.recorder import Recorder, kept_clips
from actioncli.model.config import ModelConfig
from actioncli.model.weights import write_weights
from actioncli.pose import cache
from actioncli.pose.poses import Poses
from actioncli.recognition.threshold import Threshold
from actioncli.report.calibration import FIGURES, PAGE, write_folder
from tests.pose.test_cache import poses

CLIP = Clip(waving(12), DEFAULT_JOINTS, 4.0)


@pytest.fixture
def precious(tmp_path: Path) -> Path:
    """A folder with a file that nobody may change."""
    folder = tmp_path / "precious"
    folder.mkdir(mode=0o755)
    (folder / "thesis.npz").write_text("mine")
    return folder


@pytest.fixture
def shared(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder in which others have laid what they like."""
    folder = tmp_path / "shared"
    folder.mkdir()
    monkeypatch.setenv("ACTIONCLI_HOME", str(folder))
    return folder


def test_a_linked_cache_is_not_used(shared: Path, precious: Path) -> None:
    (shared / "poses").symlink_to(precious)
    cache.keep("key", poses())
    assert [path.name for path in precious.iterdir()] == ["thesis.npz"]
    assert stat.S_IMODE(precious.stat().st_mode) == 0o755
    np.savez(precious / "key.npz", times=np.zeros(3))
    assert cache.load("key") is None


@pytest.mark.skipif(os.geteuid() != 0, reason="only root can give it away")
def test_a_cache_of_somebody_else_is_not_believed(shared: Path) -> None:
    cache.keep("key", poses())
    assert cache.load("key") is not None
    os.chown(shared / "poses", 65534, 65534)
    assert cache.load("key") is None


@pytest.mark.parametrize("damage", ["flipped", "cut", "other"])
def test_a_damaged_cache_is_no_cache(shared: Path, damage: str) -> None:
    cache.keep("key", poses())
    file = shared / "poses" / "key.npz"
    content = file.read_bytes()
    rng = np.random.default_rng(0)
    for _ in range(60):
        changed = bytearray(content)
        if damage == "flipped":
            for at in rng.integers(len(changed), size=3):
                changed[at] ^= 1 << int(rng.integers(8))
        elif damage == "cut":
            changed = changed[: rng.integers(len(changed))]
        else:
            changed = bytearray(rng.bytes(200))
        file.write_bytes(changed)
        found = cache.load("key")
        assert found is None or isinstance(found, Poses)


def test_the_cache_is_private_whatever_the_umask(shared: Path) -> None:
    old = os.umask(0)
    try:
        cache.keep("key", poses())
    finally:
        os.umask(old)
    assert stat.S_IMODE((shared / "poses").stat().st_mode) == 0o700
    assert stat.S_IMODE((shared / "poses" / "key.npz").stat().st_mode) == 0o600


def test_recordings_are_private_and_do_not_follow_links(shared: Path, precious: Path) -> None:
    old = os.umask(0)
    try:
        recorder = Recorder(shared / "seen", Threshold(0.5, "", {}), "camera 0")
        for name in ("0001_x.npz", "0001_x.json"):
            (shared / "seen" / name).symlink_to(precious / "thesis.npz")
        recorder.update(CLIP, 3.0, (), [Event("../../x\x1b[2J", 0.5, 2.5, 0.9)], busy=False)
        recorder._keep(Event("x", 0.5, 2.5, 0.9), (CLIP, 3.0), 2.5)
    finally:
        os.umask(old)
    assert stat.S_IMODE((shared / "seen").stat().st_mode) == 0o700
    kept = [path for path in (shared / "seen").iterdir() if not path.is_symlink()]
    assert len(kept) == 4
    for path in kept:
        assert stat.S_IMODE(path.stat().st_mode) == 0o600
        assert path.name.isprintable()
        assert ".." not in path.name
    assert (precious / "thesis.npz").read_text() == "mine"


def test_links_under_the_names_of_outputs_are_replaced(shared: Path, precious: Path) -> None:
    target = precious / "thesis.npz"
    names = ["a.npz", "w.safetensors", "w.safetensors.part", FIGURES, PAGE, "rows.csv"]
    for name in names:
        (shared / name).symlink_to(target)
    write_clip(shared / "a.npz", CLIP)
    write_weights(shared / "w.safetensors", ModelConfig(), {}, {})
    write_folder(shared, "<p>page</p>", {}, {"rows": [{"a": 1}]})
    assert target.read_text() == "mine"
    for name in set(names) - {"w.safetensors.part"}:
        assert not (shared / name).is_symlink()
    assert not list(shared.glob(".actioncli-*"))


def test_a_description_that_is_a_bomb_is_damage(shared: Path) -> None:
    (shared / "0001_a.npz").write_bytes(b"x")
    for content in ("[" * 100_000, '{"label": "%s"}' % ("a" * 10**7), "[1e999]"):
        (shared / "0001_a.json").write_text(content)
        with pytest.raises(UsageError, match="damaged"):
            kept_clips(shared)
