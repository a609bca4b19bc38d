from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from actioncli.clips import gaps
from actioncli.clips.gaps import fill_gaps
from actioncli.clips.skeleton import DEFAULT_JOINTS, LAYOUTS
from actioncli.errors import ClipError

from .bodies import CENTRE, waving

WRIST = DEFAULT_JOINTS.index("rwri")


def body(frames: int = 40) -> np.ndarray:
    return waving(frames).astype(np.float32)


def fill(positions: np.ndarray, fps: float = 30, **options: Any) -> Any:
    return fill_gaps(positions, DEFAULT_JOINTS, fps, "clip", **options)


@pytest.mark.parametrize("gap", [np.nan, 0.0, np.inf])
def test_a_short_gap_becomes_a_straight_line(gap: float) -> None:
    holed = body()
    holed[10:13, WRIST] = gap
    filled, names, _, notes = fill(holed)
    expected = np.linspace(holed[9, WRIST], holed[13, WRIST], 5)[1:-1]
    np.testing.assert_allclose(filled[10:13, WRIST], expected, atol=1e-6)
    np.testing.assert_array_equal(
        np.delete(filled, range(10, 13), 0), np.delete(holed, range(10, 13), 0)
    )
    assert names == DEFAULT_JOINTS
    assert notes == ("gaps filled: 0.5% of the joint positions",)


def test_a_coordinate_of_zero_is_no_gap() -> None:
    planar = body()
    planar[:, :, 2] = 0
    filled, *_, notes = fill(planar)
    assert filled is planar
    assert notes == ()


def test_ends_are_held_and_empty_frames_dropped() -> None:
    holed = body()
    holed[:3, WRIST] = np.nan
    holed[35:] = 0
    filled, *_, notes = fill(holed)
    assert len(filled) == 35
    np.testing.assert_array_equal(filled[:3, WRIST], np.repeat(holed[3:4, WRIST], 3, axis=0))
    assert notes[0] == "5 empty frames at the ends dropped"


def test_confidence_is_zero_where_a_gap_was_filled() -> None:
    holed = body()
    holed[5, WRIST] = np.nan
    _, _, confidence, _ = fill(holed, confidence=np.full((40, 15), 0.5, np.float32))
    assert confidence is not None
    assert confidence[5, WRIST] == 0
    assert (np.delete(confidence, 5, 0) == 0.5).all()


ARMS = [DEFAULT_JOINTS.index(f"{side}{joint}") for side in "lr" for joint in ("elb", "wri")]
LEGS = [DEFAULT_JOINTS.index(f"{side}{joint}") for side in "lr" for joint in ("kne", "ank")]
TRUNK = [DEFAULT_JOINTS.index(f"{side}{joint}") for side in "lr" for joint in ("hip", "sho")]


@pytest.mark.parametrize(
    ("frames", "joints", "message"),
    [
        (np.arange(40) % 5 > 1, slice(None), r"clip: too little was seen .* 40 frames 60%"),
        (slice(None), slice(None), "100%"),
        (slice(30), ARMS + LEGS, "lkne in 75%, .* rwri in 75%"),
        (slice(30), TRUNK, "lhip in 75%"),
    ],
)
def test_too_little_is_refused_with_figures(frames: Any, joints: Any, message: str) -> None:
    holed = body()
    holed[frames, joints] = 0
    with pytest.raises(ClipError, match=message):
        fill(holed)


def test_what_was_not_seen_for_long_is_missing() -> None:
    holed = body()
    holed[:14, WRIST] = np.nan  # longer than 0.4 s
    holed[20:25, WRIST] = np.nan
    holed[:, LEGS] = np.nan
    positions, names, confidence, notes = fill(holed)
    assert names == DEFAULT_JOINTS
    assert np.isnan(positions[:14, WRIST]).all()
    assert np.isnan(positions[:, LEGS]).all()
    assert np.isfinite(positions[14:, WRIST]).all()
    assert confidence is not None
    assert not confidence[:, LEGS].any()
    np.testing.assert_array_equal(confidence[:, WRIST] == 0, np.isnan(holed[:, WRIST, 0]))
    assert notes[1] == (
        "not seen: lkne in 100%, rkne in 100%, lank in 100%, rank in 100%, rwri in 35% of the "
        "frames"
    )


@pytest.mark.parametrize("gap", [np.nan, 0.0])
def test_a_needed_joint_that_is_never_seen_is_missing_however_short_the_clip(gap: float) -> None:
    holed = body(10)
    holed[:, WRIST] = gap
    positions, _, confidence, notes = fill(holed)
    assert np.isnan(positions[:, WRIST]).all()
    assert confidence is not None
    assert not confidence[:, WRIST].any()
    assert notes == ("not seen: rwri in 100% of the frames",)


def test_a_joint_that_no_model_needs_is_dropped() -> None:
    names = LAYOUTS["smpl_24"]
    holed = waving(joints=names).astype(np.float32)
    holed[:, names.index("ltoe")] = np.nan
    filled, kept, _, notes = fill_gaps(holed, names, 30, "clip")
    assert set(names) - set(kept) == {"ltoe"}
    assert filled.shape == (40, 23, 3)
    assert notes == ("joints mostly missing, dropped: ltoe",)


def test_the_pelvis_of_a_centred_clip_stays() -> None:
    centred = body() - CENTRE.astype(np.float32)
    centred -= centred[:, :1]
    filled, names, _, notes = fill(centred)
    np.testing.assert_array_equal(filled, centred)
    assert (names, notes) == (DEFAULT_JOINTS, ())


def test_a_long_absence_is_refused() -> None:
    holed = body(120)
    holed[40:72] = np.nan
    with pytest.raises(ClipError, match=r"out of sight for 32 frames \(1.1 s\) after frame 40"):
        fill(holed)
    fill(holed, fps=60)


def test_zeros_may_be_positions() -> None:
    holed = body()
    holed[3, WRIST] = 0
    filled, *_ = fill(holed, zeros_are_gaps=False)
    assert (filled[3, WRIST] == 0).all()


@given(
    arrays(np.float32, (6, 15, 3), elements=st.floats(width=32, allow_infinity=True)),
    st.lists(st.tuples(st.integers(0, 5), st.integers(0, 14)), max_size=40),
)
def test_what_comes_out_is_finite_or_nan(
    positions: np.ndarray, holes: list[tuple[int, int]]
) -> None:
    for frame, joint in holes:
        positions[frame, joint] = 0
    try:
        filled, names, _, _ = fill(positions)
    except ClipError:
        return
    assert not np.isinf(filled).any()
    assert np.isfinite(gaps.filled(filled)).all()
    assert filled.shape[1:] == (len(names), 3)
