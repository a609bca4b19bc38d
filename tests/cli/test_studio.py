"""`studio` and `review --page` as processes: what they print, and how they end."""

import http.client
import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from urllib.parse import urlsplit

import pytest

from actioncli import SupportStore, read_clip
from actioncli.live.events import Event
from actioncli.live.recorder import Recorder
from actioncli.recognition.threshold import Threshold

from .conftest import EXAMPLES, Invoke, Run

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


def headers_of(address: str) -> dict[str, str]:
    """What the page sends with each request."""
    parts = urlsplit(address)
    token = parts.fragment.removeprefix("token=")
    return {"Origin": f"http://{parts.netloc}", "Authorization": f"Bearer {token}"}


def get(address: str, path: str, headers: dict[str, str] | None = None) -> tuple[int, bytes]:
    connection = http.client.HTTPConnection(urlsplit(address).netloc, timeout=120)
    connection.request("GET", path, headers=headers_of(address) if headers is None else headers)
    response = connection.getresponse()
    answered = response.status, response.read()
    connection.close()
    return answered


def uploads(home: Path) -> list[Path]:
    return list(home.glob("uploads/*/"))


def until(done: Callable[[], object]) -> None:
    """Wait; fails where it does not come."""
    deadline = time.monotonic() + 60
    while not done() and time.monotonic() < deadline:
        time.sleep(0.02)
    assert done()


def begin_upload(address: str) -> http.client.HTTPConnection:
    """A video that never ends."""
    parts = urlsplit(address)
    connection = http.client.HTTPConnection(parts.netloc, timeout=120)
    connection.putrequest("POST", "/api/clips?name=film.mp4")
    for name, value in {**headers_of(address), "Content-Length": "1000000"}.items():
        connection.putheader(name, value)
    connection.endheaders()
    connection.send(bytes(100_000))
    return connection


@pytest.mark.skipif(os.name != "posix", reason="signals of POSIX")
@pytest.mark.usefixtures("unmeasured")
@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_it_serves_until_it_is_ended_and_leaves_nothing(
    start: Start, home: Path, number: int
) -> None:
    child = start("studio", "--no-open")
    address = line(child).strip()
    assert address.startswith("http://127.0.0.1:")
    assert get(address, "/api/state")[0] == 200
    assert get(address, "/api/state", {})[0] == 403
    upload = begin_upload(address)
    until(lambda: list(home.glob("uploads/*/*")))
    (file,) = home.glob("uploads/*/*")
    assert file.stat().st_mode & 0o777 == 0o600
    child.send_signal(number)
    stdout, stderr = child.communicate(timeout=120)
    assert (child.returncode, stdout, stderr) == (0, "", "Ctrl-C ends it.\n")
    assert not uploads(home)
    upload.close()
    assert not (home / "support.db").exists()


@pytest.mark.skipif(os.name != "posix", reason="signals of POSIX")
def test_a_crash_leaves_nothing_either(start: Start, home: Path) -> None:
    child = start("studio", "--no-open", "-q")
    upload = begin_upload(line(child).strip())
    assert uploads(home)
    child.kill()
    child.wait()
    until(lambda: not uploads(home))
    upload.close()


def test_two_at_once_and_json(start: Start, home: Path) -> None:
    first, second = (start("studio", "--no-open", "--json") for _ in range(2))
    addresses = [json.loads(line(child))["address"] for child in (first, second)]
    assert [get(address, "/api/state")[0] for address in addresses] == [200, 200]
    assert get(addresses[1], "/api/state", headers_of(addresses[0]))[0] == 403


@pytest.mark.parametrize("words", [("studio",), ("watch", "rtsp://me:secret@a/b", "--page")])
def test_the_browser_is_given_a_file_that_nobody_else_can_read(
    start: Start, home: Path, tmp_path: Path, words: tuple[str, ...]
) -> None:
    seen = tmp_path / "seen"
    browser = tmp_path / "browser"
    browser.write_text(f'#!/bin/sh\nprintf "%s" "$1" > {seen}.part && mv {seen}.part {seen}\n')
    browser.chmod(0o700)
    child = start(*words, BROWSER=str(browser))
    address = line(child).strip()
    source = json.loads(get(address, "/api/state")[1])["source"]
    assert source == ("rtsp://a/b" if "--page" in words else None)
    until(seen.exists)
    opened = urlsplit(seen.read_text())
    assert opened.scheme == "file"
    page = Path(opened.path)
    assert page.stat().st_mode & 0o777 == 0o600
    assert page.parent.stat().st_mode & 0o777 == 0o700
    assert address in page.read_text(encoding="utf-8")


def test_what_cannot_be_served_is_told(
    run: Run, invoke: Invoke, home: Path, tmp_path: Path, start: Start
) -> None:
    port = urlsplit(line(start("studio", "--no-open")).strip()).port
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
def test_review_has_a_page_too(start: Start, invoke: Invoke, home: Path, tmp_path: Path) -> None:
    folder = tmp_path / "seen"
    clip = read_clip(EXAMPLES / "squat/ada.npz")
    event = Event("squat", 0.0, clip.duration, 0.6)
    Recorder(folder, Threshold(0.5, ""), "0").update(clip, clip.duration, [], [event], False)
    child = start("review", folder, "--page", "--no-open")
    address = line(child).strip()
    assert get(address, "/api/waiting")[0] == 200
    child.send_signal(signal.SIGINT)
    stdout, _ = child.communicate(timeout=120)
    assert (child.returncode, stdout) == (0, "nothing was changed\n")
    assert not uploads(home)
    assert invoke("review", folder, "--no-open").exit_code == 2
    assert invoke("review", tmp_path / "none", "--page", "--no-open").exit_code == 2
    assert "With --page: address" in invoke("review", "--help").stdout


def test_it_is_the_support_set_of_the_commands(start: Start, store: SupportStore) -> None:
    store.enroll("squat", read_clip(EXAMPLES / "squat/ada.npz"))
    child = start("studio", "--no-open")
    state = json.loads(get(line(child).strip(), "/api/state")[1])
    assert state["store"] == str(store.path)
    assert [action["label"] for action in state["actions"]] == ["squat"]
