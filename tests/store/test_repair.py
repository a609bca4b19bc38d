"""Repair: what comes back is what was enrolled, what can be read or was copied comes back, what is
gone is said."""

import os
import random
import shutil
import stat
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import BinaryIO

import numpy as np
import pytest
from cases import cases
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from storing import alter, as_ordinary_user, fork, give_away, interrupt, make_clip, same, succeeded

from actioncli.clips.clip import Clip
from actioncli.errors import ActionCliError, StoreError
from actioncli.store.backup import backup_path, make_backup
from actioncli.store.database import writing
from actioncli.store.health import damage
from actioncli.store.migrations import MIGRATIONS
from actioncli.store.repair import Repair
from actioncli.store.store import SupportStore

PAGE = 4096
SCHEMAS = Path(__file__).with_name("schemas")


@contextmanager
def temporary_store() -> Iterator[SupportStore]:
    """A store in memory where there is a file system for that: hypothesis makes many."""
    memory = "/dev/shm" if os.access("/dev/shm", os.W_OK) else None
    with tempfile.TemporaryDirectory(dir=memory) as folder:
        yield SupportStore(Path(folder) / "home" / "support.db")


def flip(store: SupportStore, seed: int, copied: bool = False) -> bytes:
    """Flip a bit of the recording that this seed made; the damaged file."""
    if not copied:
        backup_path(store.path).unlink(missing_ok=True)
    content = bytearray(store.path.read_bytes())
    joints = make_clip(seed, 60).joints.astype("<f4").tobytes()
    content[content.index(joints[-200:])] ^= 1
    store.path.write_bytes(content)
    return bytes(content)


def repaired(store: SupportStore) -> Repair:
    """What the repair of a damaged store did."""
    done = store.repair()
    assert done is not None
    return done


class Truth:
    """A store with random content, and what is in it."""

    def __init__(self, store: SupportStore, seed: int) -> None:
        rng = random.Random(seed)
        self.store = store
        self.clips: dict[int, Clip] = {}
        for number in range(rng.randint(1, 10)):
            frames, joints = rng.choice([2, 6, 40, 200]), rng.choice([1, 4, 30])
            clip = make_clip(seed * 100 + number, frames, joints, rng.random() < 0.4)
            done = store.enroll(f"action {rng.randrange(3)}", clip, note=f"note {number}")
            self.clips[done.example] = clip
        noise = make_clip(seed * 100 + 99)
        self.clips[store.enroll("noise", noise, negative=True).example] = noise
        if len(self.clips) > 3:
            gone = rng.choice(sorted(self.clips)[:-1])
            store.remove(next(e.label for e in store.examples() if e.id == gone), gone)
            del self.clips[gone]
        store.set_setting("threshold", "0.25")
        self.embedding = {max(self.clips): np.ones((2, 3), np.float32)}
        store.keep_embeddings("w", self.embedding)
        self.examples = {example.id: example for example in store.examples()}
        self.content = store.path.read_bytes()

    def use(self, damaged: bool) -> None:
        """What is read of a damaged store is told, or is what was enrolled."""
        try:
            support = self.store.support()
        except StoreError:
            assert damaged
        else:
            actions = [each for each in self.examples.values() if not each.negative]
            assert damaged or support.keys() == {example.label for example in actions}
            for label, clips in support.items():
                enrolled = [self.clips[each.id] for each in actions if each.label == label]
                assert all(any(same(clip, each) for each in enrolled) for clip in clips)
        other = SupportStore(self.store.path.with_name("other.db"))
        shutil.copy(self.store.path, other.path)
        for ask in (
            self.store.actions,
            self.store.examples,
            self.store.negatives,
            lambda: self.store.snapshot("w"),
            lambda: self.store.clip(1),
            lambda: self.store.export(self.store.path.with_name("export")),
            lambda: self.store.setting("threshold"),
            lambda: other.enroll("action 0", make_clip(0)),
            lambda: other.keep_embeddings("w", self.embedding),
            lambda: other.remove("action 1"),
        ):
            with suppress(ActionCliError):
                ask()

    def compare(self, done: Repair) -> None:
        """All that is there is what was enrolled, to the last bit, and what is not is said."""
        assert self.store.check() == []
        found = {example.id: example for example in self.store.examples()}
        for number, example in found.items():
            assert same(self.store.clip(number), self.clips[number])
            expected = self.examples[number]
            if number in done.doubtful:
                assert example.label == expected.label
            else:
                assert example == expected
        assert self.store.setting("threshold") in (None, "0.25")
        assert done.labels == {number: example.label for number, example in found.items()}
        if done.complete:
            missing = self.examples.keys() - found.keys()
            gone = {each.id: each.label for each in done.gone}
            # A page in a wrong place may name more.
            assert all(gone[number] == self.examples[number].label for number in missing)
        # Numbers that were given once are not given again.
        assert self.store.enroll("later", make_clip(77)).example > max(found, default=0)


