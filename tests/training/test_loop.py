"""Training as a whole: it learns, it stops and goes on, it leaves nothing half done."""

from __future__ import annotations

import signal
from contextlib import ExitStack
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from actioncli.errors import UsageError, WeightsError
from actioncli.model.config import PartsConfig
from actioncli.model.weights import read_weights
from actioncli.training import loop
from actioncli.training.data import TrainingSet, hold_out
from actioncli.training.default import DefaultRecipe, DefaultRun
from actioncli.training.loop import Progress, Recipe
from actioncli.training.paper import PaperRecipe, PaperRun
from tests.forking import files_up_to

SHORT = PaperRecipe(steps=6, batch=1, ways=3, validate_every=2)
MANY_WAYS = DefaultRecipe(
    config=PartsConfig(width=16, key_width=8, layers=1, evidence=8),
    steps=6,
    ways=5,
    tasks=1,
    validate_every=3,
)


def run(world: TrainingSet, out: Path, recipe=SHORT, report=lambda _: None) -> Path:  # type: ignore[no-untyped-def]
    data, held = hold_out(world, 0)
    runs = {PaperRecipe: PaperRun, DefaultRecipe: DefaultRun}
    return loop.train(runs[type(recipe)](recipe, data, held, 0, ["world"]), out, report)


def test_it_learns(world: TrainingSet, tmp_path: Path) -> None:
    reports: list[Progress] = []
    recipe = replace(SHORT, steps=60, batch=2, validate_every=30)
    run(world, tmp_path / "w.safetensors", recipe, reports.append)
    assert reports[-1].accuracy > 0.8
    assert reports[-1].loss < reports[0].loss
    weights = read_weights(tmp_path / "w.safetensors")
    assert weights.metadata["seed"] == 0
    assert weights.metadata["recipe"]["name"] == "paper"
    assert weights.metadata["validation"]["closed_accuracy"] > 0.5


@pytest.mark.parametrize("stop_at", [1, 3, 4])
@pytest.mark.parametrize("recipe", [SHORT, MANY_WAYS], ids=["paper", "default"])
def test_a_resumed_run_ends_like_an_uninterrupted_one(
    world: TrainingSet, tmp_path: Path, stop_at: int, recipe: Recipe
) -> None:
    def stop(now: Progress) -> None:
        if now.step == stop_at:
            raise KeyboardInterrupt

    whole = run(world, tmp_path / "whole.safetensors", recipe)
    out = tmp_path / "resumed.safetensors"
    with pytest.raises(KeyboardInterrupt):
        run(world, out, recipe, stop)
    assert not out.exists()
    steps: list[int] = []
    run(world, out, recipe, lambda now: steps.append(now.step))
    assert steps[0] == stop_at + 1
    assert read_weights(out).checksum == read_weights(whole).checksum
    assert sorted(path.name for path in tmp_path.iterdir()) == [out.name, whole.name]


def test_a_kill_between_checkpoints_repeats_those_steps(
    world: TrainingSet, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    # A checkpoint after every step, then a death that no handler sees.
    monkeypatch.setattr(loop, "CHECKPOINT_SECONDS", -1.0)

    class Killed(BaseException):
        pass

    def die(now: Progress) -> None:
        if now.step == 5:
            raise Killed

    out = tmp_path / "killed.safetensors"
    with pytest.raises(Killed):
        run(world, out, report=die)
    run(world, out)
    whole = run(world, tmp_path / "whole.safetensors")
    assert read_weights(out).checksum == read_weights(whole).checksum


def test_a_checkpoint_of_another_run_is_refused(world: TrainingSet, tmp_path: Path) -> None:
    out = tmp_path / "w.safetensors"

    def stop(now: Progress) -> None:
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        run(world, out, report=stop)
    with pytest.raises(WeightsError, match="another recipe, seed or data"):
        run(world, out, replace(SHORT, steps=8))
    (tmp_path / "w.safetensors.checkpoint").write_bytes(b"damaged")
    with pytest.raises(WeightsError, match="damaged checkpoint"):
        run(world, out)


def test_a_checkpoint_that_cannot_be_written_is_told(world: TrainingSet, tmp_path: Path) -> None:
    def stop(now: Progress) -> None:
        raise KeyboardInterrupt

    with (
        files_up_to(1000),
        pytest.raises(WeightsError, match=r"cannot write the check.*too"),
    ):
        run(world, tmp_path / "w.safetensors", report=stop)
    assert list(tmp_path.iterdir()) == []


def test_a_run_outlasts_a_full_disk(
    world: TrainingSet, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(loop, "CHECKPOINT_SECONDS", -1.0)
    unsaved: list[str | None] = []
    full = ExitStack()

    def fill_and_free(now: Progress) -> None:
        unsaved.append(now.unsaved)
        if now.step == 1:
            full.enter_context(files_up_to(1000))
        if now.step == 4:
            full.close()

    out = tmp_path / "w.safetensors"
    run(world, out, report=fill_and_free)
    reason = f"{out}.checkpoint: cannot write the checkpoint"
    assert [each is not None for each in unsaved] == [False, True, True, True, False, False]
    assert str(unsaved[1]).startswith(reason)
    monkeypatch.undo()
    whole = run(world, tmp_path / "whole.safetensors")
    assert read_weights(out).checksum == read_weights(whole).checksum


def test_too_few_classes_are_told(world: TrainingSet, tmp_path: Path) -> None:
    few = world.of_classes([0, 1, 2])
    _, held = hold_out(world, 0)
    with pytest.raises(UsageError, match="needs more than 5 classes"):
        loop.train(PaperRun(PaperRecipe(), few, held, 0, []), tmp_path / "w")


def test_one_run_at_a_time_writes_a_file(world: TrainingSet, tmp_path: Path) -> None:
    out = tmp_path / "w.safetensors"

    def again(now: Progress) -> None:
        run(world, out)

    with pytest.raises(WeightsError, match="another run of `train` is writing it"):
        run(world, out, report=again)
    assert not list(tmp_path.glob("*.lock"))
    run(world, out)


def test_ctrl_c_waits_for_the_end_of_the_step(world: TrainingSet, tmp_path: Path) -> None:
    out = tmp_path / "w.safetensors"
    steps: list[int] = []

    def interrupt(now: Progress) -> None:
        steps.append(now.step)
        if now.step == 2:
            signal.raise_signal(signal.SIGINT)

    with pytest.raises(KeyboardInterrupt):
        run(world, out, report=interrupt)
    assert steps == [1, 2]
    run(world, out, report=lambda now: steps.append(now.step))
    assert steps == [1, 2, 3, 4, 5, 6]
    assert signal.getsignal(signal.SIGINT) is signal.default_int_handler


def test_held_out_classes_are_disjoint_and_stable(world: TrainingSet) -> None:
    data, held = hold_out(world, 3)
    again = hold_out(world, 3)[1]
    assert not set(data.members) & set(held.members)
    assert len(data.members) + len(held.members) == len(world.members)
    assert set(again.members) == set(held.members)
    np.testing.assert_array_equal(np.unique(held.collections), [0, 1])
