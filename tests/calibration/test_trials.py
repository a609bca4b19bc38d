"""Trials: counts that agree with `classify`, and their intervals."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from actioncli import Recognizer, read_clip
from actioncli.calibration.threshold import recommend
from actioncli.calibration.trials import KINDS, KNOWN, Rate, run_trials
from actioncli.clips.clip import FloatArray

EXAMPLES = Path(__file__).parents[2] / "examples"


@pytest.fixture(scope="module")
def recognizer() -> Recognizer:
    """With a part of the cohort, which is asked in two pieces."""
    whole = Recognizer().weights
    return Recognizer(
        replace(whole, tensors={**whole.tensors, "cohort": whole.tensors["cohort"][:70]})
    )


@pytest.fixture(scope="module")
def folders(recognizer: Recognizer) -> Mapping[str, FloatArray]:
    """Embeddings of the examples, by their folder."""
    return {
        folder.name: recognizer.embed([read_clip(file) for file in sorted(folder.glob("*.npz"))])
        for folder in sorted(EXAMPLES.iterdir())
        if folder.is_dir()
    }


@pytest.mark.parametrize(
    ("count", "of", "low", "high"),
    # Newcombe 1998 (Statistics in Medicine 17), table I, method 3.
    [
        (81, 263, 0.2553, 0.3662),
        (15, 148, 0.0624, 0.1605),
        (0, 20, 0.0, 0.1611),
        (1, 29, 0.0061, 0.1718),
    ],
)
def test_the_interval_is_wilsons(count: int, of: int, low: float, high: float) -> None:
    assert Rate(count, of, of).interval == pytest.approx((low, high), abs=5e-5)


@given(st.integers(0, 400), st.integers(0, 400), st.integers(1, 9))
def test_an_interval_holds_its_rate(count: int, more: int, alike: int) -> None:
    of = count + more
    rate = Rate(count, of, -(-of // alike))
    low, high = rate.interval
    assert 0 <= low <= high <= 1
    if rate.of:
        assert low <= rate.rate <= high
    else:
        assert math.isnan(rate.rate)
        assert (low, high) == (0, 1)


def test_clips_of_one_motion_tell_as_much_as_one() -> None:
    assert Rate(10, 20, 4).interval == pytest.approx(Rate(2, 4, 4).interval)


def test_queries_are_answered_as_classify_answers_them(
    recognizer: Recognizer, folders: Mapping[str, FloatArray]
) -> None:
    support = {name: folders[name] for name in ("squat", "wave_right", "kick_right", "bow")}
    negatives = np.concatenate([folders["wave_left"], folders["punch_right"]])
    others = np.concatenate([folders["jumping_jack"], folders["wave_left"][:1]])
    trials = run_trials(recognizer, support, negatives, others)
    assert trials.labels == tuple(support)
    assert trials.examples == tuple(len(each) for each in support.values())

    def told(clip: FloatArray, enrolled: Mapping[str, FloatArray], no: FloatArray) -> float:
        decision = recognizer.classify(clip, enrolled, 0, no)
        assert decision.accepted == (decision.confidence > 0 and not decision.negative_is_nearer)
        return decision.confidence if decision.accepted else 0.0

    known, shown, strangers = [], [], []
    for number, (label, examples) in enumerate(support.items()):
        others_only = {name: each for name, each in support.items() if name != label}
        for n, example in enumerate(examples):
            rest = np.delete(examples, n, axis=0)
            if len(rest):
                known.append(told(example, {**support, label: rest}, negatives))
                shown.append(number)
            strangers.append(told(example, others_only, negatives))
    score = {kind: trials.score[trials.kind == kind] for kind in (KNOWN, *KINDS)}
    np.testing.assert_allclose(score[KNOWN], known, rtol=1e-4, atol=1e-6)
    np.testing.assert_array_equal(trials.shown[trials.kind == KNOWN], shown)
    np.testing.assert_allclose(score["actions"], strangers, rtol=1e-4, atol=1e-6)
    clips = trials.false_accepts(0, "actions")
    assert (clips.of, clips.motions) == (len(strangers), len(support))
    # A negative is not compared with itself, and one that was also given counts once.
    asked = [
        told(negative, support, np.delete(negatives, n, axis=0))
        for n, negative in enumerate(negatives)
    ] + [told(other, support, negatives) for other in folders["jumping_jack"]]
    np.testing.assert_allclose(score["negatives"], asked, rtol=1e-4, atol=1e-6)
    assert len(score["cohort"]) == len(recognizer.cohort)
    # Negatives, other clips and the cohort's are a motion each.
    motions = len(support) + len(asked) + len(recognizer.cohort)
    assert trials.motions(trials.kind != KNOWN) == motions


def test_as_near_to_a_negative_as_to_the_action_is_no_rejection(
    recognizer: Recognizer, folders: Mapping[str, FloatArray]
) -> None:
    squat, query = folders["squat"][:1], folders["bow"][:1]
    trials = run_trials(recognizer, {"squat": squat}, squat, query)
    told = recognizer.classify(query[0], {"squat": squat}, 0, squat)
    assert told.accepted
    assert trials.score[trials.kind == "negatives"][1] == pytest.approx(told.confidence, rel=1e-4)
    # What is enrolled as a negative is rejected, whatever is to be expected of others like it.
    assert trials.score[trials.kind == "negatives"][0] > 0.5
    found = trials.false_accepts(0, "negatives")
    assert (found.count, found.of) == (1, 2)


def test_one_example_an_action_tells_false_accepts_only(
    recognizer: Recognizer, folders: Mapping[str, FloatArray]
) -> None:
    support = {name: examples[:1] for name, examples in folders.items()}
    none = recognizer.embed([])
    trials = run_trials(recognizer, support, none, none)
    assert trials.false_rejects(0.5) == Rate(0, 0, 0)
    assert trials.misnamed(0.5) == Rate(0, 0, 0)
    assert trials.false_accepts(0.5, "actions").of == len(support)
    assert trials.false_accepts(0).of == len(support) + len(recognizer.cohort)
    assert trials.false_accepts(1).count == 0
    assert any("one example" in note for note in recommend(trials, 0.05).notes)


def test_one_action_meets_no_other(
    recognizer: Recognizer, folders: Mapping[str, FloatArray]
) -> None:
    none = recognizer.embed([])
    trials = run_trials(recognizer, {"squat": folders["squat"]}, none, none)
    assert not (trials.kind == "actions").any()
    assert trials.false_rejects(1) == Rate(3, 3, 3)
    two = {name: folders[name] for name in ("squat", "bow")}
    met = run_trials(recognizer, two, none, none).false_accepts(0, "actions")
    assert met.of == sum(map(len, two.values()))


def test_an_example_may_be_nearer_to_another_action_than_to_the_rest_of_its_own(
    recognizer: Recognizer, folders: Mapping[str, FloatArray]
) -> None:
    none = recognizer.embed([])
    mixed = np.concatenate([folders["bow"][:1], folders["squat"][:1]])
    trials = run_trials(recognizer, {"mixed": mixed, "squat": folders["squat"][1:]}, none, none)
    assert trials.nearest[trials.kind == KNOWN][1] == 1
    assert trials.misnamed(0).count >= 1


def test_progress_counts_every_example(
    recognizer: Recognizer, folders: Mapping[str, FloatArray]
) -> None:
    seen: list[list[int]] = []
    none = recognizer.embed([])

    def watch(steps: Sequence[int]) -> list[int]:
        seen.append(list(steps))
        return seen[-1]

    run_trials(recognizer, {"squat": folders["squat"]}, none, none, watch)
    assert seen[-1] == list(range(len(folders["squat"])))
