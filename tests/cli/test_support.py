"""list-support, show, remove, rename, clear."""

import json
import os
from pathlib import Path

import pytest

from actioncli import SupportStore

from .conftest import Invoke, MakeClip, Run


@pytest.fixture
def two(store: SupportStore, clip: MakeClip) -> SupportStore:
    """Two examples of `wave`, one of `squat`."""
    store.enroll_all([("wave", clip(0)), ("wave", clip(1))], note="porch")
    store.enroll("squat", clip(2))
    return store


def test_list_support(invoke: Invoke, two: SupportStore) -> None:
    result = invoke("list-support")
    assert result.exit_code == 0
    header, *rows = [line.split() for line in result.stdout.splitlines()]
    assert header == ["action", "examples", "seconds", "last", "added"]
    assert [row[:3] for row in rows] == [["squat", "1", "0.37"], ["wave", "2", "0.73"]]


def test_list_support_of_nothing_says_how_to_begin(invoke: Invoke, home: Path) -> None:
    result = invoke("list-support")
    assert (result.exit_code, result.stdout) == (0, "")
    assert "actioncli enroll LABEL CLIP" in result.stderr
    assert invoke("list-support", "-q").output == ""
    assert json.loads(invoke("list-support", "--json").stdout)["actions"] == []
    assert not home.exists()


def test_show(invoke: Invoke, two: SupportStore) -> None:
    result = invoke("show", "wave")
    assert result.exit_code == 0
    assert result.stdout.startswith("wave: 2 examples\n")
    assert "clip0.npy" in result.stdout
    assert "porch" in result.stdout
    shown = json.loads(invoke("show", "wave", "--json").stdout)
    assert [example["source"] for example in shown["examples"]] == ["clip0.npy", "clip1.npy"]
    assert shown["examples"][0]["frames"] == 12
    assert shown["examples"][0]["fps"] == 30.0


@pytest.mark.parametrize("words", [["show"], ["remove", "--yes"], ["rename", "new"]])
def test_unknown_label_is_code_4(invoke: Invoke, two: SupportStore, words: list[str]) -> None:
    command, *rest = words
    for label in ("clap", "'; DROP TABLE examples; --"):
        result = invoke(command, label, *rest)
        assert result.exit_code == 4
        assert result.stderr.startswith("error: ")
    result = invoke(command, "clap", *rest, "--json")
    assert json.loads(result.stdout)["error"]["type"] == "SupportError"
    assert len(two.examples()) == 3


def test_remove_an_example_and_an_action(invoke: Invoke, two: SupportStore) -> None:
    first, second = two.examples("wave")
    result = invoke("remove", "wave", "--example", first.id, "--yes")
    assert (result.exit_code, result.stdout) == (0, "wave: 1 example removed\n")
    assert invoke("remove", "wave", "--example", first.id, "--yes").exit_code == 4
    assert [example.id for example in two.examples("wave")] == [second.id]
    assert json.loads(invoke("remove", "wave", "-y", "--json").stdout)["removed"] == 1
    assert [action.label for action in two.actions()] == ["squat"]


@pytest.mark.parametrize("words", [["remove", "wave"], ["clear"]])
def test_nothing_is_removed_where_nobody_can_be_asked(
    invoke: Invoke, two: SupportStore, words: list[str]
) -> None:
    for more in ([], ["--json"]):
        result = invoke(*words, *more, typed="y\n")
        assert result.exit_code == 2
        assert "--yes" in result.stderr
    assert len(two.examples()) == 3


@pytest.mark.skipif(os.name != "posix", reason="needs a pseudo-terminal")
@pytest.mark.parametrize("words", [["remove", "wave"], ["clear"]])
@pytest.mark.parametrize(
    ("typed", "code", "left"),
    [(b"n\n", 0, 3), (b"\n", 0, 3), (b"\x04", 130, 3), (b"y\n", 0, None)],
    ids=["no", "return", "end of input", "yes"],
)
def test_the_answer_on_a_terminal_decides(
    run: Run, two: SupportStore, words: list[str], typed: bytes, code: int, left: int | None
) -> None:
    terminal, stdin = os.openpty()
    os.write(terminal, typed)
    done = run(*words, stdin=stdin)
    os.close(stdin)
    os.close(terminal)
    assert done.returncode == code
    assert "Remove " in done.stderr
    if left is None:
        assert "removed" in done.stdout
        assert "wave" not in [action.label for action in two.actions()]
    else:
        assert not done.stdout.strip()
        assert len(two.examples()) == left


def test_rename(invoke: Invoke, two: SupportStore) -> None:
    assert invoke("rename", "wave", "hello [bold]you").exit_code == 0
    # What looks like markup is a label like any other.
    assert "hello [bold]you" in invoke("list-support").stdout
    assert invoke("rename", "squat", "hello [bold]you").exit_code == 2
    assert invoke("rename", "squat", "a\x07b").exit_code == 2
    renamed = json.loads(invoke("rename", "squat", "sit", "--json").stdout)
    assert renamed == {"old": "squat", "new": "sit", "examples": 1}


def test_clear(invoke: Invoke, two: SupportStore) -> None:
    assert invoke("clear", "--yes").stdout == "3 examples removed\n"
    assert json.loads(invoke("clear", "--yes", "--json").stdout) == {"removed": 0}


@pytest.mark.parametrize("command", ["list-support", "show", "remove", "clear", "export"])
def test_a_file_that_is_no_store_is_code_5(invoke: Invoke, tmp_path: Path, command: str) -> None:
    broken = tmp_path / "broken.db"
    broken.write_text("not a database, but long enough to be taken for one" * 40)
    out = str(tmp_path / "out")
    words = {"show": ["x"], "remove": ["x", "-y"], "clear": ["-y"], "export": [out]}
    result = invoke(command, *words.get(command, []), "--store", broken)
    assert result.exit_code == 5
    [line] = result.stderr.splitlines()
    assert "broken.db" in line
    assert broken.read_text().startswith("not a database")
