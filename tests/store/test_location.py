"""Where the store lies, and who can read it."""

import os
import stat
from collections.abc import Callable
from pathlib import Path

import pytest
from storing import as_ordinary_user, fork, give_away, make_clip, succeeded

from actioncli.errors import StoreError
from actioncli.store.database import writing
from actioncli.store.location import store_path
from actioncli.store.store import SupportStore


def mode(path: Path) -> int:
    return stat.S_IMODE(path.stat().st_mode)


def test_an_explicit_path_wins(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("ACTIONCLI_HOME", "/nowhere")
    assert store_path(tmp_path / "a.db") == tmp_path / "a.db"
    monkeypatch.chdir(tmp_path)
    assert store_path("a.db") == tmp_path / "a.db"


def test_the_users_data_folder_is_the_default(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("ACTIONCLI_HOME", "")
    monkeypatch.setenv("XDG_DATA_HOME", str(tmp_path))
    assert store_path() == tmp_path / "actioncli" / "support.db"


@pytest.mark.parametrize("umask", [0, 0o077])
def test_only_the_owner_can_read(tmp_path: Path, umask: int) -> None:
    path = tmp_path / "new" / "home" / "support.db"

    def enrol() -> None:
        os.umask(umask)
        SupportStore(path).enroll("wave", make_clip(0))
        with writing(path) as db:
            db.execute("UPDATE sqlite_sequence SET seq = 5")
            journal = path.with_name("support.db-journal")
            assert mode(journal) == 0o600
        SupportStore(path).export(path.with_name("export"))

    assert succeeded(fork(enrol))
    assert mode(path.parent) == 0o700
    files = {"support.db", "support.db.backup", "export"}
    assert {file.name: mode(file) for file in path.parent.iterdir()} == dict.fromkeys(files, 0o600)


def test_an_empty_folder_is_closed_and_a_used_one_is_left(tmp_path: Path) -> None:
    empty, used = tmp_path / "empty", tmp_path / "used"
    for folder in (empty, used):
        folder.mkdir()
        folder.chmod(0o755)
    (used / "thesis.txt").write_text("mine")
    SupportStore(empty / "support.db").enroll("wave", make_clip(0))
    SupportStore(used / "support.db").enroll("wave", make_clip(0))
    assert (mode(empty), mode(used)) == (0o700, 0o755)


def test_a_store_that_was_opened_to_others_is_told_and_closed(store: SupportStore) -> None:
    store.enroll("wave", make_clip(0))
    store.path.chmod(0o644)
    store.path.parent.chmod(0o777)
    problems = store.check()
    assert len(problems) == 2
    assert "chmod 600" in problems[0]
    assert "chmod 700" in problems[1]
    store.enroll("wave", make_clip(1))
    assert mode(store.path) == 0o600
    store.path.parent.chmod(0o700)
    assert store.check() == []


@pytest.mark.parametrize("use", [SupportStore.actions, lambda s: s.enroll("wave", make_clip(0))])
@pytest.mark.parametrize(
    ("name", "why"),
    [
        ("", "is a folder"), ("link", "symbolic link"), ("dangling", "symbolic link"),
        ("pipe", "no ordinary file"), ("a\0b", "cannot be a file name"),
        ("x" * 5000, "cannot hold a support set"),
    ],
)  # fmt: skip
def test_what_cannot_be_a_store_is_named(
    tmp_path: Path, name: str, why: str, use: Callable[[SupportStore], object]
) -> None:
    (tmp_path / "file").write_text("")
    (tmp_path / "link").symlink_to(tmp_path / "file")
    (tmp_path / "dangling").symlink_to(tmp_path / "nothing")
    os.mkfifo(tmp_path / "pipe")
    before = sorted(tmp_path.rglob("*"))
    with pytest.raises(StoreError, match=why) as error:
        use(SupportStore(tmp_path / name))
    assert error.value.exit_code == 5
    assert sorted(tmp_path.rglob("*")) == before
    assert (tmp_path / "file").read_text() == ""
    in_no_folder = SupportStore(tmp_path / "file" / "support.db")
    assert in_no_folder.actions() == []
    with pytest.raises(StoreError, match="cannot hold a support set"):
        in_no_folder.enroll("wave", make_clip(0))


def test_permissions_are_told(shared_folder: Path) -> None:
    shut = shared_folder / "shut"
    shut.mkdir()
    store = SupportStore(shut / "support.db")
    store.enroll("wave", make_clip(0))
    give_away(shut, store.path)

    def refused() -> None:
        for use in (store.actions, lambda: store.enroll("wave", make_clip(1))):
            with pytest.raises(StoreError) as error:
                use()
            assert str(store.path) in str(error.value)
            assert "ACTIONCLI_HOME" in str(error.value) or "another place" in str(error.value)
        assert len(store.check()) == 1

    shut.chmod(0o000)
    assert as_ordinary_user(refused)
    shut.chmod(0o700)
    store.path.chmod(0o000)
    assert as_ordinary_user(refused)


def test_names_that_are_too_long_are_refused_before_anything_is_made(tmp_path: Path) -> None:
    """The journal's name is longer by eight bytes, and SQLite takes 512 of a path."""
    longest = SupportStore(tmp_path / "home" / ("x" * 247))
    longest.enroll("wave", make_clip(0))
    assert longest.check() == []
    deep = tmp_path / "/".join(["y" * 100] * 5) / "support.db"
    for path in (tmp_path / "other" / ("x" * 248), tmp_path / "other" / ("ü" * 124), deep):
        with pytest.raises(StoreError, match="too long for a support set"):
            SupportStore(path).enroll("wave", make_clip(0))
        assert SupportStore(path).actions() == []
    assert [file.name for file in tmp_path.iterdir()] == ["home"]
