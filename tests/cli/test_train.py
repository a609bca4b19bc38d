"""The `train` command: short runs on a small made-up collection."""

import json
import os
import signal
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests.forking import files_up_to

from .conftest import invoke, write_collection

pytest.importorskip("torch", reason="needs the extra train")

from actioncli.cli import train as command
from actioncli.model.config import PartsConfig
from actioncli.model.weights import read_weights
from actioncli.training import loop
from actioncli.training.default import DefaultRecipe
from actioncli.training.loop import Progress
from actioncli.training.paper import PaperRecipe

STEPS = 4


@pytest.fixture
def toy(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A collection of thirty actions by four people; a run on it takes a second."""
    short = PaperRecipe(steps=STEPS, batch=1, ways=3, validate_every=2)
    monkeypatch.setattr("actioncli.training.paper.PaperRecipe", lambda: short)
    file = tmp_path / "toy.npz"
    write_collection(file, 30, 4, 1, np.random.default_rng(0))
    return file


def test_a_run_is_told_and_written(toy: Path, tmp_path: Path) -> None:
    out = tmp_path / "w.safetensors"
    words = ["train", toy, "--recipe", "paper", "--out", out, "--threads", 1]
    result = invoke(*words)
    assert result.exit_code == 0, result.output
    assert "Training on" in result.stderr
    assert f"step {STEPS}/{STEPS}  loss" in result.stderr
    assert result.stdout.startswith(f"{out}: step ")
    again = invoke(*words, "--json")
    document = json.loads(again.stdout)
    assert document["checksum"] == read_weights(out).checksum
    assert (document["recipe"], document["seed"], document["steps"]) == ("paper", 0, STEPS)
    assert document["best_step"] == document["validation"]["step"]


def test_a_run_is_written_and_asked(
    toy: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    small = PartsConfig(width=16, key_width=8, layers=1, evidence=8)
    short = DefaultRecipe(config=small, steps=2, ways=4, tasks=1, validate_every=2)
    monkeypatch.setattr("actioncli.training.default.DefaultRecipe", lambda: short)
    out = tmp_path / "w.safetensors"
    result = invoke("train", toy, "--out", out, "--threads", 1, "--json")
    assert result.exit_code == 0, result.output
    document = json.loads(result.stdout)
    assert (document["recipe"], document["steps"], document["best_step"]) == ("default", 2, 2)
    assert read_weights(out).config == small
    example = Path(__file__).parents[2] / "examples/squat/ada.npz"
    words = ["--weights", out, "--store", tmp_path / "store"]
    assert invoke("enroll", "squat", example, *words).exit_code == 0
    assert "squat" in invoke("classify", example, *words).stdout


@pytest.mark.parametrize("ending", ["SIGINT", "SIGTERM"])
def test_a_run_that_was_ended_goes_on(
    toy: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, ending: str
) -> None:
    out = tmp_path / "w.safetensors"
    words = ["train", toy, "--recipe", "paper", "--out", out, "--threads", 1]
    steps: list[int] = []

    def interrupt(step: int, *others: Any) -> Progress:
        steps.append(step)
        if step == 1:
            os.kill(os.getpid(), signal.Signals[ending])
        return Progress(step, *others)

    with monkeypatch.context() as patched:
        patched.setattr(loop, "Progress", interrupt)
        result = invoke(*words)
        assert (result.exit_code, result.stderr.splitlines()[-1]) == (130, "error: interrupted")
        assert not out.exists()
        assert invoke(*words).exit_code == 0
    assert steps == list(range(1, STEPS + 1))
    interrupted = read_weights(out).checksum
    assert invoke(*words).exit_code == 0
    assert read_weights(out).checksum == interrupted


def test_a_checkpoint_that_cannot_be_written_is_told_once(
    toy: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(loop, "CHECKPOINT_SECONDS", -1.0)
    out = tmp_path / "w.safetensors"
    words = ["train", toy, "--recipe", "paper", "--out", out, "--threads", 1, "--quiet"]
    with files_up_to(1000):
        result = invoke(*words)
    # The weights do not fit, either.
    assert result.exit_code != 0
    lines = result.stderr.splitlines()
    assert [line.partition(":")[0] for line in lines] == ["warning", "error"]
    assert f"{out}.checkpoint: cannot write the checkpoint" in lines[0]
    assert f"{out}: cannot write weights" in lines[1]
    assert not out.exists()


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["--out", "w", "--recipe", "best"], "unknown recipe 'best'"),
        (["--out", "."], "is a folder; name a file in it"),
        (["--out", "w", "--recipe", "paper", "--device", "abacus"], "--device abacus: "),
    ],
)
def test_senseless_arguments_are_usage_errors(toy: Path, words: list[str], message: str) -> None:
    result = invoke("train", toy, *words)
    assert result.exit_code == 2
    assert message in result.stderr


def test_without_torch_the_extra_is_named(toy: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(command, "find_spec", lambda _: None)
    result = invoke("train", toy, "--out", "w")
    assert result.exit_code == 2
    assert "pip install 'actioncli[train]'" in result.stderr
