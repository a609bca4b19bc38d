"""Files that commands write: never over what they read, nor unasked over what is not theirs."""

import os
import shutil
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from actioncli import SupportStore
from actioncli.cli.extract import _targets
from actioncli.cli.train import _is_weights
from actioncli.errors import UsageError
from actioncli.files import weights_file
from actioncli.model.weights import DEFAULT_WEIGHTS
from tests.forking import files_up_to

from .conftest import EXAMPLES, ask, invoke, write_collection

SQUAT = EXAMPLES / "squat/ada.npz"


@pytest.fixture
def clip(tmp_path: Path) -> Path:
    return Path(shutil.copy(SQUAT, tmp_path / "clip.npz"))


@pytest.mark.parametrize("link", [os.link, os.symlink])
@pytest.mark.parametrize(
    "words", ["classify clip.npz --explain same.html", "classify clip.mp4 --annotate same.mp4",
              "extract clip.mp4 -o same.npz"],
)  # fmt: skip
def test_an_input_is_not_written_over_by_any_name(
    filled: SupportStore, clip: Path, monkeypatch: pytest.MonkeyPatch,
    link: Callable[[str, str], None], words: str,
) -> None:  # fmt: skip
    monkeypatch.chdir(clip.parent)
    _, read, _, written = words.split()
    if read != clip.name:
        clip = clip.rename(read)
    before = clip.read_bytes()
    link(read, written)
    for more in ([], ["--force"]):
        result = invoke(*words.split(), *more)
        assert (result.exit_code, f"is {read} itself" in result.stderr) == (2, True), result.stderr
    assert clip.read_bytes() == before


def test_what_stands_there_is_written_over_by_force_or_where_it_is_a_page_of_ours(
    filled: SupportStore, tmp_path: Path
) -> None:
    page = tmp_path / "why.html"
    page.write_text("mine")
    words = ["classify", SQUAT, "--explain", page]
    result = invoke(*words)
    assert (result.exit_code, "--force" in result.stderr) == (2, True)
    assert page.read_text() == "mine"
    picture = page.rename(tmp_path / "squat.svg")
    assert invoke("show", "squat", "-o", picture).exit_code == 2
    assert invoke("show", "squat", "-o", picture, "--force").exit_code == 0
    other = tmp_path / "other"
    other.write_text("mine")
    page.symlink_to(other)
    assert invoke(*words, "--force").exit_code == 0
    assert (other.read_text(), page.is_symlink()) == ("mine", False)
    assert invoke(*words).exit_code == 0
    assert "mine" not in page.read_text(encoding="utf-8").split()
    (tmp_path / "why.npz").touch()
    with pytest.raises(UsageError, match="--force"):
        _targets([tmp_path / "a.mp4", tmp_path / "why.mp4"], tmp_path, "npz", False)


@pytest.mark.parametrize(
    ("videos", "files"),
    [
        (["a/v.mp4", "a/w.mp4"], ["v.npz", "w.npz"]),
        (["a/v.mp4", "b/V.mp4"], ["a/v.npz", "b/V.npz"]),
        (["a/v.mp4", "a/b/v.mp4"], ["v.npz", "b/v.npz"]),
        (["a/v.mp4", "a/v.avi"], ["v.mp4.npz", "v.avi.npz"]),
    ],
)
def test_videos_of_one_name_get_folders_as_they_came(
    tmp_path: Path, videos: list[str], files: list[str]
) -> None:
    found = _targets([tmp_path / video for video in videos], tmp_path / "out", None, False)
    assert found == [tmp_path / "out" / file for file in files]


def test_folders_are_meant_by_name_first_and_an_empty_name_is_none(
    store: SupportStore, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    for folder in ("day[1]", "day1"):
        shutil.copytree(EXAMPLES / "squat", folder)
    for pattern in ("day[1]", "day[1]/*.npz", tmp_path / "day[1]" / "*.npz"):
        clips = ask("enroll", "squat", pattern)["clips"]
        assert {Path(clip["source"]).parent.name for clip in clips} == {"day[1]"}
    empty = (
        ["enroll", "squat", ""],
        ["enroll", "--negative", ""],
        ["classify", ""],
        ["extract", "", "-o", "a.npz"],
        ["batch", "", "out.csv"],
    )
    for words in empty:
        result = invoke(*words)
        assert (result.exit_code, "a name is empty" in result.stderr) == (2, True), words


def test_a_full_disk_is_one_exit_code(filled: SupportStore, tmp_path: Path) -> None:
    new = EXAMPLES / "squat/ben.npz"
    for words in (["classify", SQUAT, "--explain", tmp_path / "why.html"],
                  ["batch", EXAMPLES / "squat", tmp_path / "out.csv"],
                  ["show", "squat", "-o", tmp_path / "a.svg"],
                  ["export", tmp_path / "out"], ["enroll", "squat", new]):  # fmt: skip
        with files_up_to(500):
            result = invoke(*words)
        assert result.exit_code == 74, (words, result.stderr)
        assert result.stderr.splitlines()[-1].startswith("error: ")
    assert len(filled.examples()) == 5


def test_weights_of_ones_own_are_named(filled: SupportStore, tmp_path: Path) -> None:
    usual = ask("classify", SQUAT)["weights"]
    own = shutil.copy(EXAMPLES.parent / "weights/trx_os.safetensors", tmp_path / "own.safetensors")
    result = invoke("classify", SQUAT, "--weights", own)
    assert f"weights: {own} ({usual})" in result.stderr
    assert "weights: " not in invoke("classify", SQUAT).stderr
    assert ask("enroll", "squat", SQUAT)["weights"] == usual


def test_figures_and_weights_go_over_their_own_kind_only(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    write_collection(tmp_path / "a.npz", 6, 3, 2, np.random.default_rng(0))
    line = "evaluate a.npz --ways 2 --episodes 1 --baseline random --json"
    asked = line.split()
    (tmp_path / "mine.json").write_text('{"mine": 1}', encoding="utf-8")
    for file in ("mine.json", "a.npz"):
        before = (tmp_path / file).read_bytes()
        refused = invoke(*asked, file)
        assert refused.exit_code == 2
        assert (tmp_path / file).read_bytes() == before
    assert "--force writes over it" in invoke(*asked, "mine.json").stderr
    for words in ([*asked, "mine.json", "--force"], [*asked, "mine.json"], [*asked, "new.json"]):
        assert invoke(*words).exit_code == 0, words
    pytest.importorskip("torch", reason="needs the extra train")
    for file in ("new.json", "a.npz"):
        refused = invoke("train", "a.npz", "--out", file)
        assert (refused.exit_code, file in refused.stderr) == (2, True)
    # Weights are written anew, or trained on where a run was interrupted.
    assert _is_weights(weights_file(DEFAULT_WEIGHTS))
