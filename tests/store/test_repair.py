"""Repair: what comes back is what was enrolled, what is whole comes back, what is gone is told."""

from __future__ import annotations

import os
import random
import shutil
import sqlite3
import stat
import tempfile
from collections.abc import Iterator
from contextlib import closing, contextmanager
from pathlib import Path
from typing import BinaryIO

import pytest
from cases import cases
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from storing import as_ordinary_user, fork, give_away, make_clip, same, succeeded

from actioncli.clips.clip import Clip
from actioncli.errors import StoreError
from actioncli.recognition.threshold import Threshold, keep_threshold, kept_threshold
from actioncli.store.database import writing
from actioncli.store.migrations import MIGRATIONS
from actioncli.store.pages import Pages, Row
from actioncli.store.repair import Repair
from actioncli.store.store import Example, SupportStore

PAGE = 4096
SCHEMAS = Path(__file__).with_name("schemas")


@contextmanager
def temporary_store() -> Iterator[SupportStore]:
    """A store in memory where there is a file system for that: hypothesis makes many."""
    memory = Path("/dev/shm")
    folder = tempfile.mkdtemp(dir=memory if os.access(memory, os.W_OK) else None)
    try:
        yield SupportStore(Path(folder) / "home" / "support.db")
    finally:
        shutil.rmtree(folder)


def flip(store: SupportStore, seed: int, frames: int = 60) -> bytes:
    """Flip a bit of the recording that this seed made; the damaged file."""
    content = bytearray(store.path.read_bytes())
    joints = make_clip(seed, frames).joints.astype("<f4").tobytes()
    content[content.index(joints[-200:])] ^= 1
    store.path.write_bytes(content)
    return bytes(content)


