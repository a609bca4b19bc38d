"""Calibration: counts that agree with `classify`, intervals, and what is recommended."""

import math
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from actioncli import Recognizer, SupportError, read_clip, read_collection
from actioncli.calibration import KINDS, Queries, Rate, Trials, recommend, run_trials
from actioncli.clips.clip import FloatArray

EXAMPLES = Path(__file__).parents[1] / "examples"


@pytest.fixture(scope="module")
def recognizer() -> Recognizer:
    return Recognizer()


@pytest.fixture(scope="module")
def folders(recognizer: Recognizer) -> Mapping[str, FloatArray]:
    """Embeddings of the examples, by their folder."""
    return {
        folder.name: recognizer.embed([read_clip(file) for file in sorted(folder.glob("*.npz"))])
        for folder in sorted(EXAMPLES.iterdir())
        if folder.is_dir()
    }


def trials_of(
    actions: list[tuple[float, int]],
    negatives: list[tuple[float, int]] | None = None,
    cohort: list[tuple[float, int]] | None = None,
    known: list[tuple[float, int, int]] | None = None,
) -> Trials:
    """Trials of two actions with given (score, nearest) and, where known, (.., shown)."""

    def queries(rows: list[tuple[float, int]]) -> Queries:
        table = np.array(rows, np.float64).reshape(-1, 2)
        return Queries(table[:, 0], table[:, 1].astype(np.intp), next_motions(len(table)))

    counter = iter(range(10_000))

    def next_motions(n: int) -> NDArray[np.intp]:
        return np.array([next(counter) for _ in range(n)], np.intp)

    known = known or []
    shown = np.array([each[2] for each in known], np.intp)
    return Trials(
        labels=("a", "b"),
        examples=(1 + int((shown == 0).sum()), 1 + int((shown == 1).sum())),
        known=queries([(score, nearest) for score, nearest, _ in known]),
        shown=shown,
        unknown={
            "actions": queries(actions),
            "negatives": queries(negatives or []),
            "cohort": queries(cohort or []),
        },
    )


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
        assert decision.accepted == (decision.confidence > 0 and not decision.shadowed)
        return decision.confidence if decision.accepted else 0.0

    known, strangers = [], []
    for label, examples in support.items():
        others_only = {name: each for name, each in support.items() if name != label}
        for n, example in enumerate(examples):
            rest = np.delete(examples, n, axis=0)
            if len(rest):
                known.append(told(example, {**support, label: rest}, negatives))
            strangers.append(told(example, others_only, negatives))
    np.testing.assert_allclose(trials.known.score, known, rtol=1e-4, atol=1e-6)
    np.testing.assert_allclose(trials.unknown["actions"].score, strangers, rtol=1e-4, atol=1e-6)
    clips = trials.false_accepts(0, "actions")
    assert (clips.of, clips.motions) == (len(strangers), len(support))
    # A negative is not compared with itself, and one that was also given counts once.
    asked = [
        told(negative, support, np.delete(negatives, n, axis=0))
        for n, negative in enumerate(negatives)
    ] + [told(other, support, negatives) for other in folders["jumping_jack"]]
    np.testing.assert_allclose(trials.unknown["negatives"].score, asked, rtol=1e-4, atol=1e-6)
    assert len(trials.unknown["cohort"]) == len(recognizer.cohort)
    # Negatives, other clips and the cohort's are a motion each.
    unknown = trials.all_unknown()
    assert unknown.motions == len(support) + len(asked) + len(recognizer.cohort)
    assert len(unknown) == len(unknown.nearest) == len(unknown.motion)


def test_as_near_to_a_negative_as_to_the_action_is_no_rejection(
    recognizer: Recognizer, folders: Mapping[str, FloatArray]
) -> None:
    squat, query = folders["squat"][:1], folders["bow"][:1]
    trials = run_trials(recognizer, {"squat": squat}, squat, query)
    told = recognizer.classify(query[0], {"squat": squat}, 0, squat)
    assert told.accepted
    assert trials.unknown["negatives"].score[1] == pytest.approx(told.confidence, rel=1e-4)


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
    assert len(trials.unknown["actions"]) == 0
    assert trials.false_rejects(1) == Rate(3, 3, 3)


