"""Embeddings: written by who enrols, read by who asks, never stale, never in the way."""

import sqlite3
from contextlib import closing

import numpy as np
import pytest
from storing import alter, make_clip

from actioncli.clips.clip import Clip, FloatArray
from actioncli.errors import StoreError
from actioncli.store.cache import REVISION
from actioncli.store.store import SupportStore


def embedded(clip: Clip, factor: float = 1.0) -> FloatArray:
    """(4, 12): the first frames, scaled."""
    return clip.joints[:4].reshape(4, -1) * np.float32(factor)


def enroll(store: SupportStore, *seeds: int, label: str = "wave", weights: str = "w") -> None:
    clips = [make_clip(seed) for seed in seeds]
    store.enroll_all(
        [(label, clip) for clip in clips],
        embeddings=[embedded(clip) for clip in clips],
        weights_checksum=weights,
    )


def rows(store: SupportStore) -> list[tuple[object, ...]]:
    with closing(sqlite3.connect(store.path)) as db:
        return db.execute("SELECT example, weights FROM embeddings ORDER BY example").fetchall()


def test_a_snapshot_brings_embeddings_and_the_clips_that_have_none(store: SupportStore) -> None:
    assert store.snapshot("w").examples == ()
    assert not store.path.exists()
    enroll(store, 0, 1)
    store.enroll("noise", make_clip(2), negative=True)
    store.set_setting("threshold", "0.3")
    before = store.path.stat()
    found = store.snapshot("w", ["threshold", "nothing"])
    assert [example.label for example in found.examples] == ["noise", "wave", "wave"]
    assert found.settings == {"threshold": "0.3"}
    assert sorted(found.embeddings) == [1, 2]
    for number in (1, 2):
        np.testing.assert_array_equal(found.embeddings[number], embedded(make_clip(number - 1)))
    assert sorted(found.clips) == [3]
    # Who asks writes nothing.
    after = store.path.stat()
    assert (before.st_mtime_ns, before.st_size) == (after.st_mtime_ns, after.st_size)


def test_other_weights_take_the_place_of_the_old(store: SupportStore) -> None:
    enroll(store, 0, 1, weights="old")
    assert sorted(store.snapshot("new").clips) == [1, 2]
    assert {row[1] for row in rows(store)} == {f"old {REVISION}"}
    store.keep_embeddings("new", {1: embedded(make_clip(0), 2)})
    assert rows(store) == [(1, f"new {REVISION}")]
    assert store.check() == []


def test_what_is_removed_is_forgotten_and_its_number_not_reused(store: SupportStore) -> None:
    enroll(store, 0, 1)
    store.remove("wave", 2)
    assert rows(store) == [(1, f"w {REVISION}")]
    # One that was removed while it was embedded.
    store.keep_embeddings("w", {2: embedded(make_clip(1))})
    assert len(rows(store)) == 1
    assert store.enroll("wave", make_clip(2)).example == 3


def test_a_renamed_label_keeps_its_embeddings_and_changes_whole_settings(
    store: SupportStore,
) -> None:
    enroll(store, 0)
    for name in ("whole", "damaged"):
        store.set_setting(name, "wave")
    alter(store.path, "UPDATE settings SET value = 'wbve' WHERE name = 'damaged'")
    store.rename("wave", "greet", dict.fromkeys(("whole", "damaged", "none"), str.upper))
    assert sorted(store.snapshot("w").embeddings) == [1]
    assert (store.setting("whole"), store.setting("none")) == ("WAVE", None)
    with pytest.raises(StoreError, match="calibrated damaged is damaged"):
        store.setting("damaged")


@pytest.mark.parametrize("change", ["data = zeroblob(length(data))", "width = 6, frames = 8"])
def test_a_damaged_embedding_is_not_used(store: SupportStore, change: str) -> None:
    enroll(store, 0)
    alter(store.path, f"UPDATE embeddings SET {change}")
    assert "embedding of example 1 is damaged" in store.check()[0]
    found = store.snapshot("w")
    assert (dict(found.embeddings), sorted(found.clips)) == ({}, [1])


def test_a_flipped_label_never_reaches_a_decision(store: SupportStore) -> None:
    """The embeddings that queries use are tied to their label."""
    enroll(store, 0)
    alter(store.path, "UPDATE examples SET label = 'wbve'")
    with pytest.raises(StoreError, match="example 1 of 'wbve' is damaged"):
        store.snapshot("w")
    with pytest.raises(StoreError, match="is damaged"):
        store.rename("wbve", "wave")
