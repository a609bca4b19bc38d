"""The `evaluate` command on small made-up collections."""

import json
from pathlib import Path

import numpy as np
import pytest

from actioncli.model.config import ModelConfig
from actioncli.model.trx_os import parameter_shapes
from actioncli.model.weights import write_weights
from tests.forking import files_up_to

from .conftest import invoke, write_collection


@pytest.fixture(scope="module")
def toys(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Two collections, splits for them, and weights that were never trained."""
    folder = tmp_path_factory.mktemp("toys")
    rng = np.random.default_rng(0)
    for name, classes in (("one", 6), ("two", 5)):
        write_collection(folder / f"{name}.npz", classes, 4, 2, rng)
    four = [f"action {c}" for c in range(4)]
    parts = {name: {"benchmark": four, "train": ["action 4"]} for name in ("one", "two")}
    (folder / "splits.json").write_text(json.dumps(parts))
    config = ModelConfig()
    tensors = {
        name: rng.normal(0, 0.05, shape).astype(np.float32)
        for name, shape in parameter_shapes(config).items()
    }
    write_weights(folder / "w.safetensors", config, tensors, {})
    return folder


def test_table_has_a_row_for_each_collection_and_their_mean(toys: Path) -> None:
    result = invoke(
        "evaluate", toys / "one.npz", toys / "two.npz", "--baseline", "random", "--episodes", 3,
        "--ways", "2,5,8",
    )  # fmt: skip
    assert result.exit_code == 0
    rows = [
        [cell.strip() for cell in line.split("  ") if cell] for line in result.stdout.splitlines()
    ]
    ways = {name: [row[1] for row in rows if row[:1] == [name]] for name in ("one", "two")}
    assert ways == {"one": ["2", "5,8 (4)"], "two": ["2", "5,8 (3)"]}
    assert [row[1] for row in rows if row[:1] == ["mean of 2"]] == ["2", "5", "8"] * 2
    assert "FSOS-ACC" in result.stdout
    assert "calibration error" in result.stdout


@pytest.mark.parametrize("baseline", [None, "exp", "dtw", "dtw-cohort", "always-reject", "random"])
def test_json_goes_to_a_file_beside_the_table(
    toys: Path, tmp_path: Path, baseline: str | None
) -> None:
    file = tmp_path / "figures.json"
    chosen = ["--baseline", baseline] if baseline else []
    result = invoke(
        "evaluate", toys / "one.npz", "--splits", toys / "splits.json", "--episodes", 2,
        "--weights", toys / "w.safetensors", "--json", file, *chosen,
    )  # fmt: skip
    assert result.exit_code == 0, result.stderr
    document = json.loads(file.read_text())
    keys = "scorer weights protocol shots episodes tau seed results means skipped others"
    assert set(document) == set(keys.split())
    assert document["scorer"] == (baseline or "trx-os")
    assert (document["weights"] is None) == (baseline in ("always-reject", "random"))
    assert [row["ways_used"] for row in document["results"]] == [2, 2, 2]


def test_a_full_disk_takes_the_document_and_not_the_table(toys: Path, tmp_path: Path) -> None:
    file = tmp_path / "figures.json"
    file.write_text("before")
    words = ["evaluate", toys / "one.npz", "--baseline", "always-reject", "--episodes", 2]
    with files_up_to(100):
        result = invoke(*words, "--json", file, "--force")
    assert result.exit_code == 74
    assert f"{file}: cannot be written: File too large." in result.stderr
    assert "FSOS-ACC" in result.stdout
    assert file.read_text() == "before"


def test_json_alone_is_printed_on_request(toys: Path) -> None:
    arguments = ["evaluate", toys / "one.npz", "--baseline", "always-reject", "--episodes", 2]
    dash = json.loads(invoke(*arguments, "--json", "-").stdout)
    assert dash == json.loads(invoke("--json", *arguments).stdout)
    assert dash["results"][0]["metrics"]["fsos_accuracy"] == {"mean": 0.5, "std": 0.0}


def test_several_baselines_stand_in_one_document(toys: Path) -> None:
    names = ["--baseline", "random", "--baseline", "always-reject", "--baseline", "random"]
    arguments = ["evaluate", toys / "one.npz", "--episodes", 2, "--ways", 2, *names]
    document = json.loads(invoke(*arguments, "--json", "-").stdout)
    assert document["scorer"] == "random"
    assert [other["scorer"] for other in document["others"]] == ["always-reject"]
    assert set(document["others"][0]) == set(document) - {"others"}
    assert invoke(*arguments).stdout.count("FSOS-ACC") == 2


def test_what_could_not_be_measured_is_told(toys: Path, tmp_path: Path) -> None:
    (tmp_path / "s.json").write_text('{"one": {}, "two": {"benchmark": ["action 1"]}}')
    splits = ["--splits", tmp_path / "s.json", "--baseline", "random"]
    result = invoke("evaluate", toys / "one.npz", toys / "two.npz", *splits)
    assert result.exit_code == 3
    assert "one: the splits keep none of its classes" in result.stderr
    assert "two: 1 classes leave none to enrol" in result.stderr


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ([], "Missing argument 'COLLECTION...'"),
        (["one.npz", "--ways", "5,x"], "--ways must be numbers"),
        (["one.npz", "--ways", "0"], "--ways must be numbers"),
        (["one.npz", "--protocol", "open"], "unknown protocol 'open'"),
        (["one.npz", "--baseline", "knn"], "unknown baseline 'knn'"),
        (["one.npz", "--json", "none/x.json"], "there is no folder none"),
        (["one.npz", "--json", "."], "is a folder; name a file"),
        (["one.npz", "--json", "--ways"], "--json needs a file"),
        (["one.npz", "--baseline", "dtw-cohort", "--weights", "w.safetensors"], "of --splits"),
    ],
)
def test_senseless_arguments_are_usage_errors(
    toys: Path, monkeypatch: pytest.MonkeyPatch, arguments: list[str], message: str
) -> None:
    monkeypatch.chdir(toys)
    result = invoke("evaluate", *arguments)
    assert result.exit_code == 2
    assert message in result.stderr
