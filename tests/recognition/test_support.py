"""The support set: one snapshot of a store, or clips in memory, that decides."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from actioncli import (
    Clip,
    Recognizer,
    StoreError,
    SupportError,
    SupportSet,
    SupportStore,
    read_clip,
)
from actioncli.recognition.threshold import DEFAULT_TAU, Threshold, keep_threshold

EXAMPLES = Path(__file__).parents[2] / "examples"
PUNCH = read_clip(EXAMPLES / "punch_right/dev.npz")
QUERY = read_clip(EXAMPLES / "squat/ben.npz")


@pytest.fixture
def store(tmp_path: Path) -> SupportStore:
    store = SupportStore(tmp_path / "support.db")
    for label in ("wave_right", "squat"):
        store.enroll_all([(label, read_clip(f)) for f in sorted((EXAMPLES / label).glob("*.npz"))])
    return store


def test_what_is_enrolled(store: SupportStore, recognizer: Recognizer) -> None:
    store.enroll("noise", PUNCH, negative=True)
    before = store.path.read_bytes()
    found = SupportSet.load(store, recognizer)
    # In the order of the labels; nothing had an embedding, and nothing was written.
    assert list(found.actions) == list(found.durations) == ["squat", "wave_right"]
    assert found.recomputed.keys() == {each.id for each in found.examples}
    assert store.path.read_bytes() == before
    clips = store.support()
    for label, embeddings in found.actions.items():
        np.testing.assert_array_equal(
            embeddings, np.concatenate([recognizer.embed([clip]) for clip in clips[label]])
        )
        mean = np.mean([clip.duration for clip in clips[label]])
        assert found.durations[label] == pytest.approx(mean)
    np.testing.assert_array_equal(found.negatives, recognizer.embed([PUNCH]))
    assert found.threshold == Threshold(DEFAULT_TAU, recognizer.weights.checksum)
    assert found.stored_threshold is found.foreign_threshold is None
    # What the store holds for these weights is not embedded again.
    store.keep_embeddings(recognizer.weights.checksum, found.recomputed)
    again = SupportSet.load(store.path, recognizer)
    assert again.recomputed == {}
    np.testing.assert_array_equal(again.actions["squat"], found.actions["squat"])
    assert again.classify(QUERY) == found.classify(QUERY)


def test_clips_in_memory_decide_as_a_store_does(
    store: SupportStore, recognizer: Recognizer
) -> None:
    store.enroll("noise", PUNCH, negative=True)
    stored = SupportSet.load(store, recognizer, tau=0.3)
    clips = store.support()
    given = SupportSet.from_clips(clips, recognizer, 0.3, [PUNCH])
    assert given.durations == pytest.approx(stored.durations)
    # The store lists actions by name, and clips may come in any order.
    decided = given.classify(QUERY)
    for other in (stored.classify(QUERY), recognizer.classify(QUERY, clips, 0.3, [PUNCH])):
        assert other.label == decided.label
        for one, two in zip(decided.ranking, other.ranking, strict=True):
            assert one.label == two.label
            # Sums of floats depend on what is added up beside them.
            assert one.confidence == pytest.approx(two.confidence, rel=1e-5)
    assert not given.classify(PUNCH).accepted
    embedded = given.classify_all(recognizer.embed([QUERY, PUNCH]))
    assert [each.label for each in embedded] == ["squat", None]
    assert given.with_tau(1).classify(QUERY).tau == 1
    assert SupportSet.from_clips(clips, recognizer).negatives.shape == recognizer.embed([]).shape


def test_a_whole_clip_has_no_windows(store: SupportStore, recognizer: Recognizer) -> None:
    support = SupportSet.load(store, recognizer)
    joints = np.concatenate([PUNCH.joints, QUERY.joints, PUNCH.joints])
    clip = Clip(joints, QUERY.joint_names, QUERY.fps)
    assert support.classify(clip).part != (0, clip.duration)
    assert support.classify(clip, whole=True).part == (0, clip.duration)


def test_a_threshold_counts_for_the_weights_that_it_was_measured_with(
    store: SupportStore, recognizer: Recognizer
) -> None:
    measured = Threshold(0.7, recognizer.weights.checksum, {"squat": 0.6})
    keep_threshold(store, measured)
    found = SupportSet.load(store, recognizer)
    assert found.threshold == found.stored_threshold == measured
    assert found.foreign_threshold is None
    assert found.classify(QUERY).tau == 0.6
    foreign = Threshold(0.9, "others", {"squat": 0.8})
    keep_threshold(store, foreign)
    found = SupportSet.load(store, recognizer)
    assert found.threshold == Threshold(DEFAULT_TAU, recognizer.weights.checksum)
    assert found.stored_threshold == found.foreign_threshold == foreign


def test_the_users_tau_counts_where_none_was_measured(
    store: SupportStore, recognizer: Recognizer, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("ACTIONCLI_TAU", "0.65")
    assert SupportSet.load(store, recognizer).threshold.tau == 0.65
    assert SupportSet.load(store, recognizer, 0.2).threshold.tau == 0.2
    keep_threshold(store, Threshold(0.3, recognizer.weights.checksum))
    assert SupportSet.load(store, recognizer).threshold.tau == 0.3


@pytest.mark.parametrize("tau", [0.0, 0.2])
def test_tau_wins_over_what_is_kept(
    store: SupportStore, recognizer: Recognizer, tau: float
) -> None:
    keep_threshold(store, Threshold(0.7, recognizer.weights.checksum, {"squat": 0.6}))
    found = SupportSet.load(store, recognizer, tau)
    assert found.threshold == Threshold(tau, recognizer.weights.checksum)
    assert found.stored_threshold is found.foreign_threshold is None


def test_nothing_enrolled(tmp_path: Path, recognizer: Recognizer) -> None:
    store = SupportStore(tmp_path / "support.db")
    message = "^the support set is empty; enrol an action first: actioncli enroll LABEL CLIP$"
    with pytest.raises(SupportError, match=message):
        SupportSet.load(store, recognizer).classify(QUERY)
    store.enroll("noise", PUNCH, negative=True)
    with pytest.raises(SupportError, match="empty"):
        SupportSet.load(store, recognizer).require_actions()


def test_a_damaged_threshold_is_an_error_unless_tau_is_given(
    store: SupportStore, recognizer: Recognizer
) -> None:
    store.set_setting("threshold", "{}")
    with pytest.raises(StoreError, match="damaged"):
        SupportSet.load(store, recognizer)
    assert SupportSet.load(store, recognizer, 0.2).threshold.tau == 0.2
