"""The splits file: what it gives and how it fails."""

import json
from contextlib import suppress
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from actioncli.errors import UsageError
from actioncli.evaluation.splits import Split, read_splits


def write(folder: Path, content: object) -> Path:
    file = folder / "splits.json"
    file.write_text(content if isinstance(content, str) else json.dumps(content))
    return file


def test_reads_the_parts_of_each_collection(tmp_path: Path) -> None:
    splits = read_splits(write(tmp_path, {"a": {"train": ["x"], "benchmark": ["y", "z"]}}))
    assert splits.by_collection == {"a": Split(("x",), ("y", "z"), ())}
    assert splits.names("a", "benchmark", ["x", "y", "z"]) == ("y", "z")
    assert splits.names("a", "excluded", ["x"]) == ()


def test_missing_file_unknown_collection_and_missing_class_are_named(tmp_path: Path) -> None:
    with pytest.raises(UsageError, match="cannot read the splits"):
        read_splits(tmp_path / "none.json")
    splits = read_splits(write(tmp_path, {"a": {"train": ["x"]}}))
    with pytest.raises(UsageError, match=r"splits\.json: says nothing .* 'b', only about a"):
        splits.names("b", "train", ["x"])
    with pytest.raises(UsageError, match="not in it: x"):
        splits.names("a", "train", ["y"])


@pytest.mark.parametrize(
    ("content", "message"),
    [
        ("{", "no JSON"),
        ("[" * 100_000, "no JSON"),
        ([], "object with a key per collection"),
        ({"a": []}, "object with the keys train, benchmark, excluded"),
        ({"a": {"test": []}}, "has the keys test"),
        ({"a": {"train": "x"}}, "train must be a list"),
        ({"a": {"train": [1]}}, "train must be a list"),
        ({"a": {"train": ["x"], "excluded": ["x"]}}, "names x more than once"),
    ],
)
def test_wrong_content_is_a_usage_error(tmp_path: Path, content: object, message: str) -> None:
    with pytest.raises(UsageError, match=message):
        read_splits(write(tmp_path, content))


@given(st.binary(max_size=60))
def test_any_bytes_give_splits_or_a_usage_error(
    tmp_path_factory: pytest.TempPathFactory, content: bytes
) -> None:
    file = tmp_path_factory.mktemp("any") / "splits.json"
    file.write_bytes(content)
    with suppress(UsageError):
        read_splits(file)
