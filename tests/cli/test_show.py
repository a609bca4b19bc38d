"""`show`: the list of examples, and their pictures."""

import json
import os
from pathlib import Path

import pytest

from actioncli import SupportStore

from .conftest import invoke, run, shaking


def has_braille(text: str) -> bool:
    return any("\u2800" < c <= "\u28ff" for c in text)


def test_a_picture_of_all_examples(filled: SupportStore, tmp_path: Path) -> None:
    for more, fixed in ([], False), (["--dark", "--force"], True):
        file = tmp_path / "wave.svg"
        result = invoke("show", "wave", "-o", file, *more)
        assert result.exit_code == 0, result.stderr
        assert result.stdout.startswith("wave: 1 example\n")
        assert not has_braille(result.stdout)
        assert f"drawn in {file}" in result.stderr
        assert ("prefers-color-scheme" not in file.read_text()) == fixed


def test_one_example_of_several(store: SupportStore, tmp_path: Path) -> None:
    store.enroll_all([("wave", shaking(0)), ("wave", shaking(1))], note="porch")
    shown = invoke("show", "wave").stdout
    assert shown.startswith("wave: 2 examples\n")
    assert shown.index("clip0.npy") < shown.index("porch") < shown.index("clip1.npy")
    second = store.examples("wave")[1].id
    file = tmp_path / "a.svg"
    document = json.loads(invoke("show", "wave", "--example", second, "-o", file, "--json").stdout)
    [example] = document["examples"]
    assert (example["id"], example["source"]) == (second, "clip1.npy")
    assert (example["frames"], example["fps"]) == (12, 30.0)
    assert document["drawn"] == str(file)
    assert "clip1.npy" in file.read_text()
    assert "clip0.npy" not in file.read_text()
    result = invoke("show", "wave", "--example", 99)
    assert result.exit_code == 4
    assert "no example 99" in result.stderr


def test_drawn_in_the_terminal_where_no_file_is_asked_for(
    filled: SupportStore, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("COLUMNS", "80")
    result = invoke("show", "squat")
    assert has_braille(result.stdout)
    assert "\x1b" not in result.stdout
    assert not has_braille(invoke("show", "squat", "-q").stdout)
    assert json.loads(invoke("show", "squat", "--json").stdout)["drawn"] is None


def test_a_terminal_without_unicode_gets_ascii(filled: SupportStore) -> None:
    done = run("show", "squat", env={**os.environ, "PYTHONIOENCODING": "ascii"})
    assert done.returncode == 0
    assert "#" in done.stdout
    assert "\\u28" not in done.stdout
