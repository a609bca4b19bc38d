"""How a comparison becomes a decision: what is accepted, under which name, and why not.

First with the shipped weights, then with a model that puts clips on a line, whose decisions can be
worked out by hand.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from actioncli import Clip, Recognizer, SupportError, UsageError, WeightsError, read_clip
from actioncli.clips.clip import FloatArray
from actioncli.model.arrays import softmax
from actioncli.model.config import ModelConfig, PartsConfig
from actioncli.model.trx_os import parameter_shapes
from actioncli.model.weights import Weights
from actioncli.recognition.decision import Comparison
from actioncli.recognition.threshold import DEFAULT_TAU
from actioncli.recognition.windows import odds_factor, windows

EXAMPLES = Path(__file__).parents[2] / "examples"


@pytest.fixture(scope="module")
def clips() -> dict[str, Clip]:
    return {
        f"{action}/{person}": read_clip(EXAMPLES / action / f"{person}.npz")
        for action, person in [
            ("wave_right", "ada"), ("wave_right", "cleo"), ("squat", "ada"), ("bow", "ben"),
        ]
    }  # fmt: skip


@pytest.fixture(scope="module")
def support(clips: dict[str, Clip]) -> dict[str, list[Clip]]:
    return {"squat": [clips["squat/ada"]], "wave": [clips["wave_right/ada"]]}


def test_the_ranking_is_the_comparison_nearest_first(
    recognizer: Recognizer, clips: dict[str, Clip], support: dict[str, list[Clip]]
) -> None:
    query = clips["wave_right/cleo"]
    comparison = recognizer.compare([query], support)
    assert comparison.labels.tolist() == ["squat", "wave"]
    ranking = recognizer.classify(query, support).ranking
    assert [place.label for place in ranking] == ["wave", "squat"]
    for place, column in zip(ranking, (1, 0), strict=True):
        assert place.distance == comparison.distance[0, column]
        assert place.probability == comparison.probability[0, column]
        assert place.confidence == comparison.confidence[0, column]
    assert sum(place.probability for place in ranking) == pytest.approx(1, abs=1e-6)


def test_without_actions_or_examples_there_is_no_decision(recognizer: Recognizer) -> None:
    none = recognizer.embed([])
    with pytest.raises(SupportError, match=r"^the support set is empty; enrol an action first\.$"):
        recognizer.compare(none, {})
    with pytest.raises(SupportError, match=r"^the action 'wave' has no examples\.$"):
        recognizer.compare(none, {"wave": []})


def test_no_clips_have_embeddings_too(recognizer: Recognizer) -> None:
    empty = recognizer.embed([])
    assert empty.shape[0] == 0
    assert empty.shape[1:] == recognizer.cohort.shape[1:]
    assert empty.dtype == np.float32


def test_weights_come_from_the_path_that_is_given(tmp_path: Path, recognizer: Recognizer) -> None:
    with pytest.raises(WeightsError, match=r"none\.safetensors"):
        Recognizer(tmp_path / "none.safetensors")
    assert Recognizer(recognizer.weights).weights is recognizer.weights


def test_examples_are_embeddings_or_clips(
    recognizer: Recognizer, clips: dict[str, Clip], support: dict[str, list[Clip]]
) -> None:
    query = [clips["wave_right/cleo"]]
    of_clips = recognizer.compare(query, support)
    mixed = {"squat": support["squat"], "wave": recognizer.embed(support["wave"])}
    np.testing.assert_array_equal(recognizer.compare(query, mixed).distance, of_clips.distance)


def test_probabilities_are_odds_divided_by_their_sum(
    recognizer: Recognizer, clips: dict[str, Clip], support: dict[str, list[Clip]]
) -> None:
    comparison = recognizer.compare([clips["wave_right/cleo"]], support)
    odds = 1 / comparison.distance
    np.testing.assert_allclose(comparison.probability, odds / odds.sum(), rtol=1e-4)
    np.testing.assert_allclose(comparison.confidence, 1 / (1 + comparison.distance), rtol=1e-4)


PAPER = ModelConfig(width=16, key_width=8, tuple_width=4)


def untrained() -> Recognizer:
    """A model of the paper, small."""
    rng = np.random.default_rng(0)
    tensors = {
        name: rng.normal(0, 0.3, shape).astype(np.float32)
        for name, shape in parameter_shapes(PAPER).items()
    }
    return Recognizer(Weights(PAPER, tensors, {}, "", Path("paper.safetensors")))


def test_probabilities_of_the_paper_are_the_softmax_of_distances(
    clips: dict[str, Clip], support: dict[str, list[Clip]]
) -> None:
    comparison = untrained().compare([clips["wave_right/cleo"]], support)
    weights = np.exp(-comparison.distance)
    np.testing.assert_allclose(comparison.probability, weights / weights.sum(), rtol=1e-4)
    # The discriminator is another opinion, which the distance does not tell.
    assert (abs(comparison.confidence - 1 / (1 + comparison.distance)) > 0.01).all()


@pytest.mark.parametrize("part", ["disc", "psi"])
def test_a_score_that_is_no_number_is_an_error(
    clips: dict[str, Clip], support: dict[str, list[Clip]], part: str
) -> None:
    sick = untrained()
    for name, tensor in sick.weights.tensors.items():
        if name.startswith(part):
            tensor[...] = np.nan
    message = r"^paper\.safetensors: gives scores that are no numbers; train again\.$"
    with pytest.raises(WeightsError, match=message):
        sick.compare([clips["wave_right/cleo"]], support)


class OnALine(Recognizer):
    """The real rules, over a model of which everything is known.

    A clip has a place on a line, the middle of its time unless `place` says otherwise; an
    embedding (N, 1, 1) is a place, an action is at the mean place of its examples, and the
    distance is how far apart places are. Confidence is 1 / (1 + distance): distances are odds.
    """

    def __init__(self, place: Callable[[Clip], float] | None = None, odds: bool = True) -> None:
        super().__init__(Weights(PartsConfig() if odds else ModelConfig(), {}, {}, "", Path()))
        self.place = place or middle

    def embed(self, clips: Sequence[Clip] | FloatArray) -> FloatArray:
        return clips if isinstance(clips, np.ndarray) else at(*map(self.place, clips))

    def compare(
        self,
        queries: Sequence[Clip] | FloatArray,
        support: Mapping[str, Sequence[Clip] | FloatArray],
    ) -> Comparison:
        actions = np.array([self.embed(each).mean() for each in support.values()])
        distance = abs(self.embed(queries)[:, 0] - actions.astype(np.float32))
        return Comparison(
            labels=np.array(list(support)),
            distance=distance,
            confidence=1 / (1 + distance),
            probability=softmax(-distance),
        )


def middle(clip: Clip) -> float:
    return clip.start + clip.duration / 2


def at(*places: float) -> FloatArray:
    return np.array(places, np.float32).reshape(-1, 1, 1)


def moving(seconds: float, start: float = 2.0) -> Clip:
    joints = np.random.default_rng(0).random((round(10 * seconds) + 1, 2, 3))
    return Clip(joints, ("left_wrist", "right_wrist"), 10, notes=("as read",), start=start)


# A whole of 12 s in the middle of which, at 8 s, nothing enrolled is, and its windows.
LONG = moving(12)
LASTING = (2.0,)
PARTS = list(windows(LONG, LASTING))
ODDS = odds_factor(len(PARTS))


def time_of(clip: Clip) -> tuple[float, float]:
    return clip.start, clip.start + clip.duration


def test_the_nearest_action_is_accepted_where_confidence_exceeds_tau() -> None:
    support = {"far": at(5.0), "near": at(0.5, 1.5)}
    (query,) = at(2.0)
    at_tau = OnALine().classify(query, support)
    assert (at_tau.accepted, at_tau.label, at_tau.nearest) == (False, None, "near")
    assert (at_tau.confidence, DEFAULT_TAU, at_tau.negative_is_nearer) == (0.5, 0.5, False)
    assert (at_tau.notes, at_tau.nearest_negative, at_tau.part) == ((), None, None)
    below = OnALine().classify(query, support, tau=0.499)
    assert (below.accepted, below.label, below.tau) == (True, "near", 0.499)
    near, far = below.ranking
    assert (near.label, near.distance, near.confidence) == ("near", 1.0, 0.5)
    assert (far.label, far.distance, far.confidence) == ("far", 3.0, 0.25)
    assert near.probability == pytest.approx(1 / (1 + np.exp(-2)))


def test_equally_near_actions_are_ranked_as_they_were_enrolled() -> None:
    places = {f"action {n}": float(n % 3) for n in range(60)}
    support = {label: at(place) for label, place in places.items()}
    ranking = OnALine().classify(at(-1.0)[0], support).ranking
    assert [each.label for each in ranking] == sorted(places, key=lambda label: places[label])


def test_many_queries_are_decided_each_by_itself() -> None:
    recognizer = OnALine()
    support = {"early": at(2.5), "late": at(13.0)}
    told = {"negatives": at(12.75), "durations": LASTING}
    clips = [LONG, moving(1), moving(1, start=12.4), LONG, moving(11, start=4)]
    assert recognizer.classify_all(clips, support, 0.4, **told) == [
        recognizer.classify(clip, support, 0.4, **told) for clip in clips
    ]
    queries = at(2.0, 13.0, 12.8, 7.0)
    found = recognizer.classify_all(queries, support, 0.4, at(12.75))
    assert found == [recognizer.classify(query, support, 0.4, at(12.75)) for query in queries]
    assert [each.label for each in found] == ["early", "late", None, None]
    assert recognizer.classify_all([], support) == []


def test_decisions_do_not_depend_on_how_much_is_compared_at_a_time(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    support = {"early": at(2.5), "late": at(13.0)}
    clips = [LONG, moving(1), moving(11, start=4)]
    together = OnALine().classify_all(clips, support, 0.4, at(12.75), LASTING)
    most: list[int] = []
    frames: list[int] = []

    class Watched(OnALine):
        def embed(self, clips: Sequence[Clip] | FloatArray) -> FloatArray:
            if not isinstance(clips, np.ndarray):
                most.append(len(clips))
                frames.append(sum(map(len, clips)))
            return super().embed(clips)

    def in_pieces(limit: str, number: int) -> None:
        del most[:], frames[:]
        with monkeypatch.context() as patch:
            patch.setattr(f"actioncli.recognition.recognizer.{limit}", number)
            found = Watched().classify_all(clips, support, 0.4, at(12.75), LASTING)
        assert found == together

    in_pieces("_AT_ONCE", 7)
    assert max(most) == 7
    # A block ends with the clip that makes it as large as that.
    in_pieces("_FRAMES_AT_ONCE", len(LONG))
    assert most[0] == 1
    in_pieces("_FRAMES_AT_ONCE", len(LONG) + 1)
    assert most[0] == 2
    in_pieces("_FRAMES_AT_ONCE", len(PARTS[0]) + 1)
    assert most[:2] == [1, 2]
    assert frames[1] == len(PARTS[0]) + len(PARTS[1])


def test_how_far_it_is_is_told_after_each_block(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("actioncli.recognition.recognizer._AT_ONCE", 7)
    seen: list[tuple[int, int]] = []
    clips, support = [LONG, moving(1)], {"early": at(2.5)}
    OnALine().classify_all(
        clips, support, durations=LASTING, progress=lambda *counts: seen.append(counts)
    )
    compared = len(PARTS) + 2
    # Whole clips come first.
    assert seen == [(done, compared) for done in [*range(2, compared, 7), compared]]


def test_of_a_long_clip_the_surest_window_decides_at_longer_odds() -> None:
    first = PARTS[0]
    support = {"late": at(20.0), "early": at(middle(first) - 0.25)}
    decision = OnALine().classify(LONG, support, durations=LASTING)
    assert (decision.label, decision.part) == ("early", time_of(first))
    assert decision.notes == (
        "as read",
        f"matched 2.0 s to 3.4 s, the surest of {len(PARTS)} windows",
    )
    assert decision.nearest_negative is None
    early, late = decision.ranking
    assert early.distance == pytest.approx(0.25 * ODDS)
    assert late.distance == pytest.approx((20 - middle(first)) * ODDS)
    assert early.confidence == decision.confidence == pytest.approx(1 / (1 + 0.25 * ODDS))
    assert late.confidence == pytest.approx(1 / (1 + late.distance))
    # Among the enrolled ones the number of windows changes nothing.
    apart = 20 - middle(first) - 0.25
    assert early.probability == pytest.approx(1 / (1 + np.exp(-apart)))


def test_distances_that_are_no_odds_stay_as_they_are() -> None:
    support = {"early": at(middle(PARTS[0]) - 0.25)}
    decision = OnALine(odds=False).classify(LONG, support, 0.1, at(14.0), LASTING)
    assert (decision.label, decision.part) == ("early", time_of(PARTS[0]))
    assert decision.ranking[0].distance == pytest.approx(0.25)
    assert decision.confidence == pytest.approx(1 / (1 + 0.25 * ODDS))
    assert decision.nearest_negative == pytest.approx(14 - middle(PARTS[0]))


def test_windows_must_be_surer_than_the_whole() -> None:
    decision = OnALine().classify(LONG, {"all": at(8.0)}, durations=LASTING)
    assert (decision.part, decision.notes) == ((2.0, 14.0), ("as read",))
    assert decision.ranking[0].distance == 0


def test_the_first_of_equally_sure_windows_decides() -> None:
    # Windows are at 1, 2 or 3, the whole at 50.
    def place(clip: Clip) -> float:
        return 50.0 if clip is LONG else 3.0 - round(clip.start * 10) % 3

    decision = OnALine(place).classify(LONG, {"zero": at(0.0)}, durations=LASTING)
    first = next(part for part in PARTS if place(part) == 1)
    assert sum(place(part) == 1 for part in PARTS) > 10
    assert decision.part == time_of(first)


def test_durations_tell_whether_a_clip_is_long() -> None:
    recognizer = OnALine()
    early = moving(2, start=2.0)
    whole, first = (2.0, 14.0), recognizer.classify(LONG, {"early": [early]}).part
    assert first == recognizer.classify(LONG, {"early": at(3.0)}, durations=LASTING).part
    assert first != whole
    # Clips alone tell how long they are, unless all durations are given.
    assert recognizer.classify(LONG, {"late": at(20.0), "early": [early]}).part == first
    assert recognizer.classify(LONG, {"early": [early]}, durations=()).part == whole
    assert recognizer.classify(LONG, {"early": at(3.0)}).part == whole
    assert recognizer.classify(LONG, {"early": [early]}, durations=[12.0]).part == whole


def test_the_nearest_negative_rejects_if_it_is_nearer_than_the_action() -> None:
    recognizer, support = OnALine(), {"wave": at(1.0)}
    clip = moving(1, start=1.5)
    decision = recognizer.classify(clip, support, 0.1, at(9.0, 2.5, 7.0))
    assert (decision.label, decision.accepted, decision.negative_is_nearer) == (None, False, True)
    assert (decision.nearest, decision.confidence, decision.nearest_negative) == ("wave", 0.5, 0.5)
    assert decision.part == (1.5, 2.5)
    assert decision.notes == (
        "as read",
        "nearer to a negative (distance 0.50) than to 'wave' (1.00)",
    )
    tied = recognizer.classify(clip, support, 0.1, [moving(1, start=2.5), moving(1, start=8)])
    assert (tied.label, tied.negative_is_nearer, tied.nearest_negative) == ("wave", False, 1.0)
    assert tied.notes == ("as read",)
    farther = recognizer.classify(clip, support, 0.5, at(3.5))
    assert (farther.label, farther.accepted, farther.nearest_negative) == (None, False, 1.5)


@pytest.mark.parametrize("nothing", [[], at(), None])
def test_no_negatives_reject_nothing(nothing: Sequence[Clip] | FloatArray | None) -> None:
    decision = OnALine().classify(at(2.0)[0], {"wave": at(1.5)}, negatives=nothing)
    assert (decision.label, decision.nearest_negative) == ("wave", None)


def test_a_whole_that_is_taken_for_a_negative_has_no_windows() -> None:
    first = PARTS[0]
    support = {"early": at(middle(first) - 0.25)}
    # A confidence of one half that the whole shows the negative: not above tau, and above it.
    window = OnALine().classify(LONG, support, 0.5, at(9.0), LASTING)
    assert (window.label, window.part) == ("early", time_of(first))
    assert window.nearest_negative == pytest.approx((9 - middle(first)) * ODDS)
    whole = OnALine().classify(LONG, support, 0.499, at(9.0), LASTING)
    assert (whole.label, whole.negative_is_nearer, whole.part) == (None, True, (2.0, 14.0))
    assert whole.nearest_negative == 1.0
    assert whole.ranking[0].distance == pytest.approx(8 - middle(first) + 0.25)


def test_a_negative_that_is_farther_than_an_action_keeps_no_window_out() -> None:
    part = min((part for part in PARTS if middle(part) > 8.05), key=middle)
    apart = middle(part) - 8
    negative = at(8 - 1.5 * apart)
    decision = OnALine().classify(LONG, {"centre": at(middle(part))}, 0.5, negative, LASTING)
    assert 1 / (1 + 1.5 * apart) > 0.5
    assert (decision.label, decision.part) == ("centre", time_of(part))


def test_windows_like_a_negative_are_left_out() -> None:
    first, last = PARTS[0], max(PARTS, key=middle)
    support = {"early": at(middle(first) - 0.25), "late": at(middle(last) + 0.4)}
    negative = at(middle(first))
    decision = OnALine().classify(LONG, support, 0.4, negative, LASTING)
    assert (decision.label, decision.part) == ("late", time_of(last))
    assert decision.nearest_negative == pytest.approx((middle(last) - middle(first)) * ODDS)
    # Where none is left, the whole decides.
    del support["late"]
    whole = OnALine().classify(LONG, support, 0.4, negative, LASTING)
    assert (whole.accepted, whole.negative_is_nearer, whole.part) == (False, True, (2.0, 14.0))
    assert whole.nearest_negative == pytest.approx(8 - middle(first))


@pytest.mark.parametrize("away", [0.1, 0.3, 0.7, 1.1, 1.3])
def test_windows_as_near_to_a_negative_as_to_the_action_are_kept(away: float) -> None:
    first = PARTS[0]
    place = at(middle(first) - away)
    decision = OnALine().classify(LONG, {"early": place}, 0.1, place, LASTING)
    assert (decision.label, decision.part) == ("early", time_of(first))
    assert decision.nearest_negative == decision.ranking[0].distance


def test_a_path_in_a_clips_place_is_told(clips: dict[str, Clip]) -> None:
    query: Any = "query.npz"
    with pytest.raises(UsageError, match="read it first"):
        Recognizer().classify_all([query], {"squat": [clips["squat/ada"]]})
