"""Names that are no UTF-8: a file from another system, or from somebody who means harm."""

import os
from pathlib import Path

import pytest
from starlette.requests import Request

import actioncli
from actioncli import SupportSet, SupportStore, read_clip
from actioncli.archives.batch import Task
from actioncli.archives.results import Results, storable
from actioncli.clips.write import write_clip
from actioncli.pose.frames import VideoFile
from actioncli.pose.mp4 import mp4_writer
from actioncli.studio.app import Studio
from actioncli.studio.review import Review
from actioncli.studio.upload_folder import UploadFolder
from tests.cli.test_evaluate import toys
from tests.pose.videos import number, numbered, write_video

from .conftest import EXAMPLES, invoke

__all__ = ["toys"]

# Python has the byte that is none as half a character.
ODD = os.fsdecode(b"o\xffdd")


@pytest.fixture
def odd(tmp_path: Path) -> Path:
    """A folder of such a name."""
    folder = tmp_path / ODD
    try:
        folder.mkdir()
    except OSError:
        pytest.skip("this file system has no such names")
    return folder


def test_videos_are_read_and_written(odd: Path) -> None:
    images = numbered(8)
    file = write_video(odd.parent / "a.mp4", images).rename(odd / f"{ODD}.mp4")
    seen = list(VideoFile(file).frames())
    assert [number(frame.image) for frame in seen] == list(range(8))
    with mp4_writer(odd / "b.mp4", 25.0, ("vp09", "mp4v")) as write:
        for image in images:
            write(image)
    assert len(list(VideoFile(odd / "b.mp4").frames())) == 8


def test_a_clip_is_enrolled_explained_and_shown(odd: Path, filled: SupportStore) -> None:
    clip = odd / f"{ODD}.npz"
    clip.write_bytes((EXAMPLES / "squat/ben.npz").read_bytes())
    page = odd / f"{ODD}.html"
    result = invoke("classify", clip, "--explain", page)
    assert result.exit_code == 0, result.output
    assert "<title>Accepted: o\\udcffdd.npz</title>" in page.read_text(encoding="utf-8")
    assert invoke("enroll", ODD, clip).exit_code == 2
    assert invoke("enroll", "squat", clip).exit_code == 0
    for kind in ("svg", "png", "gif", "mp4"):
        result = invoke("show", "squat", "-o", odd / f"squat.{kind}")
        assert result.exit_code == 0, result.output
    [added] = [each for each in filled.examples("squat") if "dd.npz" in each.source]
    added.source.encode()


@pytest.mark.parametrize("kind", ["npz", "json", "csv", "trc"])
def test_a_clip_is_written_and_read_back(odd: Path, kind: str) -> None:
    clip = odd / f"{ODD}.npz"
    clip.write_bytes((EXAMPLES / "squat/ben.npz").read_bytes())
    file = odd / f"written.{kind}"
    write_clip(file, read_clip(clip))
    assert len(read_clip(file, up="y")) == len(read_clip(clip))


def test_a_collection_is_evaluated(odd: Path, toys: Path) -> None:
    collection = odd / f"{ODD}.npz"
    collection.write_bytes((toys / "one.npz").read_bytes())
    figures = odd / "figures.json"
    result = invoke(
        "evaluate", collection, "--baseline", "always-reject", "--ways", 2, "--episodes", 2,
        "--weights", toys / "w.safetensors", "--json", figures,
    )  # fmt: skip
    assert result.exit_code == 0, result.output
    assert "o\\udcffdd" in figures.read_text(encoding="utf-8")


def test_an_archive_is_classified(odd: Path, filled: SupportStore) -> None:
    pytest.importorskip("pyarrow", reason="needs the extra `ray`")
    squat = {"squat": [read_clip(EXAMPLES / "squat/ada.npz")]}
    task = Task(SupportSet.from_clips(squat, tau=0.5))
    # Beside one whose name says in so many characters what the other's is told as.
    files = {odd / f"{ODD}.npz": "squat/ben.npz", odd.parent / "o\\udcffde.npz": "bow/ben.npz"}
    for file, example in files.items():
        file.write_bytes((EXAMPLES / example).read_bytes())
    with Results.opened(odd.parent / "out.parquet", {"INPUT": storable(str(odd))}) as results:
        results.set_files(files)
        for source in results.missing(9):
            source.encode()
            results.add(task.row(source))
        assert results.count() == {
            "files": 2, "done": 2, "accepted": 1, "rejected": 1, "failed": 0,
        }  # fmt: skip
        results.finish()


def test_pages_serve_a_support_set(odd: Path) -> None:
    actions = actioncli.open(odd / f"{ODD}.db")
    actions.store.enroll("squat", read_clip(EXAMPLES / "squat/ada.npz"))
    uploads = UploadFolder()
    studio = Studio(actions, uploads)
    request = Request({"type": "http", "method": "GET", "query_string": b"", "headers": []})
    try:
        assert b"o\\udcffdd.db" in studio.state(request).body
    finally:
        studio.close()
        uploads.close()
    assert b"o\\udcffdd" in Review(actions, odd).waiting(request).body
