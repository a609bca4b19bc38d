"""Where a user's files lie, also where the user has no home."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

from actioncli import SupportStore
from actioncli.errors import StoreError, UsageError
from actioncli.files import NoHomeError, user_folder
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
