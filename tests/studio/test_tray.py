"""Clips that were sent: read, cancelled, dropped."""

from __future__ import annotations

import shutil
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pytest

from actioncli import ClipError, Recognizer
from actioncli.errors import SupportError
from actioncli.pose.read import ReadOptions
from actioncli.studio import tray as tray_module
from actioncli.studio.tray import Tray, check_kind
from tests.pose.videos import write_video

from .serving import EXAMPLES


@pytest.fixture(scope="module")
def recognizer() -> Recognizer:
    return Recognizer()


@pytest.fixture
def tray(recognizer: Recognizer) -> Iterator[Tray]:
    made = Tray(recognizer)
    yield made
    made.close()


@pytest.fixture(scope="module")
def minute(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A minute in which nobody is seen: longer than anybody wants to wait."""
    grey = np.full((64, 96, 3), 128, np.uint8)
    file = tmp_path_factory.mktemp("film") / "film.avi"
    return write_video(file, [grey] * 900, fps=15, fourcc="MJPG")


@pytest.fixture
def film(tmp_path: Path, minute: Path) -> Path:
    """A copy of it, as it was uploaded."""
    return Path(shutil.copy(minute, tmp_path))


def until(done: Callable[[], bool], seconds: float = 60) -> None:
    deadline = time.monotonic() + seconds
    while not done() and time.monotonic() < deadline:
        time.sleep(0.01)
    assert done()


def test_a_clip_is_read_and_its_file_deleted(tray: Tray, tmp_path: Path) -> None:
    file = tmp_path / "upload.npz"
    file.write_bytes((EXAMPLES / "squat/ada.npz").read_bytes())
    sent = tray.add(file, "folder/my squat.npz", ReadOptions(cache=False))
    until(sent.reading.done)
    clip, embedding = tray.get(sent.id).clip()
    assert clip.source == sent.name == "my squat.npz"
    assert embedding.ndim == 2
    until(lambda: not file.exists())


def test_a_video_tells_how_far_it_is_and_stops_when_told(tray: Tray, film: Path) -> None:
    sent = tray.add(film, "film.avi", ReadOptions(cache=False))
    until(lambda: sent.progress is not None and sent.progress.seconds > 0.2)
    assert sent.progress is not None
    assert sent.progress.total == pytest.approx(60, abs=1)
    with pytest.raises(ClipError, match="still being read"):
        sent.clip()
    tray.discard(sent.id)
    until(sent.reading.done)
    until(lambda: not film.exists())
    with pytest.raises(SupportError, match="send it again"):
        tray.get(sent.id)


def test_a_video_that_nobody_waits_for_is_not_read_on(
    tray: Tray, film: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(tray_module, "_PATIENCE", 0.3)
    sent = tray.add(film, "film.avi", ReadOptions(cache=False))
    until(sent.reading.done)
    until(lambda: not film.exists())
    assert "nobody waited" in sent.error()


def test_what_waits_in_the_queue_goes_too(
    recognizer: Recognizer, tmp_path: Path, film: Path
) -> None:
    tray = Tray(recognizer)
    copies = [tmp_path / f"{n}.avi" for n in range(4)]
    for copy in copies:
        copy.write_bytes(film.read_bytes())
        tray.add(copy, copy.name, ReadOptions(cache=False))
    tray.close()
    assert not any(copy.exists() for copy in copies)


def test_the_oldest_goes_first(tray: Tray, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(tray_module, "_MOST", 2)
    sent = []
    for n in range(3):
        file = tmp_path / f"{n}.npz"
        file.write_bytes(b"no clip")
        sent.append(tray.add(file, file.name, ReadOptions(cache=False)))
    assert tray.get(sent[2].id) is sent[2]
    with pytest.raises(SupportError):
        tray.get(sent[0].id)


def test_a_bug_is_told_and_not_hidden(
    tray: Tray, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def broken(*_: object, **__: object) -> None:
        raise ZeroDivisionError("by zero")

    monkeypatch.setattr(tray_module, "read_any", broken)
    file = tmp_path / "x.npz"
    file.touch()
    sent = tray.add(file, "x.npz", ReadOptions(cache=False))
    until(sent.reading.done)
    assert "ZeroDivisionError: by zero (this is a bug)" in sent.error()
    until(lambda: not file.exists())


@pytest.mark.parametrize("name", ["a.MP4", "a.b.webm", "x.npz", "C:\\clips\\wave.JSON"])
def test_kinds_go_by_the_name(name: str) -> None:
    assert check_kind(name) == name[name.rindex(".") :].lower()


@pytest.mark.parametrize("name", ["", "wave", ".mp4", "a.exe", "a.mp4.zip"])
def test_other_kinds_are_refused(name: str) -> None:
    with pytest.raises(ClipError, match="neither a video"):
        check_kind(name)
