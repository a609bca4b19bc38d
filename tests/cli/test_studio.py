"""`studio` and `review --page` as processes: what they print, and how they end."""

import json
import os
import signal
import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from urllib.parse import urlsplit

import pytest

from actioncli import SupportStore, read_clip
from tests.studio.serving import Client, record, until

from .conftest import EXAMPLES, invoke

Start = Callable[..., subprocess.Popen[str]]


@pytest.fixture
def start(home: Path) -> Iterator[Start]:
    """Run a command in the background; what still runs at the end is killed."""
    running = []

    def begin(*arguments: object, **environment: str) -> subprocess.Popen[str]:
        words = [sys.executable, "-m", "actioncli", *map(str, arguments)]
        child = subprocess.Popen(
            words,
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
            env={**os.environ, **environment},
        )
        running.append(child)
        return child

    yield begin
    for child in running:
        child.kill()
        child.communicate()


def line(child: subprocess.Popen[str]) -> str:
    assert child.stdout is not None
    return child.stdout.readline()


def client_of(child: subprocess.Popen[str]) -> Client:
    """Somebody with the address that was printed."""
    return Client(line(child).strip())


def uploads(home: Path) -> list[Path]:
    return list(home.glob("uploads/*/"))


@pytest.mark.usefixtures("unmeasured")
@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_it_serves_until_it_is_ended_and_leaves_nothing(
    start: Start, home: Path, number: int
) -> None:
    child = start("studio", "--no-open")
    client = client_of(child)
    assert client.address.startswith("http://127.0.0.1:")
    assert client.ask("GET", "/api/state")[0] == 200
    assert client.answer("GET", "/api/state", headers={})[0] == 403
    upload = client.begin_upload("Content-Length: 1000000")
    upload.sendall(bytes(100_000))
    until(lambda: list(home.glob("uploads/*/*")))
    (file,) = home.glob("uploads/*/*")
    assert file.stat().st_mode & 0o777 == 0o600
    child.send_signal(number)
    stdout, stderr = child.communicate(timeout=120)
    assert (child.returncode, stdout, stderr) == (0, "", "Ctrl-C ends it.\n")
    assert not uploads(home)
    upload.close()
    assert not (home / "support.db").exists()


def test_a_crash_leaves_nothing_either(start: Start, home: Path) -> None:
    child = start("studio", "--no-open", "-q")
    upload = client_of(child).begin_upload("Content-Length: 1000000")
    upload.sendall(bytes(100_000))
    assert uploads(home)
    child.kill()
    child.wait()
    until(lambda: not uploads(home))
    upload.close()


def test_two_at_once_serve_the_support_set_of_the_commands(
    start: Start, store: SupportStore
) -> None:
    store.enroll("squat", read_clip(EXAMPLES / "squat/ada.npz"))
    children = [start("studio", "--no-open", "--json") for _ in range(2)]
    first, second = (Client(json.loads(line(child))["address"]) for child in children)
    for client in (first, second):
        state = client.get("/api/state")
        assert state["store"] == str(store.path)
        assert [action["label"] for action in state["actions"]] == ["squat"]
    assert second.answer("GET", "/api/state", headers=first.headers)[0] == 403


@pytest.mark.parametrize("words", [("studio",), ("watch", "rtsp://me:secret@a/b", "--page")])
def test_the_browser_is_given_a_file_that_nobody_else_can_read(
    start: Start, home: Path, tmp_path: Path, words: tuple[str, ...]
) -> None:
    seen = tmp_path / "seen"
    browser = tmp_path / "browser"
    browser.write_text(f'#!/bin/sh\nprintf "%s" "$1" > {seen}.part && mv {seen}.part {seen}\n')
    browser.chmod(0o700)
    client = client_of(start(*words, BROWSER=str(browser)))
    source = client.get("/api/state")["source"]
    assert source == ("rtsp://a/b" if "--page" in words else None)
    until(seen.exists)
    opened = urlsplit(seen.read_text())
    assert opened.scheme == "file"
    page = Path(opened.path)
    assert page.stat().st_mode & 0o777 == 0o600
    assert page.parent.stat().st_mode & 0o777 == 0o700
    assert client.address in page.read_text(encoding="utf-8")


def test_what_cannot_be_served_is_told(home: Path, tmp_path: Path, start: Start) -> None:
    port = client_of(start("studio", "--no-open")).port
    taken = invoke("studio", "--no-open", "--port", port)
    assert (taken.exit_code, taken.stdout) == (2, "")
    assert f"--port {port}: cannot be used (Address already in use)" in taken.stderr
    broken = tmp_path / "broken.db"
    broken.write_text("no database" * 100)
    assert invoke("studio", "--no-open", "--store", broken).exit_code == 5
    # A Python without the extra, for all that it can tell.
    hidden = (
        "import sys\nsys.modules['uvicorn'] = None\n"
        "from actioncli.cli.app import app\nsys.argv = ['actioncli', 'studio']\napp()"
    )
    lacking = subprocess.run(
        [sys.executable, "-c", hidden], capture_output=True, text=True, check=False
    )
    assert lacking.returncode == 2
    assert "the page needs uvicorn: pip install 'actioncli[studio]'" in lacking.stderr


@pytest.mark.usefixtures("unmeasured")
def test_review_has_a_page_too(start: Start, home: Path, tmp_path: Path) -> None:
    folder = tmp_path / "seen"
    record(folder, "squat")
    child = start("review", folder, "--page", "--no-open")
    assert client_of(child).ask("GET", "/api/waiting")[0] == 200
    child.send_signal(signal.SIGINT)
    stdout, _ = child.communicate(timeout=120)
    assert (child.returncode, stdout) == (0, "nothing was changed\n")
    assert not uploads(home)
    assert invoke("review", folder, "--no-open").exit_code == 2
    assert invoke("review", tmp_path / "none", "--page", "--no-open").exit_code == 2
    assert "With --page: address" in invoke("review", "--help").stdout