def test_nothing_enrolled(recognizer: Recognizer) -> None:
    none = recognizer.embed([])
    with pytest.raises(SupportError, match="empty"):
        run_trials(recognizer, {}, none, none)


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


scores = st.lists(st.floats(0, 0.99), min_size=20, max_size=200)


@given(scores, st.sampled_from([0.05, 0.1, 0.25]))
def test_the_recommended_tau_is_the_smallest_that_keeps_the_rate(
    values: list[float], target: float
) -> None:
    trials = trials_of([(value, 0) for value in values])
    found = recommend(trials, target)
    assert found.measured
    n = len(values)
    assert (trials.false_accepts(found.tau).count + 1) / (n + 1) <= target + 1e-6
    if found.tau > 0:
        assert (trials.false_accepts(found.tau - 0.0011).count + 1) / (n + 1) > target - 1e-6


def test_as_many_are_accepted_as_the_rate_allows() -> None:
    # Of 19 motions one, for (1 + 1) / (19 + 1) is 0.1.
    assert recommend(trials_of([(n / 20, 0) for n in range(1, 20)]), 0.1).tau == 0.9
    assert recommend(trials_of([(0.4, 0)]), 0.5).tau == 0.4


def test_a_rounded_threshold_still_keeps_out_what_it_must() -> None:
    for step in range(1, 999):
        score = math.nextafter(step / 1000, 1)
        found = recommend(trials_of([(score, 0)] * 20), 0.05)
        assert found.tau == (step + 1) / 1000


def test_the_next_motion_is_accepted_as_rarely_as_wanted() -> None:
    rng = np.random.default_rng(0)
    accepted = []
    for _ in range(400):
        found = recommend(trials_of([(score, 0) for score in rng.random(24)]), 0.1)
        accepted.append(1 - found.tau)  # of scores that are uniform
    assert np.mean(accepted) == pytest.approx(2 / 25, abs=0.008)


def test_clips_of_one_motion_are_not_many_motions() -> None:
    score = np.repeat([0.9, 0.1], [5, 45])
    queries = Queries(score, np.zeros(50, np.intp), np.repeat(np.arange(10), 5))
    nothing = trials_of([]).unknown["cohort"]
    trials = Trials(
        ("a", "b"),
        (1, 1),
        known=nothing,
        shown=np.array([], np.intp),
        unknown={"actions": queries, "negatives": nothing, "cohort": nothing},
    )
    # 5 of 50 clips are above 0.1, but they are one motion of ten.
    assert recommend(trials, 0.1).tau == 0.9
    assert recommend(trials, 0.2).tau == 0.1
    assert not recommend(trials, 0.05).measured


def test_too_few_clips_are_told() -> None:
    found = recommend(trials_of([(0.9, 0)] * 18), 0.05)
    assert (found.tau, found.measured, found.actions) == (0.5, False, {})
    assert any("Too few" in note and "18" in note and "19" in note for note in found.notes)
    assert recommend(trials_of([(0.9, 0)] * 19), 0.05).measured
    for target in (0.05, 1 - 1e-12):
        empty = recommend(trials_of([]), target)
        assert (empty.tau, empty.measured) == (0.5, False)
    assert recommend(trials_of([(0.9, 0), (0.4, 0)]), 1 - 1e-12).tau == 0.4


def test_a_large_cohort_does_not_outvote_what_the_user_showed() -> None:
    cohort = [(0.1, 0)] * 500
    # All together: 20 of 520 above 0.1, within 5 %; of the negatives: all.
    found = recommend(trials_of([], negatives=[(0.8, 1)] * 20, cohort=cohort), 0.05)
    assert found.tau == 0.8
    enough = recommend(trials_of([], negatives=[(0.8, 1)] * 19, cohort=cohort), 0.05)
    assert (enough.tau, enough.notes[1:]) == (0.8, ())
    few = recommend(trials_of([], negatives=[(0.8, 1)] * 10, cohort=cohort), 0.05)
    assert few.tau == 0.1
    assert any("`negatives`" in note and "10 of 19" in note for note in few.notes)


