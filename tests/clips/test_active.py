from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from actioncli.clips.active import (
    _autocorrelation,
    action_in,
    active_part,
    one_repetition,
    repetition,
    repetition_notes,
)
from actioncli.clips.clip import Clip
from actioncli.clips.edit import cut
from actioncli.clips.read import read_clip
from actioncli.clips.skeleton import DEFAULT_JOINTS


def clip_of(moving: np.ndarray, fps: float = 20.0, seen: np.ndarray | None = None) -> Clip:
    """Someone whose wrists circle where `moving` (T,) is set."""
    rng = np.random.default_rng(0)
    body = {name: np.zeros(3) for name in DEFAULT_JOINTS}
    for name, side in (("l", -0.2), ("r", 0.2)):
        for n, joint in enumerate(("ank", "kne", "hip", "elb", "wri", "sho")):
            body[name + joint] = np.array([side, n * 0.3, 0])
    body["head"] = np.array([0, 2.0, 0])
    joints = np.stack([body[name] for name in DEFAULT_JOINTS])
    frames = np.tile(joints, (len(moving), 1, 1)) + rng.normal(0, 0.002, (len(moving), 15, 3))
    angle = np.cumsum(moving) * 0.4
    for name in ("lwri", "rwri", "lelb", "relb"):
        at = DEFAULT_JOINTS.index(name)
        frames[:, at, 0] += 0.5 * np.cos(angle)
        frames[:, at, 1] += 0.5 * np.sin(angle)
    confidence = None if seen is None else np.repeat(seen[:, None], 15, axis=1)
    return Clip(frames, DEFAULT_JOINTS, fps, confidence)


def pattern(*parts: tuple[float, int]) -> np.ndarray:
    """(T,) at 20 frames a second from (seconds, moving) parts."""
    return np.concatenate([np.full(int(seconds * 20), on) for seconds, on in parts])


@pytest.mark.parametrize(
    ("parts", "expected"),
    [
        ([(2, 0), (3, 1), (2, 0)], (2, 5)),  # rest before and after is left out
        ([(1, 0), (2, 1), (1, 0), (2, 1), (1, 0)], (1, 6)),  # a short rest inside belongs
        ([(1, 1), (4, 0), (3, 1), (1, 0)], (5, 8)),  # the longer of two performances
    ],
)
def test_the_active_part(parts: list[tuple[float, int]], expected: tuple[float, float]) -> None:
    assert active_part(clip_of(pattern(*parts))) == pytest.approx(expected, abs=0.35)


def test_motion_throughout_and_none_at_all_are_whole() -> None:
    for moving in (1, 0):
        clip = clip_of(pattern((4, moving)))
        assert active_part(clip) == (0, clip.duration)


def test_nothing_goes_across_a_loss() -> None:
    moving = pattern((3, 1), (1, 0), (4, 1))
    seen = np.ones(len(moving))
    seen[60:80] = 0
    start, end = active_part(clip_of(moving, seen=seen))
    assert start >= 4
    assert end == pytest.approx(8, abs=0.1)


def repeated(period: float, count: float, fps: float = 20.0, phase: float = 0.0) -> Clip:
    """Someone who raises both arms again and again; `phase` 0 begins with the arms down."""
    clip = clip_of(np.zeros(round(period * count * fps) + 1), fps)
    joints = clip.joints.copy()
    raised = 0.5 - 0.5 * np.cos(2 * np.pi * (np.arange(len(clip)) / fps / period + phase))
    for name in ("lwri", "rwri"):
        joints[:, DEFAULT_JOINTS.index(name), 1] += raised
    return Clip(joints, DEFAULT_JOINTS, fps)