@settings(max_examples=cases(60), suppress_health_check=[HealthCheck.too_slow])
@given(seed=st.integers(0, 10_000), copied=st.booleans(), data=st.data())
def test_what_comes_back_is_what_was_enrolled(seed: int, copied: bool, data: st.DataObject) -> None:
    with temporary_store() as store:
        truth = Truth(store, seed)
        if copied:
            assert make_backup(store.path)
        else:
            backup_path(store.path).unlink()
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
        damaged = damage(store.path) != []
        truth.use(damaged)
        try:
            done = store.repair()
        except StoreError:
            # Too little is left to say that it ever was a support set, or a flipped bit calls it
            # one of a newer release.
            assert not copied
            assert store.path.read_bytes() == content
            return
        assert (done is not None) == damaged
        if done is not None:
            assert done.kept.read_bytes() == content
            assert stat.S_IMODE(done.kept.stat().st_mode) == 0o600
            assert stat.S_IMODE(store.path.stat().st_mode) == 0o600
            if copied:
                assert done.labels.keys() == truth.examples.keys()
                assert store.setting("threshold") == "0.25"
            truth.compare(done)
        assert not list(store.path.parent.glob(".repair-*"))


def test_examples_on_whole_pages_need_no_copy(store: SupportStore) -> None:
    """Every page behind the schema in turn is filled with zeros: most examples come back."""
    clips = [make_clip(seed, 60) for seed in range(6)]
    store.enroll_all([(f"action {seed}", clip) for seed, clip in enumerate(clips)])
    backup_path(store.path).unlink()
    whole, fewest = store.path.read_bytes(), 6
    for at in range(PAGE, len(whole), PAGE):
        content = bytearray(whole)
        content[at : at + PAGE] = bytes(PAGE)
        store.path.write_bytes(content)
        backup_path(store.path).unlink(missing_ok=True)
        done = store.repair()
        if done is None:
            continue  # a page that was free
        assert all(same(store.clip(number), clips[number - 1]) for number in done.labels)
        fewest = min(fewest, len(done.labels) or 6)
    assert fewest >= 4


@pytest.mark.parametrize("junk", [bytes(PAGE), b"SQLite format 3" + bytes(PAGE - 15)])
def test_with_the_copy_no_single_page_takes_anything_away(store: SupportStore, junk: bytes) -> None:
    """Also where the names of settings are still read from their index, but not their values."""
    store.enroll("wave", make_clip(1))
    store.set_setting("threshold", "0.25")
    whole = store.path.read_bytes()
    for at in range(PAGE, len(whole), PAGE):
        assert make_backup(store.path)
        store.path.write_bytes(whole[:at] + junk + whole[at + PAGE :])
        done = store.repair()
        assert done is None or (done.labels, done.settings_gone) == ({1: "wave"}, [])
        assert store.setting("threshold") == "0.25"


def test_the_copy_fills_up_what_cannot_be_read(store: SupportStore) -> None:
    store.enroll_all([("wave", make_clip(seed, 60)) for seed in range(3)], note="by the window")
    assert make_backup(store.path)
    store.enroll("later", make_clip(7, 60))  # within the minute: not in the copy yet
    flip(store, 1, copied=True)
    done = repaired(store)
    assert (done.labels, done.gone, done.doubtful) == (
        {1: "wave", 2: "wave", 3: "wave", 4: "later"}, [], [],
    )  # fmt: skip
    assert same(store.clip(2), make_clip(1, 60))
    flip(store, 7)
    done = repaired(store)
    assert [(gone.id, gone.label) for gone in done.gone] == [(4, "later")]


def test_a_damaged_copy_is_believed_only_where_it_is_proved(store: SupportStore) -> None:
    store.enroll_all([("wave", make_clip(seed, 60)) for seed in range(3)])
    assert make_backup(store.path)
    copy = SupportStore(backup_path(store.path))
    flip(copy, 2, copied=True)
    store.path.write_bytes(os.urandom(20_000))
    done = repaired(store)
    assert done.labels == {1: "wave", 2: "wave"}
    assert [gone.id for gone in done.gone] == [3]
    assert not done.complete


