from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from actioncli.clips.clip import Clip
from actioncli.clips.read import read_clip
from actioncli.clips.skeleton import DEFAULT_JOINTS, HAND_JOINTS
from actioncli.clips.write import WRITERS, write_clip
from actioncli.errors import ClipError, UsageError

from .bodies import waving


@pytest.fixture
def clip() -> Clip:
    body = waving(20)
    confidence = np.linspace(0, 1, body.size // 3).reshape(body.shape[:2])
    return Clip(body, DEFAULT_JOINTS, 15.0, confidence, "wave.mp4", ("a note",))


@pytest.mark.parametrize("kind", WRITERS)
def test_reads_back(tmp_path: Path, clip: Clip, kind: str) -> None:
    write_clip(tmp_path / f"wave.{kind}", clip)
    assert [path.name for path in tmp_path.iterdir()] == [f"wave.{kind}"]
    back = read_clip(tmp_path / f"wave.{kind}", up="y")
    assert back.joint_names == clip.joint_names
    assert back.fps == pytest.approx(15, abs=1e-3)
    np.testing.assert_allclose(back.joints, clip.joints, atol=1e-5)
    if kind != "trc":
        assert back.confidence is not None
        np.testing.assert_allclose(back.confidence, clip.confidence, atol=1e-4)
    if kind in ("npz", "json"):  # nothing is left to infer
        assert read_clip(tmp_path / f"wave.{kind}").notes == ()
    if kind == "npz":
        np.testing.assert_array_equal(back.joints, clip.joints)


@pytest.mark.parametrize("kind", WRITERS)
def test_a_hand_that_was_mostly_missing_reads_back(tmp_path: Path, clip: Clip, kind: str) -> None:
    hands = np.random.default_rng(0).normal(size=(20, 42, 3))
    hands[:15, :21] = np.nan
    hands[:, 21:] = np.nan
    names = (*DEFAULT_JOINTS, *HAND_JOINTS)
    seen = Clip(np.concatenate([clip.joints, hands], axis=1), names, 15.0)
    write_clip(tmp_path / f"wave.{kind}", seen)
    back = read_clip(tmp_path / f"wave.{kind}", up="y")
    assert back.joint_names == names[:-21]
    np.testing.assert_allclose(back.joints, seen.joints[:, :-21], atol=1e-5)
    assert any(note.endswith("and 15 more") for note in back.notes)


@given(st.floats(1, 240))
def test_any_frame_rate(tmp_path_factory: pytest.TempPathFactory, fps: float) -> None:
    file = tmp_path_factory.mktemp("rate") / "a.npz"
    write_clip(file, Clip(waving(5), DEFAULT_JOINTS, fps))
    assert read_clip(file).fps == pytest.approx(fps)


def test_format_wins_over_suffix(tmp_path: Path, clip: Clip) -> None:
    write_clip(tmp_path / "wave.dat", clip, format="npz")
    assert (tmp_path / "wave.dat").read_bytes().startswith(b"PK")
    with pytest.raises(UsageError, match=r"npz, json, trc, csv, not as 'dat'"):
        write_clip(tmp_path / "wave.dat", clip)


def test_no_folder(tmp_path: Path, clip: Clip) -> None:
    with pytest.raises(ClipError, match="cannot be written"):
        write_clip(tmp_path / "no" / "wave.npz", clip)


def test_a_file_is_replaced_with_its_usual_mode(tmp_path: Path, clip: Clip) -> None:
    (tmp_path / "wave.npz").write_text("old")
    (tmp_path / "other").touch()
    write_clip(tmp_path / "wave.npz", clip)
    assert (tmp_path / "wave.npz").stat().st_mode == (tmp_path / "other").stat().st_mode
    assert len(read_clip(tmp_path / "wave.npz")) == 20
