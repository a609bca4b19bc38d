"""Windows of long clips, and the decisions that they make."""

from __future__ import annotations

from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from cases import cases
from hypothesis import given, settings
from hypothesis import strategies as st

from actioncli import Clip, Recognizer, read_clip
from actioncli.clips.edit import cut
from actioncli.recognition.windows import LONG, most_windows, odds_factor, window_lengths, windows

EXAMPLES = Path(__file__).parents[2] / "examples"
RECOGNIZER = Recognizer()


def example(name: str) -> Clip:
    return read_clip(EXAMPLES / f"{name}.npz")


SUPPORT = {label: [example(f"{label}/ada")] for label in ("wave_right", "squat", "jumping_jack")}
QUERIES = {
    "wave_right": example("wave_right/cleo"),
    "squat": example("squat/ben"),
    "jumping_jack": example("jumping_jack/ben"),
}
KICK, BOW = example("kick_right/ada"), example("bow/ben")
DURATIONS = [clip.duration for [clip] in SUPPORT.values()]


def joined(*clips: Clip) -> Clip:
    return Clip(np.concatenate([clip.joints for clip in clips]), KICK.joint_names, KICK.fps)


def idle(clip: Clip, before: float, after: float) -> Clip:
    """The first and the last pose held."""
    held = (round(before * clip.fps), 0), (0, round(after * clip.fps))
    counts = held[0][0], held[1][1]
    return Clip(
        np.pad(clip.joints, (counts, (0, 0), (0, 0)), mode="edge"), clip.joint_names, clip.fps
    )


def random_clip(seconds: float, fps: float = 20.0) -> Clip:
    rng = np.random.default_rng(0)
    frames = max(2, round(seconds * fps) + 1)
    return Clip(rng.normal(size=(frames, 15, 3)), KICK.joint_names[:15], fps, start=3.0)


def test_lengths_reach_faster_and_slower() -> None:
    lengths = window_lengths([2.0, 3.0])
    assert lengths[0] == pytest.approx(1.4)
    assert lengths[-1] == pytest.approx(4.2)
    assert all(1 < b / a < 1.5 for a, b in pairwise(lengths))
    assert window_lengths([0.1])[0] == pytest.approx(0.8)
    assert window_lengths([600])[-1] == pytest.approx(840)
    assert window_lengths([600], longest=8) == pytest.approx((0.7 * 8, 8))
    # Short examples of equal length need no length between the two ends.
    assert window_lengths([0.1]) == pytest.approx((0.8, 1.4 * 0.8))
    assert window_lengths([2, 2]) == pytest.approx((1.4, 1.4 * 2**0.5, 2.8))


def test_only_long_clips_have_windows() -> None:
    assert list(windows(random_clip(2 * LONG), [2.0])) == []
    assert list(windows(random_clip(2 * LONG + 0.2), [2.0]))
    assert list(windows(random_clip(60), [])) == []


def test_a_window_has_at_least_four_frames() -> None:
    found = [len(window) for window in windows(random_clip(300, fps=2), [1.0, 4.0])]
    assert min(found) == 4
    just = random_clip(60, fps=3 / 0.8)
    assert 4 in {len(window) for window in windows(just, [0.8])}
    assert list(windows(random_clip(300, fps=0.5), [1.0, 4.0])) == []


@pytest.mark.parametrize("seconds", [3.0, 3.5])
def test_windows_of_every_length_that_is_shorter_than_the_clip(seconds: float) -> None:
    # The median tells what is long, so examples may last as long as a long clip, and longer.
    durations = [1.0, 1.0, 1.0, 2.5, 2.5]
    *shorter, longest = window_lengths(durations)
    assert seconds <= longest == 3.5
    found = [window.duration for window in windows(random_clip(seconds, fps=100), durations)]
    assert {min(shorter, key=lambda each: abs(each - one)) for one in found} == {*shorter}
    assert max(found) == pytest.approx(shorter[-1], abs=0.01)


def test_windows_overlap_by_three_quarters_or_a_little_more() -> None:
    clip = random_clip(10, fps=100)
    found = list(windows(clip, [2.0]))
    for seconds in window_lengths([2.0]):
        alike = [each for each in found if abs(each.duration - seconds) < 0.02]
        fewest = int(np.ceil((10 - seconds) / (seconds / 4))) + 1
        starts = [each.start - clip.start for each in alike]
        assert starts == pytest.approx(np.linspace(0, 10 - seconds, fewest), abs=0.01)


