"""How a comparison becomes a decision: what is accepted, under which name, and why not."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from actioncli import Clip, Recognizer, SupportError, read_clip
from actioncli.recognizer import DEFAULT_TAU

EXAMPLES = Path(__file__).parent.parent / "examples"


@pytest.fixture(scope="module")
def recognizer() -> Recognizer:
    return Recognizer()


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


def test_the_nearest_action_is_accepted_above_tau_alone(
    recognizer: Recognizer, clips: dict[str, Clip], support: dict[str, list[Clip]]
) -> None:
    query = clips["wave_right/cleo"]
    decision = recognizer.classify(query, support)
    assert decision.tau == DEFAULT_TAU == 0.5
    assert (decision.label, decision.accepted, decision.nearest) == ("wave", True, "wave")
    assert decision.nearest_negative is None
    assert not decision.shadowed
    # Exactly at the confidence nothing is accepted, a hair below it is.
    at = recognizer.classify(query, support, tau=decision.confidence)
    assert (at.label, at.accepted, at.nearest) == (None, False, "wave")
    assert at.tau == decision.confidence
    below = recognizer.classify(query, support, tau=np.nextafter(decision.confidence, 0))
    assert (below.label, below.accepted) == ("wave", True)


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


def test_what_nobody_enrolled_is_rejected(
    recognizer: Recognizer, clips: dict[str, Clip], support: dict[str, list[Clip]]
) -> None:
    decision = recognizer.classify(clips["bow/ben"], support)
    assert (decision.label, decision.accepted) == (None, False)
    assert decision.nearest in support
    assert decision.confidence == decision.ranking[0].confidence <= 0.5


def test_a_nearer_negative_rejects_whatever_the_threshold(
    recognizer: Recognizer, clips: dict[str, Clip], support: dict[str, list[Clip]]
) -> None:
    query = clips["wave_right/cleo"]
    same = recognizer.classify(query, support, tau=0.0, negatives=[clips["bow/ben"], query])
    assert (same.label, same.accepted, same.shadowed) == (None, False, True)
    assert same.nearest == "wave"
    assert same.nearest_negative is not None
    assert same.nearest_negative < same.ranking[0].distance
    assert any("nearer to a negative" in note and "'wave'" in note for note in same.notes)
    far = recognizer.classify(query, support, negatives=[clips["bow/ben"]])
    assert (far.label, far.accepted, far.shadowed) == ("wave", True, False)
    assert far.nearest_negative is not None
    assert far.nearest_negative > far.ranking[0].distance
    assert not any("negative" in note for note in far.notes)


def test_as_far_from_a_negative_as_from_the_action_is_no_rejection(
    recognizer: Recognizer, clips: dict[str, Clip], support: dict[str, list[Clip]]
) -> None:
    tied = recognizer.classify(
        clips["wave_right/cleo"], support, negatives=[clips["wave_right/ada"]]
    )
    assert tied.nearest_negative == pytest.approx(tied.ranking[0].distance)
    assert tied.accepted is not tied.shadowed


def test_embeddings_decide_like_their_clips(
    recognizer: Recognizer, clips: dict[str, Clip], support: dict[str, list[Clip]]
) -> None:
    query = clips["wave_right/cleo"]
    embedded = {label: recognizer.embed(each) for label, each in support.items()}
    of_clips = recognizer.classify(query, support)
    of_arrays = recognizer.classify(recognizer.embed([query])[0], embedded)
    assert of_arrays.label == of_clips.label
    assert of_arrays.confidence == pytest.approx(of_clips.confidence, abs=1e-6)
    assert of_arrays.notes == ()


def test_notes_of_reading_stay_with_the_decision(
    recognizer: Recognizer, clips: dict[str, Clip], support: dict[str, list[Clip]]
) -> None:
    query = clips["wave_right/cleo"]
    assert query.notes
    assert recognizer.classify(query, support).notes[: len(query.notes)] == query.notes


def test_without_actions_or_examples_there_is_no_decision(
    recognizer: Recognizer, clips: dict[str, Clip]
) -> None:
    with pytest.raises(SupportError, match=r"^the support set is empty; enrol an action first\.$"):
        recognizer.compare([clips["bow/ben"]], {})
    with pytest.raises(SupportError, match=r"^the action 'wave' has no examples\.$"):
        recognizer.compare([clips["bow/ben"]], {"squat": [clips["squat/ada"]], "wave": []})


def test_no_clips_have_embeddings_too(recognizer: Recognizer) -> None:
    config = recognizer.weights.config
    empty = recognizer.embed([])
    assert empty.shape[0] == 0
    assert empty.shape[1:] == recognizer.cohort.shape[1:]
    assert empty.dtype == np.float32
    assert config.warp_width
