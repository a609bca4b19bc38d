"""An example as bytes."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from storing import make_clip, same

from actioncli.clips.clip import Clip
from actioncli.errors import ClipError, UsageError
from actioncli.store import record
from actioncli.store.record import Record


@given(
    arrays(
        np.float32,
        st.tuples(st.integers(2, 5), st.integers(1, 4), st.just(3)),
        elements=st.floats(-100, 100, width=32),
    ),
    st.floats(0.1, 1000),
)
def test_what_goes_in_comes_out(joints: np.ndarray, fps: float) -> None:
    joints[0, 0, 0], joints[1, 0, 0] = 0, 1
    clip = Clip(joints, [f"j{place}" for place in range(joints.shape[1])], fps)
    kept = Record.from_clip("wave", clip)
    assert kept.intact()
    assert same(kept.clip(), clip)
    assert Record.from_row(kept.row()) == kept


def test_bytes_are_little_endian_float32() -> None:
    clip = Clip([[[1, 2, 3]], [[4, 5, 6]]], ["head"], 30, [[0.5], [1]])
    kept = Record.from_clip("wave", clip)
    assert kept.joints == np.array([1, 2, 3, 4, 5, 6], "<f4").tobytes()
    assert kept.confidence == np.array([0.5, 1], "<f4").tobytes()


def test_the_checksum_covers_the_content_and_nothing_else() -> None:
    clip = make_clip(0, confidence=True)
    first = Record.from_clip("wave", clip, "note")
    other_file = Clip(clip.joints, clip.joint_names, clip.fps, clip.confidence, "/x/other.npy")
    assert Record.from_clip("clap", other_file, "", negative=True).checksum == first.checksum
    names = ["head", *clip.joint_names[1:]]
    for different in (
        make_clip(0),
        make_clip(1, confidence=True),
        Clip(clip.joints, names, clip.fps, clip.confidence),
        Clip(clip.joints, clip.joint_names, 26, clip.confidence),
    ):
        assert Record.from_clip("wave", different).checksum != first.checksum


def test_damage_is_seen() -> None:
    kept = Record.from_clip("wave", make_clip(0, confidence=True))
    assert kept.confidence
    for damaged in (
        replace(kept, joints=b"\0" + kept.joints[1:]),
        replace(kept, joints=kept.joints[:-12]),
        replace(kept, confidence=None),
        replace(kept, confidence=kept.confidence[:-1] + b"\0"),
        replace(kept, fps=26.0),
        replace(kept, frames=5),
        replace(kept, joint_names=("a", "b", "c", "d")),
    ):
        assert not damaged.intact()


def test_what_no_one_could_export_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    with pytest.raises(UsageError):
        Record.from_clip("a\nb", make_clip(0))
    joints = make_clip(0, joints=1).joints
    for name in ("", "a\nb", "\x1b[2J", "x" * 101):
        with pytest.raises(ClipError, match="joint name"):
            Record.from_clip("wave", Clip(joints, [name]))
    with pytest.raises(ClipError, match="too much"):
        Record.from_clip("wave", make_clip(0, 2, 1001))
    monkeypatch.setattr(record, "LARGEST_CLIP_BYTES", 60 * 25 * 12 - 1)
    with pytest.raises(ClipError, match=r"^long\.npy: 60 frames of 25 joints are too much"):
        Record.from_clip("wave", make_clip(0, 60, 25, source="/x/long.npy"))
