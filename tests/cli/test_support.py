"""list-support, show, remove, rename, clear."""

import json
import sys
from pathlib import Path

import pytest

from actioncli import SupportStore
from actioncli.recognition.threshold import Threshold, keep_threshold, kept_threshold

from .conftest import ask, at_terminal, invoke, shaking


@pytest.fixture
def two(store: SupportStore) -> SupportStore:
    """Two examples of `wave`, one of `squat`."""
    store.enroll_all([("wave", shaking(0)), ("wave", shaking(1))], note="porch")
    store.enroll("squat", shaking(2))
    return store


def test_list_support(two: SupportStore) -> None:
    result = invoke("list-support")
    assert result.exit_code == 0
    header, *rows = [line.split() for line in result.stdout.splitlines()]
    assert header == ["action", "examples", "seconds", "last", "added"]
    assert [row[:3] for row in rows] == [["squat", "1", "0.37"], ["wave", "2", "0.73"]]


def test_list_support_of_nothing_says_how_to_begin(home: Path) -> None:
    result = invoke("list-support")
    assert (result.exit_code, result.stdout) == (0, "")
    assert "actioncli enroll LABEL CLIP" in result.stderr
    assert invoke("list-support", "-q").output == ""
    assert json.loads(invoke("list-support", "--json").stdout)["actions"] == []
    assert not home.exists()


def test_remove_an_example_and_an_action(two: SupportStore) -> None:
    first, second = two.examples("wave")
    result = invoke("remove", "wave", "--example", first.id, "--yes")
    assert (result.exit_code, result.stdout) == (0, "wave: 1 example removed\n")
    assert invoke("remove", "wave", "--example", first.id, "--yes").exit_code == 4
    assert [example.id for example in two.examples("wave")] == [second.id]
    assert json.loads(invoke("remove", "wave", "-y", "--json").stdout)["removed"] == 1
    assert [action.label for action in two.actions()] == ["squat"]


@pytest.mark.parametrize("words", [["remove", "wave"], ["clear"]])
@pytest.mark.parametrize(
    ("typed", "code", "left"),
    [(b"n\n", 0, 3), (b"\n", 0, 3), (b"\x04", 130, 3), (b"y\n", 0, None)],
    ids=["no", "return", "end of input", "yes"],
)
def test_the_answer_on_a_terminal_decides(
    two: SupportStore, words: list[str], typed: bytes, code: int, left: int | None
) -> None:
    words = [sys.executable, "-m", "actioncli", *words]
    done, _ = at_terminal(words, "stdin", typed=typed)
    assert done.returncode == code
    assert "Remove " in done.stderr
    if left is None:
        assert "removed" in done.stdout
        assert "wave" not in [action.label for action in two.actions()]
    else:
        assert not done.stdout.strip()
        assert len(two.examples()) == left


def test_rename(two: SupportStore) -> None:
    assert invoke("rename", "wave", "挥手 <b>[bold]🤷</b>").exit_code == 0
    # What looks like markup is a label like any other.
    assert "挥手 <b>[bold]🤷</b>" in invoke("list-support").stdout
    assert ask("rename", "squat", "sit") == {"old": "squat", "new": "sit", "examples": 1}


def test_clear(two: SupportStore) -> None:
    keep_threshold(two, Threshold(0.9, "w"))
    assert invoke("clear", "--yes").stdout == "3 examples removed\n"
    assert kept_threshold(two) is None
    assert ask("clear", "--yes") == {"removed": 0}
