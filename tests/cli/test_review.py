"""`review`: recorded clips on a terminal, one key each."""

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

from actioncli import SupportStore, read_clip
from tests.studio.serving import record

from .conftest import EXAMPLES, invoke


@pytest.fixture
def seen(tmp_path: Path) -> Path:
    """A folder with three recorded events."""
    folder = tmp_path / "seen"
    record(folder, "squat", "wave", "bow")
    return folder


def press(folder: Path, *keys: str) -> tuple[int, str, str]:
    """Run `review` on a terminal and type at each prompt.

    Returns:
        Its exit code, standard output, and what it wrote to standard error after the last key.
    """
    terminal, stdin = os.openpty()
    words = [sys.executable, "-m", "actioncli", "review", str(folder)]
    with (folder.parent / "stdout").open("w+", encoding="utf-8") as stdout:
        with subprocess.Popen(words, stdin=stdin, stdout=stdout, stderr=subprocess.PIPE) as run:
            assert run.stderr is not None
            for key in keys:
                asked = b""
                while not asked.endswith((b"quit: ", b"action:")):
                    asked += run.stderr.read(1) or pytest.fail(f"ended before {key!r}: {asked!r}")
                os.write(terminal, key.encode())
            told = run.stderr.read().decode()
        os.close(stdin)
        os.close(terminal)
        stdout.seek(0)
        return run.returncode, stdout.read(), told


def test_waiting_clips_are_listed(seen: Path) -> None:
    clips = json.loads(invoke("review", seen, "--json").stdout)["clips"]
    assert [clip["label"] for clip in clips] == ["squat", "wave", "bow"]
    keys = "file, label, confidence, tau, event, start, end, source"
    assert set(clips[0]) == set(keys.split(", "))
    assert keys in invoke("review", "--help").stdout


def test_enrolled_as_told_and_as_a_negative_and_deleted(store: SupportStore, seen: Path) -> None:
    code, said, _ = press(seen, "e", "n", "d")
    assert code == 0
    assert "1 of 3: event, squat, confidence 0.60, tau 0.50, camera 0" in said
    assert "\u2594" in said
    assert "1 clip enrolled, 1 clip enrolled as negatives, 1 clip deleted" in said
    assert [(e.label, e.negative) for e in store.examples()] == [
        ("negatives", True),
        ("squat", False),
    ]
    assert "camera 0" in store.examples("squat")[0].note
    assert not list(seen.iterdir())


def test_skipped_renamed_and_left_at_quitting(store: SupportStore, seen: Path) -> None:
    code, said, _ = press(seen, "x", "s", "o", "deep squat\n", "q")
    assert code == 0
    assert said.endswith("1 clip enrolled\n")
    assert [e.label for e in store.examples()] == ["deep squat"]
    assert sorted(file.name for file in seen.glob("*.npz")) == ["0001_squat.npz", "0003_bow.npz"]


def test_warned_as_enroll_does(store: SupportStore, seen: Path) -> None:
    store.enroll("squat", read_clip(EXAMPLES / "squat/ben.npz"))
    code, _, told = press(seen, "s", "s", "o", "knee bend\n")
    assert code == 0
    assert "warning: closest to `squat`" in told


def test_nobody_to_ask_and_nothing_to_review(seen: Path, tmp_path: Path) -> None:
    result = invoke("review", seen)
    assert result.exit_code == 2
    assert "--json lists" in result.stderr
    (tmp_path / "empty").mkdir()
    result = invoke("review", tmp_path / "empty")
    assert (result.exit_code, result.stdout) == (0, "")
    assert "Nothing waits" in result.stderr
    assert invoke("review", tmp_path / "none").exit_code == 2
