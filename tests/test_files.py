"""Where a user's files lie, also where the user has no home."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

from actioncli import SupportStore
from actioncli.errors import StoreError, UsageError
from actioncli.files import NoHomeError, user_folder, user_settings
from actioncli.pose import cache
from tests.pose.test_cache import poses

posix = pytest.mark.skipif(os.name != "posix", reason="homes are found otherwise there")


@pytest.fixture
def homeless(monkeypatch: pytest.MonkeyPatch) -> None:
    """As a service or a container can be: of a user that the system knows nothing about."""
    import pwd

    for name in ("HOME", "ACTIONCLI_HOME", "XDG_DATA_HOME", "XDG_CACHE_HOME"):
        monkeypatch.delenv(name, raising=False)

    def unknown(number: int) -> None:
        raise KeyError(number)

    monkeypatch.setattr(pwd, "getpwuid", unknown)


@pytest.mark.parametrize("kind", ["data", "cache"])
def test_actioncli_home_names_the_folder(kind: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("ACTIONCLI_HOME", "~/actions")
    assert user_folder(kind) == Path.home() / "actions"  # type: ignore[arg-type]
    monkeypatch.setenv("ACTIONCLI_HOME", "here")
    assert user_folder(kind) == Path.cwd() / "here"  # type: ignore[arg-type]
    monkeypatch.delenv("ACTIONCLI_HOME")
    assert user_folder(kind).is_absolute()  # type: ignore[arg-type]


@posix
@pytest.mark.usefixtures("homeless")
def test_without_a_home_the_way_out_is_told(tmp_path: Path) -> None:
    for kind in ("data", "cache"):
        with pytest.raises(NoHomeError, match="let ACTIONCLI_HOME name a folder"):
            user_folder(kind)  # type: ignore[arg-type]
    with pytest.raises(StoreError, match="let ACTIONCLI_HOME name a folder"):
        SupportStore()
    assert SupportStore(tmp_path / "a.db").check() == []


@posix
@pytest.mark.usefixtures("homeless")
def test_without_a_home_poses_are_not_kept() -> None:
    cache.keep("a", poses())
    assert cache.load("a") is None


@posix
@pytest.mark.usefixtures("homeless")
def test_without_a_home_the_studio_has_no_place() -> None:
    pytest.importorskip("starlette", reason="needs the extra `studio`")
    from actioncli.studio.upload_folder import UploadFolder

    with pytest.raises(UsageError, match="let ACTIONCLI_HOME name a folder"):
        UploadFolder()


@posix
def test_a_folder_that_is_gone_is_told(tmp_path: Path) -> None:
    gone = tmp_path / "gone"
    gone.mkdir()
    command = [sys.executable, "-m", "actioncli", "--store", "a.db", "list-support"]
    done = subprocess.run(
        ["sh", "-c", 'rmdir "$0" && exec "$@"', str(gone), *command],
        cwd=gone,
        env={**os.environ, "PYTHONPATH": str(Path(__file__).parents[1])},
        capture_output=True,
        text=True,
        check=False,
        timeout=60,
    )
    assert done.returncode == 2
    assert done.stderr == "error: The folder that this runs in is gone; go to another one (cd).\n"


@pytest.fixture
def config(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv("ACTIONCLI_HOME", str(tmp_path))
    for name in ("STORE", "QUALITY", "TAU", "CAMERA"):
        monkeypatch.delenv(f"ACTIONCLI_{name}", raising=False)
    return tmp_path / "config.toml"


def test_settings_are_those_of_the_file_and_the_environment_wins(
    config: Path, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    assert user_settings() == {}
    config.write_text('tau = 0.6\nquality = "accurate"\ncamera = 1\nstore = "mine.db"\n')
    wanted = {"tau": 0.6, "quality": "accurate", "camera": "1", "store": tmp_path / "mine.db"}
    assert user_settings() == wanted
    assert SupportStore().path == tmp_path / "mine.db"
    assert SupportStore("other.db").path.name == "other.db"
    monkeypatch.setenv("ACTIONCLI_TAU", "0.7")
    monkeypatch.setenv("ACTIONCLI_STORE", "~/other.db")
    monkeypatch.setenv("ACTIONCLI_CAMERA", "")
    other = {"tau": 0.7, "store": Path.home() / "other.db"}
    assert user_settings() == {**wanted, **other}
    assert SupportStore().path == Path.home() / "other.db"


@pytest.mark.parametrize(
    ("text", "wrong"),
    [
        ("tau = 2", "tau cannot be 2"),
        ("tau = [0.5]", r"tau cannot be \[0.5\]"),
        ("tau = nan", "tau cannot be nan"),
        ("quality = 'best'", "quality cannot be 'best'"),
        ("store = 3", "store cannot be 3"),
        ("store = '~nobody-of-this-name/a.db'", "home"),
        ("threshold = 0.5", "no setting 'threshold', only store, quality, tau, camera"),
        ("tau 0.5", "Expected"),
        ("\udcff", "utf-8"),
    ],
)
def test_settings_that_cannot_be_used_are_told(config: Path, text: str, wrong: str) -> None:
    config.write_text(text, encoding="utf-8", errors="surrogateescape")
    with pytest.raises(UsageError, match=rf"config\.toml: .*{wrong}.*mend it"):
        user_settings()
    with pytest.raises(UsageError, match=r"config\.toml"):
        SupportStore()
    config.unlink()
    config.mkdir()
    with pytest.raises(UsageError, match=r"config\.toml: cannot be read"):
        user_settings()


def test_settings_of_the_environment_name_their_variable(
    config: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("ACTIONCLI_QUALITY", "best")
    with pytest.raises(UsageError, match="ACTIONCLI_QUALITY: quality cannot be 'best'"):
        user_settings()


@posix
@pytest.mark.usefixtures("homeless")
def test_without_a_home_there_are_no_settings() -> None:
    assert user_settings() == {}