@pytest.mark.parametrize("period", [0.8, 1.5, 3.0])
@pytest.mark.parametrize("phase", [0.0, 0.3, 0.5])
def test_one_repetition_from_rest(period: float, phase: float) -> None:
    clip = repeated(period, 4, phase=phase)
    found = repetition(clip)
    assert found is not None
    start, end = found
    assert end - start == pytest.approx(period, abs=0.06)
    hands = cut(clip, start, end).joints[:, DEFAULT_JOINTS.index("lwri"), 1]
    assert hands.argmax() / 20 == pytest.approx(period / 2, abs=0.15 * period)


@pytest.mark.parametrize("clip", [repeated(4, 1), repeated(4, 1.5), clip_of(np.zeros(80))])
def test_once_is_no_repetition(clip: Clip) -> None:
    assert repetition(clip) is None
    assert action_in(clip)[2] == 1


def test_repetitions_are_counted() -> None:
    start, end, count = action_in(repeated(2, 5))
    assert count == 5
    assert end - start == pytest.approx(2, abs=0.1)


@given(
    moving=st.lists(st.booleans(), min_size=2, max_size=120),
    losses=st.lists(st.integers(0, 119), max_size=20),
    fps=st.sampled_from([0.5, 5.0, 15.0, 30.0, 1000.0]),
)
def test_a_part_of_any_clip(moving: list[bool], losses: list[int], fps: float) -> None:
    seen = np.ones(len(moving))
    seen[[at for at in losses if at < len(moving)]] = 0
    clip = clip_of(np.array(moving), fps, seen)
    start, end, repetitions = action_in(clip)
    assert 0 <= start < end <= clip.duration + 1e-9
    assert repetitions >= 1
    assert len(cut(clip, start, end)) >= 2


@given(frames=st.integers(2, 60), columns=st.integers(1, 4), data=st.data())
def test_autocorrelation_is_the_mean_of_products(
    frames: int, columns: int, data: st.DataObject
) -> None:
    longest = data.draw(st.integers(0, frames - 1))
    seed = data.draw(st.integers(0, 99))
    signal = np.random.default_rng(seed).normal(size=(frames, columns)).astype(np.float32)
    direct = [
        (signal[: frames - lag] * signal[lag:]).sum(axis=1).mean() for lag in range(longest + 1)
    ]
    assert _autocorrelation(signal, longest) == pytest.approx(direct, abs=1e-4)


EXAMPLES = Path(__file__).parents[2] / "examples"


def over_again(name: str, times: int) -> Clip:
    clip = read_clip(EXAMPLES / f"{name}.npz")
    return Clip(np.tile(clip.joints, (times, 1, 1)), clip.joint_names, clip.fps)


@pytest.mark.parametrize("times", [2, 3, 8])
@pytest.mark.parametrize("name", ["squat/ada", "wave_right/cleo", "bow/ben"])
def test_slow_repetitions_are_actions_by_themselves(name: str, times: int) -> None:
    once, several = over_again(name, 1), over_again(name, times)
    assert one_repetition(once) is once
    assert repetition_notes(once) == ()
    one = one_repetition(several)
    assert one.duration == pytest.approx(once.duration, rel=0.15)
    assert f"one of about {times} repetitions" in one.notes[-1]
    assert f"shows about {times} repetitions" in repetition_notes(several)[0]
    assert one_repetition(one) is one


@pytest.mark.parametrize(("times", "told"), [(1, False), (2, True)])
def test_quick_repetitions_stay_together(times: int, told: bool) -> None:
    """A recorded jumping jack is three jumps."""
    clip = over_again("jumping_jack/ada", times)
    assert one_repetition(clip) is clip
    assert bool(repetition_notes(clip)) == told


def test_a_body_without_joints_to_see_it_by() -> None:
    clip = over_again("squat/ada", 3)
    arms = [at for at, name in enumerate(clip.joint_names) if name[1:] in ("sho", "elb", "wri")]
    part = Clip(clip.joints[:, arms], [clip.joint_names[at] for at in arms], clip.fps)
    assert one_repetition(part) is part
    assert repetition_notes(part) == ()