class Truth:
    """A store with random content, and what is in it."""

    def __init__(self, store: SupportStore, seed: int) -> None:
        rng = random.Random(seed)
        self.store = store
        self.clips: dict[int, Clip] = {}
        for number in range(rng.randint(1, 10)):
            clip = make_clip(
                seed * 100 + number,
                rng.choice([2, 6, 40, 200]),
                rng.choice([1, 4, 30]),
                confidence=rng.random() < 0.4,
            )
            answer = store.enroll(f"action {rng.randrange(3)}", clip, note=f"note {number}")
            self.clips[answer.example] = clip
        store.enroll("noise", make_clip(seed * 100 + 99), negative=True)
        if len(self.clips) > 2:
            gone = rng.choice(sorted(self.clips))
            store.remove(next(e.label for e in store.examples() if e.id == gone), gone)
            del self.clips[gone]
        keep_threshold(store, Threshold(0.25, "w"))
        self.examples = {example.id: example for example in store.examples()}
        self.clips[max(self.examples)] = make_clip(seed * 100 + 99)
        self.content = store.path.read_bytes()

    def pages(self) -> dict[int, set[int]]:
        """The pages without which an example is not whole."""
        found: dict[int, set[int]] = {}
        for number in range(1, len(self.content) // PAGE + 1):
            changed = bytearray(self.content)
            changed[(number - 1) * PAGE : number * PAGE] = bytes(PAGE)
            for row in self.whole:
                after = [each for each in Pages(bytes(changed), PAGE).rows() if each == row]
                if not after:
                    found.setdefault(row.id, set()).add(number)
        return found

    @property
    def whole(self) -> list[Row]:
        """The rows of the examples."""
        return [row for row in Pages(self.content, PAGE).rows() if len(row.values) > 10]

    def compare(self, done: Repair | None) -> None:
        """All that is there is what was enrolled, to the last bit, and what is not is told."""
        assert self.store.check() == []
        found = {example.id: example for example in self.store.examples()}
        for number, example in found.items():
            assert same(self.store.clip(number), self.clips[number])
            expected = self.examples[number]
            if done and number in done.doubtful:
                expected = Example(**{**vars(expected), **told_beside(example)})
            assert example == expected
        kept = kept_threshold(self.store)
        assert kept is None or kept == Threshold(0.25, "w")
        if done is None:
            assert found.keys() == self.examples.keys()
            return
        assert done.labels == {number: example.label for number, example in found.items()}
        assert not found.keys() & {gone.id for gone in done.gone}
        if not done.settings_gone and done.complete:
            assert kept is not None
        # Numbers that were given once are not given again.
        later = self.store.enroll("later", make_clip(77)).example
        assert later > max(found, default=0)


def told_beside(example: Example) -> dict[str, str]:
    return {"source": example.source, "note": example.note, "added": example.added}


@settings(max_examples=cases(60), suppress_health_check=[HealthCheck.too_slow])
@given(seed=st.integers(0, 10_000), data=st.data())
def test_what_is_salvaged_is_what_was_enrolled(seed: int, data: st.DataObject) -> None:
    with temporary_store() as store:
        truth = Truth(store, seed)
        content = bytearray(truth.content)
        kind = data.draw(st.sampled_from(["bits", "cut", "zeros", "junk", "header", "shift"]))
        size = len(content)
        if kind == "bits":
            for _ in range(data.draw(st.integers(1, 30))):
                content[data.draw(st.integers(0, size - 1))] ^= 1 << data.draw(st.integers(0, 7))
        elif kind == "cut":
            del content[data.draw(st.integers(1, size - 1)) :]
        elif kind == "header":
            content[:100] = data.draw(st.binary(min_size=100, max_size=100))
        elif kind == "shift":
            # A page of another place, as a disk may return it.
            first, second = (data.draw(st.integers(0, size // PAGE - 1)) * PAGE for _ in "ab")
            content[first : first + PAGE] = truth.content[second : second + PAGE]
        else:
            start = data.draw(st.integers(0, size - 1))
            length = data.draw(st.integers(1, 3 * PAGE))
            junk = bytes(length) if kind == "zeros" else random.Random(seed).randbytes(length)
            content[start : start + length] = junk[: size - start]
        store.path.write_bytes(content)
        told = store.damage()
        if kind == "cut" and len(content) < 72:
            # Too little is left to say that it ever was a support set.
            with pytest.raises(StoreError, match="nothing of a support set"):
                store.repair()
            assert store.path.read_bytes() == content
            return
        done = store.repair()
        assert (done is None) == (told == [])
        if done:
            assert done.kept.read_bytes() == content
            assert stat.S_IMODE(done.kept.stat().st_mode) == 0o600
            assert stat.S_IMODE(store.path.stat().st_mode) == 0o600
        truth.compare(done)
        assert not list(store.path.parent.glob(".repair-*"))


def test_a_lost_table_of_settings_is_no_complete_account() -> None:
    """Cut behind the examples' index: the examples are named, of the settings nothing is known."""
    with temporary_store() as store:
        truth = Truth(store, 0)
        store.path.write_bytes(truth.content[: 3 * PAGE])
        done = store.repair()
        assert done is not None
        assert done.gone
        assert not done.complete
        truth.compare(done)


def test_a_threshold_is_a_sign_of_a_support_set() -> None:
    """The schema, the examples and the kind of their index's page are gone."""
    with temporary_store() as store:
        truth = Truth(store, 1)
        store.path.write_bytes(bytes(2 * PAGE + 1) + truth.content[2 * PAGE + 1 :])
        done = store.repair()
        assert done is not None
        assert (done.labels, done.complete) == ({}, False)
        assert kept_threshold(store) == Threshold(0.25, "w")
        truth.compare(done)


@pytest.mark.parametrize("name", ["x" * 244 + ".db", "手" * 81 + ".db"])
def test_the_longest_names_leave_room_for_the_damaged_file(tmp_path: Path, name: str) -> None:
    store = SupportStore(tmp_path / name)
    store.enroll("wave", make_clip(1))
    for _ in "ab":
        content = bytearray(store.path.read_bytes())
        content[-PAGE:] = bytes(PAGE)
        store.path.write_bytes(content)
        store.path.with_name(name + "-journal").write_bytes(b"no journal")
        done = store.repair()
        assert done is not None
        assert done.kept.read_bytes() == content
    assert store.check() == []


@pytest.mark.parametrize("seed", range(4))
def test_examples_on_whole_pages_are_salvaged(seed: int) -> None:
    """Every page in turn is filled with zeros: only what lies on it is lost, and named."""
    with temporary_store() as store:
        truth = Truth(store, seed)
        places = truth.pages()
        for number in range(1, len(truth.content) // PAGE + 1):
            content = bytearray(truth.content)
            content[(number - 1) * PAGE : number * PAGE] = bytes(PAGE)
            store.path.write_bytes(content)
            done = store.repair()
            lost = {example for example, pages in places.items() if number in pages}
            found = {example.id for example in store.examples()}
            assert found == truth.examples.keys() - lost
            if done is None:
                assert not lost  # a page that was free
            elif done.complete:
                named = {gone.id: gone.label for gone in done.gone}
                assert named == {example: truth.examples[example].label for example in lost}


def test_a_store_cut_at_any_page_gives_what_is_before(store: SupportStore) -> None:
    clips = [make_clip(seed, 60) for seed in range(6)]
    answers = store.enroll_all([("wave", clip) for clip in clips])
    whole = store.path.read_bytes()
    before = 0
    for size in range(PAGE, len(whole), PAGE):
        store.path.write_bytes(whole[:size])
        done = store.repair()
        if done is None:
            continue
        assert all(same(store.clip(number), clips[number - 1]) for number in done.labels)
        assert len(done.labels) >= before
        before = len(done.labels)
        if done.complete:
            assert len(done.gone) + len(done.labels) == len(answers)
    assert before == 5


def test_a_missing_header_costs_nothing(store: SupportStore) -> None:
    store.enroll_all([("wave", make_clip(seed, 60)) for seed in range(3)])
    content = bytearray(store.path.read_bytes())
    content[:100] = bytes(100)
    store.path.write_bytes(content)
    with pytest.raises(StoreError, match="doctor --repair"):
        store.actions()
    done = store.repair()
    assert done is not None
    assert (len(done.labels), done.gone, done.complete) == (3, (), True)


def test_flipped_labels_notes_and_thresholds_are_noticed(store: SupportStore) -> None:
    """What has no second copy is told to be doubtful or gone, never believed."""
    store.enroll("wave", make_clip(0), note="by the window")
    store.enroll("clap", make_clip(1))
    keep_threshold(store, Threshold(0.125, "w"))
    whole = store.path.read_bytes()

    def flipped(text: bytes, places: int) -> None:
        content = bytearray(whole)
        assert content.count(text) == places
        at = content.index(text) if places == 1 else content.rindex(text)
        content[at] ^= 2
        store.path.write_bytes(content)

    flipped(b"by the window", 1)
    assert any("example 1" in problem for problem in store.damage())
    with pytest.raises(StoreError, match="doctor --repair"):
        store.support()
    done = store.repair()
    assert done is not None
    assert (done.doubtful, done.gone) == ((1,), ())

    flipped(b"clap", 2)  # the label: in the table, and in the index
    assert store.damage()
    done = store.repair()
    assert done is not None
    assert "clap" in {*done.labels.values(), *(gone.label for gone in done.gone)}
    assert set(done.labels.values()) <= {"wave", "clap"}

    flipped(b"0.125", 1)
    assert any("threshold is damaged" in problem for problem in store.damage())
    with pytest.raises(StoreError, match="calibrate --reset"):
        kept_threshold(store)
    done = store.repair()
    assert done is not None
    assert done.settings_gone == ("threshold",)
    assert kept_threshold(store) is None


def test_a_flipped_label_never_reaches_a_decision(store: SupportStore) -> None:
    """The embeddings that queries use are tied to their label."""
    store.enroll("wave", make_clip(0))
    computed = []

    def embed(clips: list[Clip]) -> object:
        computed.append(len(clips))
        return clips[0].joints[None, :, :, 0]

    store.embeddings("w", embed)
    store.rename("wave", "clap")
    assert list(store.embeddings("w", embed)) == ["clap"]
    assert computed == [1]  # a new name costs no new embedding
    with closing(sqlite3.connect(store.path)) as db:
        db.execute("UPDATE examples SET label = 'clbp'")
        db.commit()
    with pytest.raises(StoreError, match="example 1 of 'clbp' is damaged"):
        store.embeddings("w", embed)
    with pytest.raises(StoreError, match="is damaged"):
        store.rename("clbp", "clap")


def test_an_interrupted_write_is_undone_before_repairing(store: SupportStore) -> None:
    """Damage and a journal at once: what was never acknowledged does not come back."""
    store.enroll("wave", make_clip(0, 60))
    store.enroll("clap", make_clip(1, 60))

    def die_while_writing() -> None:
        with writing(store.path) as db:
            db.execute("PRAGMA cache_spill = 1")
            db.execute("PRAGMA cache_size = 1")
            db.execute("UPDATE examples SET label = 'never', note = 'x' WHERE id = 1")
            db.execute("INSERT INTO settings VALUES ('never', hex(zeroblob(200000)), 0)")
            os.kill(os.getpid(), 9)

    assert not succeeded(fork(die_while_writing))
    journal = store.path.with_name("support.db-journal")
    assert journal.stat().st_size > 0
    content = flip(store, 1)
    interrupted = journal.read_bytes()
    done = store.repair()
    assert done is not None
    assert done.kept.read_bytes() == content
    assert done.kept.with_name(done.kept.name + "-journal").read_bytes() == interrupted
    assert not journal.exists()
    assert same(store.support()["wave"][0], make_clip(0, 60))
    assert [action.label for action in store.actions()] == ["wave"]
    assert store.setting("never") is None


def test_a_journal_that_is_none_is_put_aside(store: SupportStore) -> None:
    store.enroll_all([("wave", make_clip(seed, 60)) for seed in range(3)])
    flip(store, 0)
    journal = store.path.with_name("support.db-journal")
    journal.write_bytes(b"junk" * 1000)
    done = store.repair()
    assert done is not None
    assert len(done.labels) == 2
    assert not journal.exists()


def test_several_repairs_keep_several_files(store: SupportStore) -> None:
    store.enroll_all([("wave", make_clip(seed, 60)) for seed in range(3)])
    assert store.repair() is None
    for turn in range(2):
        flip(store, turn)
        done = store.repair()
        assert done is not None
        assert done.kept.name == ("support.db.damaged" if turn == 0 else "support.db.damaged-2")
    assert len(store.examples()) == 1


def test_an_interrupted_repair_leaves_no_part_of_the_damaged_file(
    store: SupportStore, monkeypatch: pytest.MonkeyPatch
) -> None:
    store.enroll_all([("wave", make_clip(seed, 60)) for seed in range(2)])
    content = flip(store, 0)
    copies = iter((False, True))

    def die_over_the_second(source: BinaryIO, target: BinaryIO) -> None:
        # The first one is examined, the second one is what will be kept.
        if next(copies):
            target.write(source.read(PAGE))
            target.flush()
            os._exit(1)
        target.write(source.read())

    monkeypatch.setattr(shutil, "copyfileobj", die_over_the_second)
    assert not succeeded(fork(store.repair))
    monkeypatch.undo()
    assert not list(store.path.parent.glob("*.damaged*"))
    assert store.path.read_bytes() == content
    done = store.repair()
    assert done is not None
    assert done.kept.name == "support.db.damaged"
    assert done.kept.read_bytes() == content


def test_repair_waits_for_nobody_who_writes(store: SupportStore) -> None:
    store.enroll("wave", make_clip(0, 60))
    content = flip(store, 0)
    receive, send = os.pipe()
    finish, end = os.pipe()

    def write() -> None:
        os.close(end)
        with writing(store.path) as db:
            db.execute("DELETE FROM settings")
            os.write(send, b"1")
            os.read(finish, 1)

    child = fork(write)
    os.read(receive, 1)
    with pytest.raises(StoreError, match="in use by another program"):
        store.repair()
    assert store.path.read_bytes() == content
    assert [f.name for f in store.path.parent.iterdir() if "damaged" in f.name] == []
    os.close(end)
    assert succeeded(child)
    assert store.repair() is not None


def test_a_writer_that_waited_writes_to_the_new_store(
    store: SupportStore, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Whoever opened the damaged file before it was replaced does not write to it after."""
    store.enroll("wave", make_clip(0))
    other = SupportStore(tmp_path / "other.db")
    other.enroll("clap", make_clip(1))
    from actioncli.store import database

    prepare = database.prepare
    turns = []

    def then_replace(path: Path) -> None:
        prepare(path)
        turns.append(path)

    look = database._file

    def replaced_after_the_first_look(path: Path) -> tuple[int, int] | None:
        seen = look(path)
        if len(turns) == 1 and other.path.exists():
            other.path.replace(path)
        return seen

    monkeypatch.setattr(database, "prepare", then_replace)
    monkeypatch.setattr(database, "_file", replaced_after_the_first_look)
    store.enroll("bow", make_clip(2))
    assert [action.label for action in store.actions()] == ["bow", "clap"]


def test_nothing_is_repaired_where_it_cannot_be_written(shared_folder: Path) -> None:
    store = SupportStore(shared_folder / "home" / "support.db")
    store.enroll("wave", make_clip(0, 60))
    content = flip(store, 0)
    give_away(store.path.parent, store.path)
    store.path.parent.chmod(0o500)

    def refused() -> None:
        with pytest.raises(StoreError, match="cannot be repaired: Permission denied"):
            store.repair()

    assert as_ordinary_user(refused)
    store.path.parent.chmod(0o700)
    assert store.path.read_bytes() == content
    assert [file.name for file in store.path.parent.iterdir()] == ["support.db"]


@pytest.mark.parametrize("content", [b"notes" * 3000, b"\0" * 20_000, b"SQLite format 3\0" * 500])
def test_what_is_no_support_set_is_left(tmp_path: Path, content: bytes) -> None:
    store = SupportStore(tmp_path / "notes.txt")
    store.path.write_bytes(content)
    with pytest.raises(StoreError, match="nothing of a support set was found"):
        store.repair()
    assert store.path.read_bytes() == content
    assert [file.name for file in tmp_path.iterdir()] == ["notes.txt"]


def test_a_version_and_a_schema_with_flipped_bits_are_not_newer() -> None:
    with temporary_store() as store:
        truth = Truth(store, 0)
        content = bytearray(truth.content)
        content[60] ^= 1  # of the version
        for number in range(3):
            content[content.index(b"joint_count") + number] ^= 1
        store.path.write_bytes(content)
        done = store.repair()
        assert done is not None
        assert done.labels
        truth.compare(done)


@pytest.mark.parametrize("column", ["type", "name", "tbl_name", "sql"])
def test_a_schema_in_which_a_text_has_become_bytes_is_mended(
    store: SupportStore, column: str
) -> None:
    """One flipped bit tells SQLite that the text of a record is bytes."""
    clip = make_clip(0)
    store.enroll("wave", clip)
    with closing(sqlite3.connect(store.path)) as db:
        db.execute("PRAGMA writable_schema = ON")
        changed = f"{column} = CAST({column} AS BLOB)"
        db.execute(f"UPDATE sqlite_master SET {changed} WHERE name = 'examples'")
        db.commit()
    assert store.damage()
    done = store.repair()
    assert done is not None
    assert done.labels == {1: "wave"}
    assert same(store.clip(1), clip)
    assert store.check() == []


def test_another_database_and_a_newer_one_are_left(store: SupportStore, tmp_path: Path) -> None:
    other = SupportStore(tmp_path / "places.db")
    with closing(sqlite3.connect(other.path)) as db:
        db.execute("CREATE TABLE bookmarks (url TEXT)")
        db.commit()
    with pytest.raises(StoreError, match="nothing of a support set was found"):
        other.repair()
    store.enroll("wave", make_clip(0))
    with closing(sqlite3.connect(store.path)) as db:
        db.execute("ALTER TABLE examples ADD COLUMN colour TEXT")
        db.execute(f"PRAGMA user_version = {len(MIGRATIONS) + 1}")
        db.commit()
    before = store.path.read_bytes()
    with pytest.raises(StoreError, match="newer release"):
        store.repair()
    assert store.path.read_bytes() == before


def test_a_version_that_is_a_flipped_bit_is_mended(store: SupportStore) -> None:
    store.enroll("wave", make_clip(0))
    with closing(sqlite3.connect(store.path)) as db:
        db.execute(f"PRAGMA user_version = {len(MIGRATIONS) ^ 64}")
        db.commit()
    done = store.repair()
    assert done is not None
    assert done.labels == {1: "wave"}
    assert store.check() == []


def test_a_damaged_store_of_the_first_schema_is_salvaged(tmp_path: Path) -> None:
    store = SupportStore(tmp_path / "support.db")
    whole = (SCHEMAS / "v1.db").read_bytes()
    store.path.write_bytes(whole)
    clips = {example.id: store.clip(example.id) for example in store.examples()}
    content = bytearray(whole)
    joints = clips[3].joints.astype("<f4").tobytes()
    content[content.index(joints[-64:])] ^= 1
    content[:16] = bytes(16)
    store.path.write_bytes(content)
    done = store.repair()
    assert done is not None
    assert sorted(done.labels) == sorted(clips.keys() - {3})
    assert [(gone.id, gone.label) for gone in done.gone] == [(3, "squat")]
    assert done.doubtful == ()
    for number in done.labels:
        assert same(store.clip(number), clips[number])
    assert store.check() == []
