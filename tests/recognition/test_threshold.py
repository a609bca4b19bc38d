"""The threshold that is kept in the support set."""

import numpy as np
import pytest

from actioncli import Clip, StoreError, SupportStore
from actioncli.recognition.threshold import Threshold, keep_threshold, kept_threshold, rename_action


def test_it_is_kept_replaced_and_forgotten(store: SupportStore) -> None:
    assert kept_threshold(store) is None
    first = Threshold(0.625, "abc", {"a wave": 0.25, "ü": 1.0})
    keep_threshold(store, first)
    assert kept_threshold(store) == first
    keep_threshold(store, Threshold(0.5, "def"))
    assert kept_threshold(SupportStore(store.path)) == Threshold(0.5, "def", {})
    keep_threshold(store, None)
    assert kept_threshold(store) is None


def test_an_action_s_own_threshold_goes_with_its_name(store: SupportStore) -> None:
    rng = np.random.default_rng(0)
    for label in ("wave", "squat", "bow"):
        store.enroll(label, Clip(rng.normal(size=(20, 1, 3)), ["left_wrist"], 30))
    # `greet` was removed since it was measured.
    keep_threshold(store, Threshold(0.5, "abc", {"wave": 0.9, "greet": 0.1, "bow": 0.7}))
    for old, new, own in (
        ("wave", "wave", {"wave": 0.9, "greet": 0.1, "bow": 0.7}),
        ("wave", "greet", {"greet": 0.9, "bow": 0.7}),
        ("squat", "stand", {"greet": 0.9, "bow": 0.7}),
        ("greet", "wave", {"wave": 0.9, "bow": 0.7}),
    ):
        rename_action(store, old, new)
        assert kept_threshold(store) == Threshold(0.5, "abc", own)
    keep_threshold(store, Threshold(0.5, "abc", {"greet": 0.1}))
    rename_action(store, "wave", "greet")
    assert kept_threshold(store) == Threshold(0.5, "abc")
    assert store.check() == []


@pytest.mark.parametrize("text", ["", "[]", "{}", '{"actions": [1]}', "[" * 100_000])
def test_what_is_no_threshold_keeps_no_label_from_another_name(
    store: SupportStore, text: str
) -> None:
    store.enroll("wave", Clip(np.random.default_rng(0).random((20, 1, 3)), ["left_wrist"], 30))
    store.set_setting("threshold", text)
    assert rename_action(store, "wave", "greet") == 1
    with pytest.raises(StoreError, match="damaged"):
        kept_threshold(store)


def test_forgetting_creates_no_store(store: SupportStore) -> None:
    keep_threshold(store, None)
    assert not store.path.exists()


@pytest.mark.parametrize(
    "text",
    [
        "",
        "0.5",
        "[]",
        '{"tau": 0.5, "weights": "abc"}',
        '{"tau": 2, "weights": "abc", "actions": {}}',
        '{"tau": NaN, "weights": "abc", "actions": {}}',
        '{"tau": 0.5, "weights": "abc", "actions": {"wave": "high"}}',
        '{"tau": 0.5, "weights": "abc", "actions": [1]}',
    ],
)
def test_a_damaged_one_is_told_and_can_be_forgotten(store: SupportStore, text: str) -> None:
    store.set_setting("threshold", text)
    with pytest.raises(StoreError, match=r"damaged; `actioncli calibrate --reset` forgets it\.$"):
        kept_threshold(store)
    keep_threshold(store, None)
    assert kept_threshold(store) is None


def test_an_action_may_have_a_threshold_of_its_own() -> None:
    threshold = Threshold(0.5, "abc", {"wave": 0.8})
    assert (threshold.of("wave"), threshold.of("bow")) == (0.8, 0.5)
