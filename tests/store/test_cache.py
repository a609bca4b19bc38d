"""Cached embeddings: computed once, never stale, never in the way."""

from __future__ import annotations

import sqlite3
from collections.abc import Sequence
from contextlib import closing
from pathlib import Path

import numpy as np
import pytest
from storing import as_ordinary_user, give_away, make_clip

from actioncli.clips.clip import Clip, FloatArray
from actioncli.store.cache import REVISION
from actioncli.store.store import SupportStore


class Embedder:
    """Embeds a clip as its first frames, scaled; counts the clips."""

    def __init__(self, factor: float = 1.0) -> None:
        self.factor = factor
        self.clips = 0

    def __call__(self, clips: Sequence[Clip]) -> FloatArray:
        self.clips += len(clips)
        return np.stack(
            [clip.joints[:4].reshape(4, -1) * np.float32(self.factor) for clip in clips]
        )


def rows(store: SupportStore) -> list[tuple[object, ...]]:
    with closing(sqlite3.connect(store.path)) as db:
        return db.execute("SELECT example, weights FROM embeddings ORDER BY example").fetchall()


def test_embeddings_are_computed_once(store: SupportStore) -> None:
    assert store.embeddings("w", Embedder()) == {}
    assert not store.path.exists()
    for seed, label in enumerate(["wave", "clap", "wave"]):
        store.enroll(label, make_clip(seed))
    store.enroll("noise", make_clip(9), negative=True)
    embed = Embedder()
    first = store.embeddings("w", embed)
    assert embed.clips == 3
    assert list(first) == ["clap", "wave"]
    expected = embed([make_clip(0), make_clip(2)])
    assert first["wave"].dtype == np.float32
    np.testing.assert_array_equal(first["wave"], expected)

    embed = Embedder()
    again = store.embeddings("w", embed)
    assert embed.clips == 0
    assert list(again) == list(first)
    assert all(np.array_equal(again[label], first[label]) for label in first)

    store.enroll("clap", make_clip(3))
    assert store.embeddings("w", embed)["clap"].shape == (2, 4, 12)
    assert embed.clips == 1
    assert list(store.embeddings("w", embed, negative=True)) == ["noise"]
    assert embed.clips == 2
    assert len(rows(store)) == 5
    assert store.check() == []


def test_other_weights_take_the_place_of_the_old(store: SupportStore) -> None:
    store.enroll_all([("wave", make_clip(0)), ("wave", make_clip(1))])
    old = store.embeddings("old", Embedder())
    new = store.embeddings("new", Embedder(2))
    np.testing.assert_array_equal(new["wave"], old["wave"] * 2)
    assert {row[1] for row in rows(store)} == {f"new {REVISION}"}


def test_what_is_removed_is_forgotten_and_its_number_not_reused(store: SupportStore) -> None:
    store.enroll("wave", make_clip(0))
    last = store.enroll("wave", make_clip(1)).example
    store.embeddings("w", Embedder())
    store.remove("wave", last)
    assert len(rows(store)) == 1
    assert store.enroll("wave", make_clip(2)).example > last
    embed = Embedder()
    np.testing.assert_array_equal(
        store.embeddings("w", embed)["wave"][1], Embedder()([make_clip(2)])[0]
    )
    assert embed.clips == 1


def test_an_example_that_is_removed_meanwhile_is_not_kept(store: SupportStore) -> None:
    store.enroll_all([("wave", make_clip(0)), ("wave", make_clip(1))])

    def embed(clips: Sequence[Clip]) -> FloatArray:
        if store.examples():
            store.clear()
        return Embedder()(clips)

    assert store.embeddings("w", embed)["wave"].shape == (2, 4, 12)
    assert rows(store) == []
    assert store.check() == []


def test_a_renamed_label_keeps_its_embeddings(store: SupportStore) -> None:
    store.enroll("wave", make_clip(0))
    store.embeddings("w", Embedder())
    store.rename("wave", "greet")
    embed = Embedder()
    assert list(store.embeddings("w", embed)) == ["greet"]
    assert embed.clips == 0


@pytest.mark.parametrize("change", ["data = zeroblob(length(data))", "width = 6, frames = 8"])
def test_a_damaged_embedding_is_told_and_computed_again(store: SupportStore, change: str) -> None:
    store.enroll("wave", make_clip(0))
    whole = store.embeddings("w", Embedder())
    with closing(sqlite3.connect(store.path)) as db:
        db.execute(f"UPDATE embeddings SET {change}")
        db.commit()
    assert "embedding of example 1 is damaged" in store.check()[0]
    embed = Embedder()
    np.testing.assert_array_equal(store.embeddings("w", embed)["wave"], whole["wave"])
    assert embed.clips == 1
    assert store.check() == []


def test_a_store_that_cannot_be_written_still_answers(shared_folder: Path) -> None:
    store = SupportStore(shared_folder / "home" / "support.db")
    store.enroll("wave", make_clip(0))
    give_away(store.path.parent, store.path)
    store.path.parent.chmod(0o500)
    store.path.chmod(0o400)

    def answer() -> None:
        assert store.embeddings("w", Embedder())["wave"].shape == (1, 4, 12)

    assert as_ordinary_user(answer)
    assert rows(store) == []
