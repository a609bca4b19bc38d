"""Uploaded clips: read, cancelled, dropped."""

import shutil
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from actioncli import ClipError, Recognizer
from actioncli.errors import SupportError
from actioncli.pose import ReadOptions
from actioncli.studio import uploads as module
from actioncli.studio.uploads import Uploads, check_kind
from tests.pose.videos import write_video

from .serving import EXAMPLES, until


@pytest.fixture(scope="module")
def recognizer() -> Recognizer:
    return Recognizer()


@pytest.fixture
def uploads(recognizer: Recognizer) -> Iterator[Uploads]:
    made = Uploads(recognizer)
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


def test_a_clip_is_read_and_its_file_deleted(uploads: Uploads, tmp_path: Path) -> None:
    file = tmp_path / "upload.npz"
    file.write_bytes((EXAMPLES / "squat/ada.npz").read_bytes())
    sent = uploads.add(file, "folder/my squat.npz", ReadOptions(cache=False))
    until(sent.reading.done)
    clip = uploads.get(sent.id).clip()
    assert clip.source == sent.name == "my squat.npz"
    until(lambda: not file.exists())


def test_a_video_tells_how_far_it_is_and_stops_when_told(uploads: Uploads, film: Path) -> None:
    sent = uploads.add(film, "film.avi", ReadOptions(cache=False))
    until(lambda: sent.progress is not None and sent.progress.seconds > 0.2)
    assert sent.progress is not None
    assert sent.progress.total == pytest.approx(60, abs=1)
    with pytest.raises(ClipError, match="still being read"):
        sent.clip()
    uploads.discard(sent.id)
    until(sent.reading.done)
    until(lambda: not film.exists())
    with pytest.raises(SupportError, match="send it again"):
        uploads.get(sent.id)


def test_a_video_that_nobody_waits_for_is_not_read_on(
    uploads: Uploads, film: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(module, "_PATIENCE", 0.3)
    sent = uploads.add(film, "film.avi", ReadOptions(cache=False))
    until(sent.reading.done)
    until(lambda: not film.exists())
    assert "nobody waited" in sent.error()


def test_what_waits_in_the_queue_goes_too(
    recognizer: Recognizer, tmp_path: Path, film: Path
) -> None:
    uploads = Uploads(recognizer)
    copies = [tmp_path / f"{n}.avi" for n in range(4)]
    for copy in copies:
        copy.write_bytes(film.read_bytes())
        uploads.add(copy, copy.name, ReadOptions(cache=False))
    uploads.close()
    assert not any(copy.exists() for copy in copies)


def test_the_oldest_goes_that_nobody_asks_for(
    uploads: Uploads, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(module, "_MOST", 2)
    sent = []
    for n in range(4):
        file = tmp_path / f"{n}.npz"
        file.write_bytes(b"no clip")
        if n == 3:
            for left in sent[:2]:
                left.asked -= 2 * module._PATIENCE
        sent.append(uploads.add(file, file.name, ReadOptions(cache=False)))
    for dropped in sent[:2]:
        with pytest.raises(SupportError):
            uploads.get(dropped.id)
    assert [uploads.get(each.id) for each in sent[2:]] == sent[2:]


def test_of_a_hundred_sent_at_once_none_is_lost(uploads: Uploads, tmp_path: Path) -> None:
    sent = []
    for n in range(100):
        file = Path(shutil.copy(EXAMPLES / "squat/ada.npz", tmp_path / f"{n}.npz"))
        sent.append(uploads.add(file, file.name, ReadOptions(cache=False)))
    until(lambda: all(uploads.get(each.id).reading.done() for each in sent), 120)
    assert not any(each.error() for each in sent)


def test_a_bug_is_told_and_not_hidden(
    uploads: Uploads, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def broken(*_: object, **__: object) -> None:
        raise ZeroDivisionError("by zero")

    monkeypatch.setattr(module, "read_any", broken)
    file = tmp_path / "x.npz"
    file.touch()
    sent = uploads.add(file, "x.npz", ReadOptions(cache=False))
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