def test_full_confidence_in_strangers_has_no_threshold() -> None:
    found = recommend(trials_of([(1.0, 0)] * 30), 0.05)
    assert (found.tau, found.measured) == (0.5, False)
    assert any("No threshold below 1" in note for note in found.notes)


def test_wide_intervals_are_told() -> None:
    vague = recommend(trials_of([(0.2, 0)] * 20, known=[(0.9, 0, 0)] * 3), 0.05)
    assert sum("are few" in note for note in vague.notes) == 2
    sure = recommend(trials_of([(0.2, 0)] * 200, known=[(0.9, 0, 0), (0.9, 1, 1)] * 30), 0.05)
    assert sure.notes == ()


def test_actions_get_thresholds_of_their_own_where_clips_suffice() -> None:
    asked = [(0.3, 0)] * 30 + [(0.7, 1)] * 10
    trials = trials_of(asked, known=[(0.5, 0, 0), (0.5, 0, 1), (0.9, 1, 1)])
    assert recommend(trials, 0.05).actions == {}
    found = recommend(trials, 0.05, per_action=True)
    assert (found.tau, found.actions) == (0.7, {"a": 0.3})
    assert any("1 of 2 actions" in note for note in found.notes)
    taus = [0.3, 0.7]
    assert trials.false_accepts(taus) == Rate(0, 40, 40)
    # The threshold is that of the nearest action, not of the one that is shown.
    assert trials.false_rejects(taus) == Rate(0, 3, 3)
    assert trials.misnamed(taus) == Rate(1, 3, 3)
    assert trials.false_rejects(0.7) == Rate(2, 3, 3)
    assert trials.false_rejects(0.7, action=1) == Rate(1, 2, 2)
    assert trials.false_accepts(0.2, action=1) == Rate(10, 10, 10)
    assert trials.false_accepts([0.9, 0.6], action=1) == Rate(10, 10, 10)


def test_an_action_with_full_confidence_in_strangers_gets_no_threshold_of_its_own() -> None:
    asked = [(0.1, 0)] * 400 + [(0.9, 1)] * 19
    found = recommend(trials_of(asked), 0.05, per_action=True)
    assert (found.tau, found.actions) == (0.1, {"a": 0.1, "b": 0.9})
    assert not any("threshold of their own" in note for note in found.notes)
    certain = recommend(trials_of([*asked[:400], *[(1.0, 1)] * 19]), 0.05, per_action=True)
    assert (certain.tau, certain.actions) == (0.1, {"a": 0.1})


def test_a_shadowed_query_is_accepted_by_no_threshold() -> None:
    assert trials_of([(0.0, 0)]).false_accepts(0.0) == Rate(0, 1, 1)


def test_real_recordings(recognizer: Recognizer, shared: Path) -> None:
    collection = read_collection(shared / "data" / "utd_mhad.npz")
    labels = sorted(set(collection.labels))
    clips = {
        label: [clip for clip, its in zip(collection.clips, collection.labels, strict=True)
                if its == label][:5]
        for label in labels[:13]
    }  # fmt: skip
    embedded = {label: recognizer.embed(each) for label, each in clips.items()}
    support = {label: embedded[label] for label in labels[:5]}
    negatives = np.concatenate([embedded[label] for label in labels[5:13]])
    trials = run_trials(recognizer, support, recognizer.embed([]), negatives)
    assert [trials.false_accepts(0, kind).of for kind in KINDS] == [25, 40, len(recognizer.cohort)]
    assert trials.false_rejects(0).of == 25
    for target in (0.1, 0.3):
        found = recommend(trials, target)
        assert not found.measured or trials.false_accepts(found.tau).rate <= target
    rates = [trials.false_accepts(tau).count for tau in np.linspace(0, 1, 21)]
    assert rates == sorted(rates, reverse=True)