@given(
    st.floats(0.1, 20),
    st.lists(st.floats(0.1, 10), min_size=1, max_size=4),
    st.sampled_from([0.5, 5.0, 15.0, 30.0]),
)
@settings(max_examples=cases(50))
def test_windows_lie_within_the_clip_and_leave_nothing_out(
    seconds: float, durations: list[float], fps: float
) -> None:
    clip = random_clip(seconds, fps)
    found = list(windows(clip, durations))
    assert len(found) == most_windows(clip, durations)
    step = 1 / fps
    for window in found:
        assert window.start >= clip.start
        assert window.start + window.duration <= clip.start + clip.duration + 1e-6
        first = round((window.start - clip.start) * fps)
        np.testing.assert_array_equal(window.joints, clip.joints[first : first + len(window)])
    # However rarely frames came, their number limits that of the windows.
    assert len(found) <= 1.5 * len(clip) * len(window_lengths(durations))
    if found:
        assert min(window.start for window in found) == clip.start
        last = max(window.start + window.duration for window in found)
        assert last == pytest.approx(clip.start + clip.duration, abs=step)


def test_an_action_between_two_others_is_found_where_it_is() -> None:
    clip = joined(KICK, QUERIES["wave_right"], BOW)
    as_a_whole = RECOGNIZER.classify(clip, SUPPORT, durations=())
    assert not as_a_whole.accepted
    assert as_a_whole.part == (0, clip.duration)
    decision = RECOGNIZER.classify(clip, SUPPORT)
    assert decision.label == "wave_right"
    assert decision.part is not None
    start, end = decision.part
    true_start, true_end = KICK.duration, KICK.duration + QUERIES["wave_right"].duration
    shared = min(end, true_end) - max(start, true_start)
    assert shared > 0.6 * max(end - start, true_end - true_start)
    assert decision.notes[-1].startswith(f"matched {start:.1f} s to {end:.1f} s, the surest of ")


def test_the_decision_is_that_of_its_part_at_longer_odds() -> None:
    clip = joined(KICK, QUERIES["squat"], BOW)
    decision = RECOGNIZER.classify(clip, SUPPORT)
    assert decision.part is not None
    alone = RECOGNIZER.classify(cut(clip, *decision.part), SUPPORT, durations=())
    odds = odds_factor(len(list(windows(clip, DURATIONS))))
    assert [each.label for each in decision.ranking] == [each.label for each in alone.ranking]
    for ours, other in zip(decision.ranking, alone.ranking, strict=True):
        assert ours.distance == pytest.approx(odds * other.distance, rel=1e-3)
        assert ours.probability == pytest.approx(other.probability, abs=1e-4)
        assert ours.confidence == pytest.approx(1 / (1 + ours.distance), rel=1e-3)


def test_an_ordinary_clip_is_compared_as_ever() -> None:
    for clip in (*QUERIES.values(), KICK, BOW):
        decision = RECOGNIZER.classify(clip, SUPPORT)
        embedding = RECOGNIZER.embed([clip])[0]
        assert decision.part == (0, clip.duration)
        alone = RECOGNIZER.classify(embedding, SUPPORT)
        assert alone.part is None
        assert decision.ranking == alone.ranking


@pytest.mark.parametrize("label", sorted(SUPPORT))
@pytest.mark.parametrize("seconds", [1.0, 3.0, 12.0])
def test_where_nobody_moves_there_is_no_action(label: str, seconds: float) -> None:
    """The first pose of what is enrolled, held, with a sensor's noise: as an example it would be
    itself."""
    clip = SUPPORT[label][0]
    noise = np.random.default_rng(0).normal(0, 0.003, (round(seconds * 30), *clip.joints[0].shape))
    still = Clip(clip.joints[:1] + noise, clip.joint_names, 30)
    decision = RECOGNIZER.classify(still, {label: [still, clip]}, tau=0.0)
    assert not decision.accepted
    assert decision.confidence == 0
    assert decision.ranking[0].distance >= 1000
    after = RECOGNIZER.classify(joined(still, clip), SUPPORT, tau=0.01)
    assert after.label == label


@given(st.sampled_from(sorted(QUERIES)), st.floats(0, 8), st.floats(0, 8))
@settings(max_examples=cases(12))
def test_idling_before_and_after_changes_little(label: str, before: float, after: float) -> None:
    clip = idle(QUERIES[label], before, after)
    decision = RECOGNIZER.classify(clip, SUPPORT)
    assert decision.label == label
    assert decision.part is not None
    start, end = decision.part
    assert 0 <= start < end <= clip.duration + 1e-6