def test_a_note_that_changed_makes_an_example_doubtful(store: SupportStore) -> None:
    """Its recording is proved by its checksum, its label by the index."""
    store.enroll("wave", make_clip(0), note="by the window")
    store.enroll("clap", make_clip(1))
    store.set_setting("threshold", "0.125")
    whole = store.path.read_bytes()

    def flipped(text: bytes) -> Repair:
        backup_path(store.path).unlink(missing_ok=True)
        content = bytearray(whole)
        content[content.rindex(text)] ^= 2
        store.path.write_bytes(content)
        assert damage(store.path)
        return repaired(store)

    done = flipped(b"by the window")
    assert (done.doubtful, done.gone) == ([1], [])
    done = flipped(b"clap")  # the label: in the table, or in the index
    assert set(done.labels.values()) <= {"wave", "clap"}
    assert "clap" in {*done.labels.values(), *(gone.label for gone in done.gone)}
    done = flipped(b"0.125")
    assert done.settings_gone == ["threshold"]
    assert store.setting("threshold") is None


@pytest.mark.parametrize("name", ["x" * 244 + ".db", "手" * 81 + ".db"])
def test_the_longest_names_leave_room_for_the_damaged_file(tmp_path: Path, name: str) -> None:
    store = SupportStore(tmp_path / name)
    store.enroll("wave", make_clip(1))
    for _ in "ab":
        content = bytearray(store.path.read_bytes())
        content[-PAGE:] = bytes(PAGE)
        store.path.write_bytes(content)
        store.path.with_name(name + "-journal").write_bytes(b"no journal")
        done = repaired(store)
        assert done.kept.read_bytes() == content
    assert store.check() == []


def test_an_interrupted_write_is_undone_before_repairing(store: SupportStore) -> None:
    """Damage and a journal at once: what was never acknowledged does not come back."""
    store.enroll("wave", make_clip(0, 60))
    store.enroll("clap", make_clip(1, 60))

    journal = interrupt(
        store,
        "UPDATE examples SET label = 'never', note = 'x' WHERE id = 1",
        "INSERT INTO settings VALUES ('never', hex(zeroblob(200000)), 0)",
    )
    content = flip(store, 1)
    interrupted = journal.read_bytes()
    done = repaired(store)
    assert done.kept.read_bytes() == content
    assert done.kept.with_name(done.kept.name + "-journal").read_bytes() == interrupted
    assert not journal.exists()
    assert same(store.support()["wave"][0], make_clip(0, 60))
    assert [action.label for action in store.actions()] == ["wave"]
    assert store.setting("never") is None


def test_several_repairs_keep_several_files(store: SupportStore) -> None:
    store.enroll_all([("wave", make_clip(seed, 60)) for seed in range(3)])
    assert store.repair() is None
    for turn in range(2):
        flip(store, turn)
        done = repaired(store)
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
    done = repaired(store)
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


def test_another_database_and_a_newer_one_are_left(store: SupportStore, tmp_path: Path) -> None:
    other = SupportStore(tmp_path / "places.db")
    alter(other.path, "CREATE TABLE bookmarks (url TEXT)")
    with pytest.raises(StoreError, match="nothing of a support set was found"):
        other.repair()
    store.enroll("wave", make_clip(0))
    alter(
        store.path,
        "ALTER TABLE examples ADD COLUMN colour TEXT",
        f"PRAGMA user_version = {len(MIGRATIONS) + 1}",
    )
    before = store.path.read_bytes()
    with pytest.raises(StoreError, match="newer release"):
        store.repair()
    assert store.path.read_bytes() == before


def test_a_version_that_is_a_flipped_bit_is_mended(store: SupportStore) -> None:
    store.enroll("wave", make_clip(0))
    alter(store.path, f"PRAGMA user_version = {len(MIGRATIONS) ^ 64}")
    done = repaired(store)
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
    store.path.write_bytes(content)
    done = repaired(store)
    assert sorted(done.labels) == sorted(clips.keys() - {3})
    assert [(gone.id, gone.label) for gone in done.gone] == [(3, "squat")]
    assert done.doubtful == []
    for number in done.labels:
        assert same(store.clip(number), clips[number])
    assert store.check() == []


@pytest.mark.parametrize("gone", [False, True])
def test_a_store_that_is_gone_comes_back_from_its_copy(store: SupportStore, gone: bool) -> None:
    store.enroll_all([("wave", make_clip(seed)) for seed in range(3)])
    whole = backup_path(store.path).read_bytes()
    if gone:
        store.path.unlink()
    else:
        store.path.write_bytes(b"")
    assert any("doctor --repair" in problem for problem in store.check())
    with pytest.raises(StoreError, match="brings it back"):
        store.enroll("hop", make_clip(9))
    assert backup_path(store.path).read_bytes() == whole
    done = repaired(store)
    assert done.labels == {1: "wave", 2: "wave", 3: "wave"}
    assert store.check() == []
    store.enroll("hop", make_clip(9))
