"""Where a user's files lie, also where the user has no home; and what differs between systems."""

import os
import pwd
import re
import signal
import subprocess
import sys
import webbrowser
from pathlib import Path
from types import SimpleNamespace

import pytest
from typer.testing import CliRunner

from actioncli import SupportStore, files
from actioncli.archives.processes import cores
from actioncli.cli.app import app
from actioncli.errors import StoreError, UsageError
from actioncli.files import NoHomeError, user_folder, user_settings
from actioncli.pose import cache, camera
from actioncli.store.backup import make_backup
from actioncli.studio.server import Server
from actioncli.studio.upload_folder import UploadFolder
from tests.pose.test_cache import poses
from tests.pose.videos import numbered, write_video

ROOT = Path(__file__).parents[1]


@pytest.fixture
def homeless(monkeypatch: pytest.MonkeyPatch) -> None:
    """As a service or a container can be: of a user that the system knows nothing about."""
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
    monkeypatch.setenv("ACTIONCLI_HOME", "~nobody-of-this-name/actions")
    with pytest.raises(NoHomeError, match="names no folder"):
        user_folder(kind)  # type: ignore[arg-type]
    monkeypatch.delenv("ACTIONCLI_HOME")
    assert user_folder(kind).is_absolute()  # type: ignore[arg-type]


@pytest.mark.usefixtures("homeless")
def test_without_a_home_the_way_out_is_told_and_nothing_is_kept(tmp_path: Path) -> None:
    for kind in ("data", "cache"):
        with pytest.raises(NoHomeError, match="let ACTIONCLI_HOME name a folder"):
            user_folder(kind)  # type: ignore[arg-type]
    with pytest.raises(StoreError, match="let ACTIONCLI_HOME name a folder"):
        SupportStore()
    assert SupportStore(tmp_path / "a.db").check() == []
    with pytest.raises(UsageError, match="let ACTIONCLI_HOME name a folder"):
        UploadFolder()
    cache.keep("a", poses())
    assert cache.load("a") is None
    assert user_settings() == {}


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
    for name in ("STORE", "QUALITY", "TAU", "CAMERA", "MQTT"):
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
        ("threshold = 0.5", "no setting 'threshold', only store, quality, tau, camera, mqtt"),
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


# What some systems lack, and what asks for them.
_SYSTEMS = re.compile(
    r"\b(?:sys\.platform|signal\.SIG(?:HUP|KILL|USR1)"
    r"|import (?:fcntl|grp|msvcrt|pwd|resource|termios)"
    r"|os\.(?:name|fork|getuid|geteuid|kill|mkfifo|sched_\w+|setsid|O_NOFOLLOW))\b"
)
# In a process that was forked, so on Linux; and where it is heeded that there is no such module.
_HEEDED = {
    ("processes.py", "os.sched_setaffinity"),
    ("review.py", "import termios"),
    ("c3d.py", "import resource"),
}


def test_only_files_asks_which_system_it_is() -> None:
    for file in sorted((ROOT / "actioncli").rglob("*.py")):
        if file.name != "files.py":
            found = {(file.name, name) for name in _SYSTEMS.findall(file.read_text("utf-8"))}
            assert found <= _HEEDED


@pytest.fixture(params=["win32", "darwin"])
def elsewhere(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> str:
    """As on another system: what that one lacks is not there."""
    system: str = request.param
    monkeypatch.setattr(files, "SYSTEM", system)
    missing = [(os, "sched_getaffinity"), (os, "sched_setaffinity")]
    if system == "win32":
        missing += [(os, "geteuid"), (os, "O_NOFOLLOW"), (signal, "SIGHUP"), (signal, "SIGKILL")]
        for name in ("fcntl", "pwd", "termios"):
            monkeypatch.setitem(sys.modules, name, None)
        locks = SimpleNamespace(LK_NBLCK=2, locking=lambda handle, kind, length: None)
        monkeypatch.setitem(sys.modules, "msvcrt", locks)
    for module, name in missing:
        monkeypatch.delattr(module, name)
    return system


@pytest.mark.usefixtures("elsewhere")
def test_commands_work_elsewhere(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("ACTIONCLI_HOME", str(tmp_path / "home"))
    bow, squat = (str(ROOT / "examples" / f"{name}/ben.npz") for name in ("bow", "squat"))
    video = str(write_video(tmp_path / "a.mp4", numbered(8)))
    store = SupportStore()
    for words in (
        ["enroll", "bow", bow], ["enroll", "squat", squat], ["classify", bow, squat],
        ["watch", video], ["list-support"], ["cameras"],
    ):  # fmt: skip
        result = CliRunner().invoke(app, words)
        assert result.exit_code == 0, (words, result.output, result.exception)
    assert make_backup(store.path)
    content = bytearray(store.path.read_bytes())
    content[4096:8192] = bytes(4096)
    store.path.write_bytes(content)
    done = store.repair()
    assert done is not None
    assert set(done.labels.values()) == {"bow", "squat"}
    assert store.check() == []


@pytest.mark.usefixtures("elsewhere")
def test_the_studio_works_elsewhere(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("ACTIONCLI_HOME", str(tmp_path))
    monkeypatch.delenv("DISPLAY", raising=False)
    monkeypatch.setattr(webbrowser, "open", lambda address: address.startswith("file:"))
    UploadFolder().close()
    server = Server()
    try:
        assert server.open(tmp_path)
    finally:
        server.close()


def test_what_other_systems_have_not_is_not_asked_for(
    elsewhere: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    windows = elsewhere == "win32"
    file, part = tmp_path / "a", tmp_path / "part"
    for path in (file, part):
        path.write_bytes(b"x")
        path.chmod(0o644)
    assert (files.rights_of_others(file) == 0) == windows
    monkeypatch.setattr(camera, "_opens", lambda number: number == 1)
    assert camera.cameras() == [(1, "camera 1")]
    assert (len(files.own_cores()), cores()) == (os.cpu_count(), 1)
    assert len(files.ending_signals()) == (1 if windows else 2)
    words = ["C:\\a b\\beep.exe", "-n", "3"] if windows else ["C:a b", "beep.exe"]
    line = '"C:\\a b\\beep.exe" -n 3' if windows else r"C:a\ b beep.exe"
    assert files.command_words(line) == words
    with file.open("r+b") as opened:
        assert files.lock_bytes(opened, 1 << 30, 512)
        files.replace_open(part, file, opened)
        assert opened.closed == windows
    if windows:
        files.sync_folder(tmp_path / "cannot be opened")
