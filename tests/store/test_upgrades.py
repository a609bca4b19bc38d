"""Stores of every schema that was ever shipped: today's code opens them, and decides the same."""

import hashlib
import json
import shutil
import sqlite3
from collections.abc import Callable
from contextlib import closing
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from storing import alter, as_ordinary_user, give_away

from actioncli import Recognizer, SupportSet, SupportStore, read_clip
from actioncli.errors import StoreError
from actioncli.recognition.threshold import Threshold, kept_threshold
from actioncli.store.migrations import MIGRATIONS

SCHEMAS = Path(__file__).with_name("schemas")
EXAMPLES = Path(__file__).parents[2] / "examples"
SHIPPED = sorted(SCHEMAS.glob("v*.db"), key=lambda path: int(path.stem[1:]))

Told = dict[str, Any]


@pytest.fixture(params=SHIPPED, ids=lambda path: path.stem)
def old(request: pytest.FixtureRequest, tmp_path: Path) -> tuple[SupportStore, Told]:
    """A store as an earlier release left it, and what that release said is in it."""
    path: Path = request.param
    store = SupportStore(tmp_path / "home" / "support.db")
    store.path.parent.mkdir(mode=0o700)
    shutil.copyfile(path, store.path)
    store.path.chmod(0o600)
    return store, json.loads(path.with_suffix(".json").read_text("utf-8"))


def version(path: Path) -> int:
    with closing(sqlite3.connect(path)) as db:
        return int(db.execute("PRAGMA user_version").fetchone()[0])


def holds_what_was_told(store: SupportStore, told: Told) -> None:
    assert [asdict(example) for example in store.examples()] == told["examples"]
    threshold = kept_threshold(store)
    assert threshold is not None
    # Whether enrolment chose it was not kept then.
    assert asdict(threshold) == {**told["threshold"], "automatic": False}


def test_every_schema_is_here() -> None:
    """`python tests/store/schemas/make.py` writes today's, which the next release must open."""
    assert [path.stem for path in SHIPPED] == [f"v{n + 1}" for n in range(len(MIGRATIONS))]
    for path in SHIPPED:
        assert version(path) == int(path.stem[1:])


@pytest.mark.parametrize(
    "first",
    [
        SupportStore.actions,
        SupportStore.support,
        SupportStore.negatives,
        lambda store: store.remove("wave"),
        lambda store: store.rename("wave", "wink"),
        lambda store: store.set_setting("other", "1"),
        lambda store: store.export(store.path.with_name("out.safetensors")),
        lambda store: store.snapshot("w"),
    ],
)
def test_whatever_is_done_first_brings_it_up_to_date(
    old: tuple[SupportStore, Told], first: Callable[[SupportStore], object]
) -> None:
    store, told = old
    first(store)
    assert version(store.path) == len(MIGRATIONS)
    assert store.check() == []
    assert len(told["examples"]) - len(store.examples()) in {0, 1}


def test_all_is_there(old: tuple[SupportStore, Told]) -> None:
    store, told = old
    holds_what_was_told(store, told)
    assert version(store.path) == len(MIGRATIONS)
    assert store.check() == []
    holds_what_was_told(store, told)


def test_decisions_are_those_of_the_recordings(old: tuple[SupportStore, Told]) -> None:
    store, _ = old
    recognizer = Recognizer()
    assert isinstance(kept_threshold(store), Threshold)
    by_store = SupportSet.load(store, recognizer).actions
    support = store.support()
    queries = [read_clip(EXAMPLES / f"{name}.npz") for name in ("squat/cleo", "bow/ben")]
    for query in queries:
        cached = recognizer.classify(query, by_store)
        direct = recognizer.classify(query, support)
        assert cached.nearest == direct.nearest
        assert cached.confidence == direct.confidence
    for label, clips in support.items():
        embedded = np.stack([recognizer.embed([clip])[0] for clip in clips])
        assert np.array_equal(by_store[label], embedded)


def test_an_old_store_that_cannot_be_written_is_read(
    old: tuple[SupportStore, Told], shared_folder: Path
) -> None:
    """A read-only folder, or a full disk, keeps nobody from what is in it."""
    before, told = old
    store = SupportStore(shared_folder / "home" / "support.db")
    store.path.parent.mkdir()
    shutil.copyfile(before.path, store.path)
    content = store.path.read_bytes()
    give_away(store.path.parent, store.path)
    store.path.chmod(0o400)
    store.path.parent.chmod(0o500)

    def read() -> None:
        holds_what_was_told(store, told)
        assert len(store.support()["squat"]) == 2
        with pytest.raises(StoreError, match="cannot be written"):
            store.remove("wave")
        with pytest.raises(StoreError, match="Permission denied"):
            SupportStore(store.path.with_name("other.db")).set_setting("a", "b")

    assert as_ordinary_user(read)
    store.path.parent.chmod(0o700)
    assert store.path.read_bytes() == content


def test_a_damaged_old_store_is_not_brought_up_to_date(old: tuple[SupportStore, Told]) -> None:
    """New seals over damaged rows would hide the damage."""
    store, told = old
    if told["schema"] == len(MIGRATIONS):
        pytest.skip("today's schema")
    content = bytearray(store.path.read_bytes())
    at = content.index(b"by the window") - len(b"wave") - 30
    at = content.index(b"wave", at)
    content[at] ^= 1
    store.path.write_bytes(content)
    with pytest.raises(StoreError, match="doctor --repair"):
        store.actions()
    assert store.path.read_bytes() == content


def test_a_newer_schema_is_refused_by_name(old: tuple[SupportStore, Told]) -> None:
    """Going back to an older release: it says so, and touches nothing."""
    store, _ = old
    alter(store.path, f"PRAGMA user_version = {len(MIGRATIONS) + 1}")
    before = hashlib.sha256(store.path.read_bytes()).digest()
    for use in (store.actions, store.clear, lambda: store.rename("wave", "wink")):
        with pytest.raises(StoreError, match=r"newer release .* Update actioncli"):
            use()
    assert hashlib.sha256(store.path.read_bytes()).digest() == before
