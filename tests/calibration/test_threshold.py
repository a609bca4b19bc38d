"""Calibration: what is recommended."""

import math
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from actioncli import Recognizer, read_collection
from actioncli.calibration.threshold import recommend
from actioncli.calibration.trials import KINDS, KNOWN, Rate, Trials, run_trials


def trials_of(
    actions: Sequence[tuple[float, int]],
    negatives: Sequence[tuple[float, int]] = (),
    cohort: Sequence[tuple[float, int]] = (),
    known: Sequence[tuple[float, int, int]] = (),
    alike: int = 1,
) -> Trials:
    """Trials of two actions with given (score, nearest) and, where known, (.., shown); so many
    in a row are one motion."""
    rows = [*known, *((*row, -1) for row in [*actions, *negatives, *cohort])]
    score, nearest, shown = np.array(rows, np.float64).reshape(-1, 3).T
    return Trials(
        labels=("a", "b"),
        examples=(1 + int((shown == 0).sum()), 1 + int((shown == 1).sum())),
        kind=np.repeat([KNOWN, *KINDS], list(map(len, (known, actions, negatives, cohort)))),
        score=score,
        nearest=nearest.astype(np.intp),
        shown=shown.astype(np.intp),
        motion=np.arange(len(rows)) // alike,
    )


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
    trials = trials_of([(0.9, 0)] * 5 + [(0.1, 0)] * 45, alike=5)
    # 5 of 50 clips are above 0.1, but they are one motion of ten.
    assert recommend(trials, 0.1).tau == 0.9
    assert recommend(trials, 0.2).tau == 0.1
    assert not recommend(trials, 0.05).measured


def test_too_few_clips_are_told() -> None:
    found = recommend(trials_of([(0.9, 0)] * 18), 0.05)
    assert (found.tau, found.measured, found.actions) == (0.5, False, {})
    assert found.notes[-1] == (
        "Too few motions other than the actions to tell: 18, and a false accept rate of 0.05 needs "
        "19. Examples of one action count as one motion. Keep clips of other motions with "
        "`actioncli enroll --negative CLIP...`, or name some with --negatives."
    )
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
    assert "Too few motions of the kind `negatives` to tell by themselves: 10 of 19." in few.notes
    one = recommend(trials_of([], negatives=[(0.8, 1)], cohort=cohort), 0.05)
    assert any("`negatives`" in note and "1 of 19" in note for note in one.notes)


def test_full_confidence_in_strangers_has_no_threshold() -> None:
    found = recommend(trials_of([(1.0, 0)] * 30), 0.05)
    assert (found.tau, found.measured, found.actions) == (0.5, False, {})
    assert found.notes[-1] == (
        "No threshold below 1 holds false accepts at 0.05: motions other than the actions are "
        "taken for one with full confidence. Enrol clips of such with `actioncli enroll --negative "
        "CLIP...`."
    )


MANY = [(0.2, 0)] * 200
SEEN = [(0.9, 0, 0), (0.9, 1, 1)]


def test_wide_intervals_are_told() -> None:
    vague = recommend(trials_of([(0.2, 0)] * 20, known=SEEN[:1] * 3 + SEEN[1:]), 0.05)
    assert vague.notes == (
        "20 motions other than the actions are few: the rate of false accepts may be anything "
        "from 0.00 to 0.16.",
        "4 examples that have others of their action are few: the rate of false rejects may be "
        "anything from 0.00 to 0.49.",
    )
    assert recommend(trials_of(MANY, known=SEEN * 30), 0.05).notes == ()


def test_what_is_wide() -> None:
    widest = Rate(0, 20, 20).interval[1]
    for target, notes in ((widest / 2, 0), (widest / 2 - 1e-6, 1), (widest / 2.5, 1)):
        found = recommend(trials_of([(0.2, 0)] * 20, known=SEEN * 30), target)
        assert len(found.notes) == notes
    # The width counts, not the rate; and half of one's own examples are not more than half.
    half = [(0.9, 0, 0)] * 30 + [(0.1, 1, 1)] * 30
    assert recommend(trials_of(MANY, known=half), 0.05).notes == ()


def test_a_threshold_that_rejects_most_of_ones_own_is_told() -> None:
    own = [(0.1, 0, 0)] * 40 + [(0.9, 1, 1)] * 39
    (told,) = recommend(trials_of(MANY, known=own), 0.05).notes
    assert told == (
        "This threshold rejects 40 of 79 of your own examples. What is taken for an action without "
        "being one is better enrolled with `actioncli enroll --negative CLIP...` than kept out by "
        "a threshold."
    )


def test_false_rejects_that_cannot_be_told_are_named() -> None:
    (told,) = recommend(trials_of(MANY), 0.05).notes
    assert told == (
        "False rejects cannot be told: every action has one example, and it takes another to ask. "
        "Enrol a second one of each."
    )
    (told,) = recommend(trials_of(MANY, known=[(0.9, 0, 0)] * 60), 0.05).notes
    assert told == "1 of 2 actions have one example: false rejects of these cannot be told."


def test_actions_get_thresholds_of_their_own_where_clips_suffice() -> None:
    asked = [(0.3, 0)] * 30 + [(0.7, 1)] * 10
    trials = trials_of(asked, known=[(0.5, 0, 0), (0.5, 0, 1), (0.9, 1, 1)])
    assert recommend(trials, 0.05).actions == {}
    found = recommend(trials, 0.05, per_action=True)
    assert (found.tau, found.actions) == (0.7, {"a": 0.3})
    assert found.notes[-1] == (
        "1 of 2 actions have too few other motions near them for a threshold of their own (19 are "
        "needed); the common one holds for them."
    )
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


def test_real_recordings(shared: Path) -> None:
    recognizer = Recognizer()
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
