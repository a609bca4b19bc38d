"""Where uploads lie, and what is deleted of what lies there."""

import os
import time
from pathlib import Path

import pytest

from actioncli.errors import UsageError
from actioncli.studio.upload_folder import UploadFolder


@pytest.fixture
def cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The user's cache folder."""
    monkeypatch.setenv("ACTIONCLI_HOME", str(tmp_path))
    return tmp_path


def age(*paths: Path) -> None:
    """Make files and folders eight days old."""
    for path in paths:
        then = time.time() - 8 * 24 * 3600
        os.utime(path, (then, then), follow_symlinks=False)


def open_and_close() -> None:
    UploadFolder().close()


def test_what_a_killed_studio_left_goes(cache: Path) -> None:
    left = UploadFolder()
    left._sweeper.kill()
    left._sweeper.communicate()
    (left.folder / ".actioncli-x_1.part").touch()
    files = [left.file(".mp4"), *left.folder.iterdir()]
    open_and_close()
    assert files[0].exists()
    age(*files, left.folder)
    open_and_close()
    assert [entry.name for entry in (cache / "uploads").iterdir()] == [".actioncli-uploads"]


def test_what_the_tool_did_not_make_survives(cache: Path) -> None:
    open_and_close()
    uploads, hexadecimal = cache / "uploads", "0123456789abcdef" * 2
    folders = [cache / "studio-holiday", uploads / "studio-holiday", uploads / hexadecimal]
    for folder in folders:
        (folder / "inner").mkdir(parents=True)
        (folder / "photo.jpg").write_text("beach")
        (folder / "inner" / f"{hexadecimal}.mp4").write_text("film")
    linked = uploads / f"{hexadecimal[::-1]}"
    linked.symlink_to(folders[0])
    (folders[2] / f"{hexadecimal}.mp4").symlink_to(folders[0] / "photo.jpg")
    age(*cache.rglob("*"))
    before = sorted(cache.rglob("*"))
    open_and_close()
    assert sorted(cache.rglob("*")) == before


@pytest.mark.parametrize("content", [None, b"", b"a list of my uploads"])
def test_a_folder_of_somebody_else_is_refused(cache: Path, content: bytes | None) -> None:
    mine = cache / "uploads" / ("0123456789abcdef" * 2)
    mine.mkdir(parents=True)
    (mine / f"{mine.name}.mp4").write_text("film")
    if content is not None:
        (cache / "uploads" / ".actioncli-uploads").write_bytes(content)
    age(*cache.rglob("*"))
    before = sorted(cache.rglob("*"))
    with pytest.raises(UsageError, match="something else is there; move it"):
        UploadFolder()
    assert sorted(cache.rglob("*")) == before


def test_links_are_refused_and_an_empty_folder_is_used(cache: Path, tmp_path: Path) -> None:
    open_and_close()
    (cache / "uploads").rename(cache / "elsewhere")
    (cache / "uploads").symlink_to(cache / "elsewhere")
    with pytest.raises(UsageError, match="move it"):
        UploadFolder()
    (cache / "uploads").unlink()
    (cache / "uploads").mkdir()
    open_and_close()
    (cache / "uploads" / ".actioncli-uploads").unlink()
    (cache / "uploads" / ".actioncli-uploads").symlink_to(
        cache / "elsewhere" / ".actioncli-uploads"
    )
    with pytest.raises(UsageError, match="move it"):
        UploadFolder()


def test_a_folder_of_another_user_is_refused(cache: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    open_and_close()
    monkeypatch.setattr(os, "geteuid", lambda: os.getuid() + 1)
    with pytest.raises(UsageError, match="move it"):
        UploadFolder()
