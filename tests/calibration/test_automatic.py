"""The threshold that enrolment chooses: when, how high, and never that of the user."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest

from actioncli import Recognizer, SupportStore, enrol, read_clip
from actioncli.calibration import automatic
from actioncli.calibration.automatic import suited
from actioncli.calibration.trials import KNOWN, Trials
from actioncli.recognition.threshold import Threshold, keep_threshold, kept_threshold

EXAMPLES = Path(__file__).parents[2] / "examples"
SQUAT = [read_clip(EXAMPLES / "squat" / f"{who}.npz") for who in ("ada", "ben", "cleo")]
WAVE = [read_clip(EXAMPLES / "wave_right" / f"{who}.npz") for who in ("ada", "ben", "cleo")]


def trials(
    known: Sequence[float],
    actions: Sequence[float],
    cohort: Sequence[float],
    negatives: Sequence[float] = (),
) -> Trials:
    """Two actions, of which the first has the known clips."""
    unknown = [*actions, *negatives, *cohort]
    kinds = ["actions"] * len(actions) + ["negatives"] * len(negatives) + ["cohort"] * len(cohort)
    count = len(known) + len(unknown)
    return Trials(
        labels=("squat", "lunge"),
        examples=(max(len(known), 1), 1),
        kind=np.array([KNOWN] * len(known) + kinds),
        score=np.array([*known, *unknown], np.float32),
        nearest=np.zeros(count, np.intp),
        shown=np.array([0] * len(known) + [-1] * len(unknown)),
        motion=np.arange(count),
        stored=np.zeros(count, np.bool_),
    )


QUIET = [0.1] * 96
LOUD = [0.6] * 20 + [0.1] * 76


@pytest.mark.parametrize(
    ("given", "tau", "said"),
    [
        # Nothing comes close, or no more than is promised.
        (trials([], [0.2, 0.1], QUIET), 0.5, ""),
        (trials([0.9, 0.8], [0.2, 0.1], QUIET), 0.5, ""),
        (trials([], [0.2], [0.8] * 4 + [0.1] * 92), 0.5, ""),
        # With one example, what is there decides, and nothing tells what it costs.
        (trials([], [0.2], LOUD), 0.6, "a second example of each would tell"),
        (trials([], [0.7, 0.1], LOUD), 0.6, "21 of 98 motions that are none are accepted"),
        (trials([], [0.2], [0.97] * 96), 0.9, "still 96 are: record more examples"),
        # Not so high that the action's own clips are lost, but one in ten and those lost already.
        (trials([0.9, 0.8], [0.2], LOUD), 0.6, "20 of 97"),
        (trials([0.9, 0.55], [0.2], LOUD), 0.55, "still 20 are"),
        (trials([0.9] * 9 + [0.55] * 1, [0.2], LOUD), 0.6, "20 of 97"),
        (trials([0.9, 0.1], [0.2], LOUD), 0.6, "20 of 97"),
        (trials([0.9, 0.5001], [0.2], LOUD), 0.5, "would reject your own examples"),
        # A negative that others like it pass.
        (trials([], [0.2], QUIET, [0.8] * 19), 0.8, "19 of 116"),
        # Too little to tell by.
        (trials([], [0.7], []), 0.5, "cannot be told from so little: record more examples"),
        (trials([], [], []), 0.5, ""),
    ],
)
def test_what_suits(given: Trials, tau: float, said: str) -> None:
    found, why = suited(given)
    assert found == pytest.approx(tau, abs=0.002)
    assert said in why
    assert bool(said) == bool(why)
    if found > 0.5:
        right = given.score[(given.kind == KNOWN) & (given.score > 0.5)]
        assert (right <= found).sum() <= 0.1 * len(right)


def test_one_example_of_unlike_actions_leaves_it(
    store: SupportStore, recognizer: Recognizer
) -> None:
    for label, clips in {"squat": SQUAT, "wave": WAVE}.items():
        (one,) = enrol(store, recognizer, label, clips[:1])
        assert one.threshold == ""
    assert kept_threshold(store) is None


def test_a_second_example_chooses_and_the_last_word_is_the_users(
    store: SupportStore, recognizer: Recognizer
) -> None:
    enrol(store, recognizer, "wave", WAVE[:2], keep_tau=True)
    assert kept_threshold(store) is None
    *_, last = enrol(store, recognizer, "squat", SQUAT[:2])
    chosen = kept_threshold(store)
    assert chosen is not None
    assert chosen.automatic
    assert 0.5 < chosen.tau <= 0.9
    assert last.threshold.startswith(f"tau is {chosen.tau:g} from now on: at 0.5, ")
    assert last.told[-1] == last.threshold
    # The same once more adds nothing; another changes what need not be told.
    assert [one.threshold for one in enrol(store, recognizer, "squat", SQUAT[:2])] == ["", ""]
    enrol(store, recognizer, "squat", SQUAT[2:])
    assert abs(kept_threshold(store).tau - chosen.tau) < 0.1  # type: ignore[union-attr]
    # Other weights measured nothing here.
    keep_threshold(store, Threshold(0.8, "others", automatic=True))
    enrol(store, recognizer, "wave", WAVE[2:])
    assert kept_threshold(store).weights == recognizer.weights.checksum  # type: ignore[union-attr]


@pytest.mark.parametrize(("tau", "told"), [(0.3, True), (0.95, False)])
def test_what_the_user_set_stays(
    store: SupportStore, recognizer: Recognizer, tau: float, told: bool
) -> None:
    own = Threshold(tau, recognizer.weights.checksum, {"squat": tau})
    keep_threshold(store, own)
    *_, last = enrol(store, recognizer, "wave", WAVE)
    assert kept_threshold(store) == own
    assert last.threshold.startswith(f"tau stays {tau:g}, as you set it: ") == told


def test_what_is_gone_is_forgotten(store: SupportStore, recognizer: Recognizer) -> None:
    checksum = recognizer.weights.checksum
    keep_threshold(store, Threshold(0.8, checksum, automatic=True))
    (one,) = enrol(store, recognizer, "squat", SQUAT[:1])
    assert one.threshold == "tau is 0.5 again"
    assert kept_threshold(store) is None


def test_many_examples_are_left_to_calibrate(
    store: SupportStore, recognizer: Recognizer, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(automatic, "MOST_EXAMPLES", 2)
    *_, last = enrol(store, recognizer, "squat", SQUAT)
    assert last.threshold.startswith("tau stays 0.5: with more than 2 examples, `actioncli cal")


def test_a_mirror_image_is_no_second_opinion(store: SupportStore, recognizer: Recognizer) -> None:
    """One clip and its image say nothing of what the right ones reach."""
    enrolled = enrol(store, recognizer, "wave", WAVE[:1], either_side=True)
    assert all("your own examples" not in one.threshold for one in enrolled)


def test_it_is_kept_and_renamed_as_what_it_is(store: SupportStore) -> None:
    chosen = Threshold(0.7, "abc", {"a": 0.6}, automatic=True)
    keep_threshold(store, chosen.renamed("a", "b"))
    assert kept_threshold(store) == Threshold(0.7, "abc", {"b": 0.6}, automatic=True)
    assert "automatic" not in Threshold(0.7, "abc").to_text()


def test_clips_that_nobody_compares(store: SupportStore) -> None:
    assert [one.threshold for one in enrol(store, None, "squat", SQUAT)] == [""] * 3
