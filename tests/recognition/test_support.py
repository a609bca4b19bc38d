from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from actioncli.clips.read import read_clip
from actioncli.errors import StoreError, SupportError
from actioncli.recognition.recognizer import DEFAULT_TAU, Recognizer
from actioncli.recognition.support import read_enrolment, stored_negatives, used_threshold
from actioncli.recognition.threshold import Threshold, keep_threshold
from actioncli.store.store import SupportStore

EXAMPLES = Path(__file__).parents[1] / "examples"


@pytest.fixture(scope="module")
def recognizer() -> Recognizer:
    return Recognizer()


@pytest.fixture
def store(tmp_path: Path) -> SupportStore:
    store = SupportStore(tmp_path / "support.db")
    for label in ("wave_right", "squat"):
        store.enroll_all([(label, read_clip(f)) for f in sorted((EXAMPLES / label).glob("*.npz"))])
    return store


def test_what_is_enrolled(store: SupportStore, recognizer: Recognizer) -> None:
    punch = read_clip(EXAMPLES / "punch_right" / "dev.npz")
    store.enroll("noise", punch, negative=True)
    found = read_enrolment(store, recognizer)
    assert list(found.support) == ["squat", "wave_right"]
    clips = store.support()
    for label, embeddings in found.support.items():
        np.testing.assert_array_equal(
            embeddings, np.concatenate([recognizer.embed([clip]) for clip in clips[label]])
        )
    np.testing.assert_array_equal(found.negatives, recognizer.embed([punch]))
    # Nothing is embedded a second time with these weights.
    for negative in (False, True):
        store.embeddings(
            recognizer.weights.checksum, lambda _: pytest.fail("embedded again"), negative
        )
    # In the order of the actions, and without the negatives.
    assert found.durations == [
        pytest.approx(np.mean([clip.duration for clip in clips[label]]))
        for label in ("squat", "wave_right")
    ]
    assert (found.threshold, found.kept) == (
        Threshold(DEFAULT_TAU, recognizer.weights.checksum),
        None,
    )


def test_no_negatives_are_none_of_the_right_shape(
    store: SupportStore, recognizer: Recognizer
) -> None:
    negatives = stored_negatives(store, recognizer)
    assert negatives.shape == (0, *recognizer.embed(store.support()["squat"]).shape[1:])


def test_a_threshold_counts_for_the_weights_that_it_was_measured_with(
    store: SupportStore, recognizer: Recognizer
) -> None:
    measured = Threshold(0.7, recognizer.weights.checksum, {"squat": 0.6})
    keep_threshold(store, measured)
    threshold, kept = used_threshold(store, recognizer)
    assert threshold is kept
    found = read_enrolment(store, recognizer)
    assert (found.threshold, found.kept, found.foreign) == (measured, measured, None)
    foreign = Threshold(0.9, "others", {"squat": 0.8})
    keep_threshold(store, foreign)
    assert used_threshold(store, recognizer) == (
        Threshold(DEFAULT_TAU, recognizer.weights.checksum),
        foreign,
    )
    found = read_enrolment(store, recognizer)
    assert found.kept is found.foreign
    assert found.foreign == foreign


def test_tau_wins_over_what_is_kept(store: SupportStore, recognizer: Recognizer) -> None:
    measured = Threshold(0.7, recognizer.weights.checksum, {"squat": 0.6})
    keep_threshold(store, measured)
    for tau in (0.0, 0.2):
        found = read_enrolment(store, recognizer, tau)
        assert found.threshold == Threshold(tau, recognizer.weights.checksum)
        assert found.kept is found.foreign is None


def test_nothing_enrolled(tmp_path: Path, recognizer: Recognizer) -> None:
    store = SupportStore(tmp_path / "support.db")
    told = "^the support set is empty; enrol an action first: actioncli enroll LABEL CLIP$"
    with pytest.raises(SupportError, match=told):
        read_enrolment(store, recognizer)
    store.enroll("noise", read_clip(EXAMPLES / "punch_right" / "dev.npz"), negative=True)
    with pytest.raises(SupportError, match="empty"):
        read_enrolment(store, recognizer)


def test_a_damaged_threshold_is_told(store: SupportStore, recognizer: Recognizer) -> None:
    store.set_setting("threshold", "{}")
    with pytest.raises(StoreError, match="damaged"):
        read_enrolment(store, recognizer)
    assert read_enrolment(store, recognizer, 0.2).threshold.tau == 0.2
