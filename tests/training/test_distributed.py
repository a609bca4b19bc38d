"""Two processes train what one trains: real `torchrun`, real gloo, on this machine."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
import short_runs
from conftest import small_world

from actioncli.errors import UsageError
from actioncli.model.weights import read_weights
from actioncli.training.data import TrainingSet
from actioncli.training.distributed import ALONE, Processes

FOLDER = Path(__file__).parent


def torchrun(*words: object, timeout: float = 240) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-m", "torch.distributed.run", "--standalone"]
    command += ["--nproc-per-node", "2", *map(str, words)]
    environment = {**os.environ, "OMP_NUM_THREADS": "1"}
    return subprocess.run(
        command, env=environment, capture_output=True, text=True, check=False, timeout=timeout
    )


@pytest.fixture(scope="module")
def two(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """What two processes made of all runs."""
    folder = tmp_path_factory.mktemp("two")
    ran = torchrun(FOLDER / "short_runs.py", folder)
    assert ran.returncode == 0, ran.stderr
    assert "arning" not in ran.stderr, ran.stderr
    return folder


def assert_same_tensors(ours: Path, theirs: Path) -> None:
    ours_read, theirs_read = read_weights(ours), read_weights(theirs)
    assert ours_read.tensors.keys() == theirs_read.tensors.keys()
    for name, tensor in ours_read.tensors.items():
        # The cohort is kept in half precision, whose steps are larger than the difference.
        most = 2e-3 if name == "cohort" else 1e-4
        np.testing.assert_allclose(theirs_read.tensors[name], tensor, 1e-3, most, err_msg=name)


@pytest.mark.parametrize("name", ["paper", "default in float32"])
def test_losses_and_weights_are_those_of_one_process(two: Path, tmp_path: Path, name: str) -> None:
    alone = short_runs.losses_of(name, tmp_path)
    shared = json.loads((two / f"{name}.json").read_text())
    np.testing.assert_allclose(shared, alone, rtol=0, atol=1e-4)
    assert len(alone) == short_runs.RUNS[name].steps
    assert_same_tensors(tmp_path / f"{name}.safetensors", two / f"{name}.safetensors")


def test_processes_leave_each_other_before_they_end(two: Path) -> None:
    # One that does not crashes now and then, and torchrun kills the others.
    assert [(two / f"{rank}.ended").read_text() for rank in (0, 1)] == ["True", "True"]


def test_bfloat16_is_the_same_for_the_same_weights(two: Path, tmp_path: Path) -> None:
    alone = short_runs.losses_of("default", tmp_path)
    shared = json.loads((two / "default.json").read_text())
    assert shared[0] == pytest.approx(alone[0], abs=1e-5)
    # Afterwards sums that are rounded to eight bits have been rounded elsewhere.
    np.testing.assert_allclose(shared, alone, rtol=0, atol=2e-3)


def test_what_two_began_one_finishes(two: Path, tmp_path: Path) -> None:
    checkpoint = two / "cut.safetensors.checkpoint"
    assert checkpoint.exists()
    assert not (two / "cut.safetensors.lock").exists()
    data, held = short_runs.hold_out(small_world(), 0)
    steps: list[int] = []
    short_runs.train(
        short_runs.PAPER,
        data,
        short_runs.Validation(held, 0),
        two / "cut.safetensors",
        0,
        ["world"],
        lambda now: steps.append(now.step),
    )
    # Both processes stopped at the end of the step after the one that was interrupted.
    assert steps[0] == short_runs.CUT_AFTER + 2
    assert_same_tensors(two / "paper.safetensors", two / "cut.safetensors")


def few_classes(world: TrainingSet, path: Path) -> Path:
    """A collection of 3 classes, too few for any recipe."""
    clips = [world.clips[row] for row in np.flatnonzero(world.labels < 3)]
    lengths = [len(clip) for clip in clips]
    np.savez(
        path,
        joints_mm=np.concatenate([clip.joints for clip in clips]).__mul__(1000).astype(np.int16),
        lengths=lengths,
        labels=world.labels[world.labels < 3].astype(str),
        subjects=world.subjects[world.labels < 3].astype(str),
        joint_names=list(clips[0].joint_names),
        fps=30.0,
    )
    return path


def test_the_command_runs_under_torchrun_and_an_error_ends_it(
    world: TrainingSet, tmp_path: Path
) -> None:
    collection = few_classes(world, tmp_path / "few.npz")
    ran = torchrun("-m", "actioncli", "train", collection, "--out", tmp_path / "w.safetensors")
    assert ran.returncode != 0
    assert "error: the collections have too few classes" in ran.stderr
    assert ran.stderr.count("Training on") <= 1
    assert [path.name for path in tmp_path.iterdir()] == ["few.npz"]


@pytest.mark.parametrize(("count", "items"), [(1, 4), (2, 5), (3, 20), (4, 4)])
def test_shares_are_everything_once(count: int, items: int) -> None:
    shares = [range(items)[Processes(rank, count).share(items)] for rank in range(count)]
    assert [item for share in shares for item in share] == list(range(items))
    assert max(map(len, shares)) - min(map(len, shares)) <= 1


def test_more_processes_than_work_are_told() -> None:
    with pytest.raises(UsageError, match="shared by 4 processes, not by 5"):
        Processes(0, 5).share(4)


def test_alone_nothing_is_sent() -> None:
    ALONE.wait()
    ALONE.check_same("data", "x")
    np.testing.assert_array_equal(ALONE.gather(1, 2.5), [[1, 2.5]])
    assert ALONE.first
