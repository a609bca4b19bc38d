"""The copy beside the store follows what is committed, and holds nothing that was removed."""

import os
import stat
import subprocess
import sys
from collections.abc import Callable
from functools import partial
from pathlib import Path

import pytest
from storing import as_ordinary_user, fork, give_away, make_clip, same, succeeded

from actioncli.errors import StoreError
from actioncli.store.backup import backup_path, finish_backups, make_backup
from actioncli.store.store import SupportStore
from tests.forking import files_up_to


def copied(store: SupportStore) -> dict[int, str]:
    copy = SupportStore(backup_path(store.path))
    assert copy.check() == []
    return {example.id: example.label for example in copy.examples()}


def test_the_first_commit_is_copied_at_once_the_next_within_a_minute_at_the_end(
    store: SupportStore, monkeypatch: pytest.MonkeyPatch
) -> None:
    store.enroll("wave", make_clip(0))
    copy = backup_path(store.path)
    assert stat.S_IMODE(copy.stat().st_mode) == 0o600
    assert same(SupportStore(copy).clip(1), make_clip(0))
    store.enroll("clap", make_clip(1))
    assert copied(store) == {1: "wave"}
    assert "older" in (store.backup_flaw() or "")
    finish_backups()
    assert copied(store) == {1: "wave", 2: "clap"}
    assert store.backup_flaw() is None
    os.utime(copy, (0, 0))  # a minute ago, and more
    store.enroll("bow", make_clip(2))
    assert len(copied(store)) == 3
    assert sorted(file.name for file in store.path.parent.iterdir()) == [
        "support.db",
        "support.db.backup",
    ]


def test_a_process_that_ends_leaves_a_copy_of_all(store: SupportStore) -> None:
    store.enroll("wave", make_clip(0))
    script = (
        "import sys; from actioncli import SupportStore\n"
        "store = SupportStore(sys.argv[1]); store.rename('wave', 'clap')"
    )
    subprocess.run([sys.executable, "-c", script, str(store.path)], check=True)
    assert copied(store) == {1: "clap"}


@pytest.mark.parametrize(
    "forget", [lambda s: s.set_setting("threshold", None), lambda s: s.clear(settings=True)]
)
def test_a_forgotten_setting_leaves_the_copy_before_the_store(
    store: SupportStore, forget: Callable[[SupportStore], object]
) -> None:
    """A process that is killed then leaves no old threshold behind."""
    store.enroll("wave", make_clip(0))
    store.set_setting("threshold", "0.3")
    finish_backups()
    copy = SupportStore(backup_path(store.path))
    assert copy.setting("threshold") == "0.3"
    forget(store)
    assert copy.setting("threshold") is None


def test_a_copy_that_cannot_be_written_is_one_line_on_standard_error(store: SupportStore) -> None:
    copy = backup_path(store.path)
    copy.mkdir(parents=True)
    script = (
        "import sys; from actioncli import SupportStore\n"
        "SupportStore(sys.argv[1]).set_setting('threshold', '0.3')"
    )
    for _ in "ab":
        command = [sys.executable, "-c", script, str(store.path)]
        done = subprocess.run(command, check=True, capture_output=True, text=True)
        assert done.stderr.startswith(f"{copy}: this copy cannot be renewed: ")
        assert done.stderr.count("\n") == 1


@pytest.mark.parametrize("clear", [False, True])
def test_what_is_removed_is_in_no_copy(store: SupportStore, clear: bool) -> None:
    store.enroll_all([("wave", make_clip(seed)) for seed in range(3)])
    copy = backup_path(store.path)
    made = copy.stat().st_mtime_ns - 20 * 10**9
    os.utime(copy, ns=(made, made))
    secret = make_clip(1).joints.astype("<f4").tobytes()[:40]
    assert secret in backup_path(store.path).read_bytes()
    if clear:
        store.clear()
    else:
        store.remove("wave", 2)
    assert copy.stat().st_mtime_ns == made  # as old as what else it holds
    for file in store.path.parent.iterdir():
        assert secret not in file.read_bytes()
    assert copied(store) == ({} if clear else {1: "wave", 3: "wave"})


def test_a_damaged_store_never_takes_the_place_of_a_good_copy(store: SupportStore) -> None:
    store.enroll_all([("wave", make_clip(0, 60)), ("clap", make_clip(1, 60))])
    whole = backup_path(store.path).read_bytes()
    content = bytearray(store.path.read_bytes())
    content[content.index(make_clip(0, 60).joints.astype("<f4").tobytes()[-200:])] ^= 1
    store.path.write_bytes(content)
    store.enroll("bow", make_clip(2))
    assert not make_backup(store.path)
    assert backup_path(store.path).read_bytes() == whole
    store.remove("clap")
    assert copied(store) == {1: "wave"}


def test_a_copy_that_cannot_be_made_costs_nothing(store: SupportStore) -> None:
    store.enroll("wave", make_clip(0, 600))
    copy = backup_path(store.path)
    copy.unlink()
    assert "there is no" in (store.backup_flaw() or "")
    with files_up_to(store.path.stat().st_size - 8192):
        assert not make_backup(store.path)
    assert [file.name for file in store.path.parent.iterdir()] == ["support.db"]
    copy.write_bytes(b"no database" * 100)
    os.utime(copy, (2**32, 2**32))
    assert "damaged" in (store.backup_flaw() or "")
    store.enroll("clap", make_clip(1))
    assert copied(store) == {1: "wave", 2: "clap"}


def test_nothing_is_removed_where_its_copy_would_stay(shared_folder: Path) -> None:
    store = SupportStore(shared_folder / "home" / "support.db")
    store.enroll("wave", make_clip(0))
    copy = backup_path(store.path)
    copy.unlink()
    copy.write_bytes(b"damaged" * 1000)
    give_away(store.path.parent, store.path, copy)
    give_away(store.path.parent)
    store.path.parent.chmod(0o500)

    def work() -> None:
        with pytest.raises(StoreError, match=r"Nothing was removed|cannot be written"):
            store.remove("wave")

    assert as_ordinary_user(work)
    store.path.parent.chmod(0o700)
    assert len(store.examples()) == 1


def test_many_processes_leave_one_whole_copy(store: SupportStore) -> None:
    store.enroll("wave", make_clip(99))

    def enroll(seed: int) -> None:
        store.enroll("wave", make_clip(seed))
        assert make_backup(store.path)

    children = [fork(partial(enroll, seed)) for seed in range(6)]
    assert [succeeded(child) for child in children] == [True] * 6
    assert len(copied(store)) == 7


def test_a_link_in_the_place_of_the_copy_is_replaced(shared_folder: Path, tmp_path: Path) -> None:
    store = SupportStore(shared_folder / "support.db")
    victim = tmp_path / "victim"
    victim.write_text("mine")
    for name in ("support.db.backup", "support.db.backup.part"):
        (shared_folder / name).symlink_to(victim)
    store.enroll("wave", make_clip(0))
    assert victim.read_text() == "mine"
    assert not backup_path(store.path).is_symlink()
