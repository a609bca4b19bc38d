"""Calibration: what is recommended."""

import math
import re
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
        stored=np.zeros(len(rows), bool),
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


def test_what_cannot_be_measured_leaves_the_usual_threshold() -> None:
    # Of 19 motions one may be accepted at 0.1, for (1 + 1) / (19 + 1) is 0.1.
    for actions, target, tau in (
        ([(n / 20, 0) for n in range(1, 20)], 0.1, 0.9),
        ([(0.4, 0)], 0.5, 0.4),
        ([(0.9, 0), (0.4, 0)], 1 - 1e-12, 0.4),
        ([(0.9, 0)] * 19, 0.05, 0.9),
        ([(0.9, 0)] * 18, 0.05, None),
        ([(1.0, 0)] * 30, 0.05, None),
        ([], 0.05, None),
        ([], 1 - 1e-12, None),
    ):
        found = recommend(trials_of(actions), target)
        assert (found.tau, found.measured) == (tau or 0.5, tau is not None)
        assert found.actions == {}


MANY, FEW = [(0.2, 0)] * 200, [(0.2, 0)] * 20
SEEN = [(0.9, 0, 0), (0.9, 1, 1)] * 30


@pytest.mark.parametrize(
    ("trials", "target", "notes"),
    [
        (trials_of(MANY, known=SEEN), 0.05, []),
        # The width counts, not the rate; and half of one's own are not more than half.
        (trials_of(MANY, known=[(0.9, 0, 0)] * 30 + [(0.1, 1, 1)] * 30), 0.05, []),
        (trials_of(FEW, known=SEEN), 0.081, []),
        (trials_of(FEW, known=SEEN), 0.08, ["20 motions .* are few: .* from 0.00 to 0.16."]),
        (trials_of(FEW, known=SEEN[:4]), 0.081, ["4 examples .* are few: .* from 0.00 to 0.49."]),
        # One of 20 is accepted: the interval is that of the recommended threshold.
        (trials_of([(0.9, 0), *FEW[1:]], known=SEEN), 0.1, [".* may be .* from 0.01 to 0.24."]),
        (
            trials_of([(0.9, 0)] * 18, known=SEEN),
            0.05,
            ["Too few motions .* 18, .* 0.05 needs 19."],
        ),
        (trials_of([(1.0, 0)] * 30, known=SEEN), 0.05, ["No threshold below 1 .* at 0.05: .*"]),
        (
            trials_of(MANY, known=[(0.1, 0, 0)] * 40 + [(0.9, 1, 1)] * 39),
            0.05,
            ["This threshold rejects 40 of 79 of your own examples. .*"],
        ),
        (trials_of(MANY), 0.05, ["False rejects cannot be told: every action has one example"]),
        (trials_of(MANY, known=SEEN[::2]), 0.05, ["1 of 2 actions have one example: "]),
    ],
)
def test_notes(trials: Trials, target: float, notes: list[str]) -> None:
    found = recommend(trials, target).notes
    assert len(found) == len(notes)
    assert all(re.match(pattern, note) for pattern, note in zip(notes, found, strict=True))


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
