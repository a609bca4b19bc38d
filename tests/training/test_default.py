"""The recipe `default`: short runs, augmentation, negatives made of the action itself."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch
from torch import Tensor

from actioncli.clips.parts import prepare_parts
from actioncli.model import parts
from actioncli.model.config import PartsConfig
from actioncli.model.weights import read_weights
from actioncli.training import loop
from actioncli.training.augment import Batch, augment, joined, mirrored
from actioncli.training.data import TrainingSet, hold_out
from actioncli.training.default import DefaultRecipe, DefaultRun, task_loss
from actioncli.training.loop import Progress
from actioncli.training.negatives import KINDS, apart, negatives
from actioncli.training.paper import PaperRecipe, PaperRun
from actioncli.training.tasks import Tasks

CONFIG = PartsConfig(width=16, key_width=8, layers=1, evidence=8)
RECIPE = DefaultRecipe(config=CONFIG, steps=6, ways=5, tasks=2, validate_every=3)


def chance(seed: int = 0) -> torch.Generator:
    return torch.Generator().manual_seed(seed)


@pytest.fixture(scope="module")
def batch(world: TrainingSet) -> Batch:
    prepared = prepare_parts(world.clips[:24], CONFIG.preparation)
    some = Batch(*map(torch.from_numpy, prepared))
    hands = torch.nn.functional.normalize(torch.randn(24, 48, 40, 3, generator=chance()), dim=-1)
    some.missing[:, :, 5:] = False
    return some._replace(hands=hands)


def train(
    world: TrainingSet,
    out: Path,
    report: Callable[[Progress], None] = lambda _: None,
    recipe: DefaultRecipe = RECIPE,
) -> Path:
    data, held = hold_out(world, 0)
    return loop.train(DefaultRun(recipe, data, held, 0, ["world"]), out, report)


def test_the_seed_decides_and_an_interrupted_run_goes_on(
    world: TrainingSet, tmp_path: Path
) -> None:
    first = read_weights(train(world, tmp_path / "first.safetensors"))
    assert first.metadata["validation"]["step"] == 6
    assert first.tensors.keys() == (
        {"cohort", *parts.parameter_shapes(CONFIG), *parts.fitted_shapes(CONFIG)}
    )
    # Other people's motions for `calibrate`; matrices are kept in half precision.
    assert first.tensors["cohort"].shape == (72, CONFIG.tokens, CONFIG.embedding_width)
    weight = first.tensors["judge0.weight"]
    np.testing.assert_array_equal(weight, weight.astype(np.float16))

    def stop(now: Progress) -> None:
        if now.step == 4:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        train(world, tmp_path / "cut.safetensors", stop)
    assert (tmp_path / "cut.safetensors.checkpoint").exists()
    second = read_weights(train(world, tmp_path / "cut.safetensors"))
    assert second.checksum == first.checksum
    assert not (tmp_path / "cut.safetensors.checkpoint").exists()


def test_a_step_makes_every_tensor_on_the_device_of_the_run(world: TrainingSet) -> None:
    data, held = hold_out(world, 0)
    paper = PaperRun(PaperRecipe(batch=1, ways=3), data, held, 0, [])
    for run in (DefaultRun(RECIPE, data, held, 0, []), paper):
        state = run.prepare()
        # What names no device is made on this one, and an operation on both is an error.
        with torch.device("meta"):
            loss, _ = run.loss(state, np.random.default_rng(0))
            loss.backward()
            run.step(state)
        assert loss.device.type == "cpu"


def test_the_loss_falls(world: TrainingSet, tmp_path: Path) -> None:
    losses: list[float] = []
    recipe = replace(RECIPE, steps=40, validate_every=40, rate=5e-3)
    train(world, tmp_path / "w.safetensors", lambda now: losses.append(now.loss), recipe)
    assert losses[-1] < losses[9] - 0.01


def test_augmentation_leaves_unit_vectors_and_only_takes_parts_away(batch: Batch) -> None:
    lost = batch._replace(missing=batch.missing.clone())
    lost.missing[:, :, 3] = True
    seen = augment(lost, chance())
    for directions in (seen.bones, seen.hands[~seen.missing[:, :, 5:].repeat_interleave(20, -1)]):
        lengths = torch.linalg.vector_norm(directions, dim=-1)
        torch.testing.assert_close(lengths, torch.ones_like(lengths))
    assert seen.missing[:, :, 3].all()
    assert not seen.hands[seen.missing[:, :, 5:].repeat_interleave(20, -1)].any()
    again = augment(lost, chance())
    assert all(torch.equal(one, other) for one, other in zip(seen, again, strict=True))
    for one, other in zip(mirrored(mirrored(batch)), batch, strict=True):
        torch.testing.assert_close(one, other)


def test_negatives_are_another_motion_unless_it_is_the_same_that_way(batch: Batch) -> None:
    kinds = torch.arange(len(KINDS)).repeat(4)
    source = batch.rows(slice(0, len(kinds)))
    made = negatives(source, kinds, chance())
    assert (apart(made, source) > 0.1).all()
    torch.testing.assert_close(made.bones[0], source.bones[0].flip(0))
    # What swings to and fro is much the same backwards, what goes one way is not.
    swing = torch.sin(torch.arange(48) * 2 * torch.pi / 16)
    changed = []
    for course in (swing, torch.linspace(-1, 1, 48)):
        bones = source.bones[:1, :1] + 0.2 * course[:, None, None]
        bones = torch.nn.functional.normalize(bones, dim=-1)
        motion = Batch(bones, 0 * batch.hands[:1], batch.missing[:1])
        changed.append(apart(negatives(motion, torch.tensor([0]), chance()), motion))
    assert changed[0] < 0.75 * changed[1]


def test_a_task_is_of_different_motions(world: TrainingSet) -> None:
    tasks = Tasks(world, CONFIG.preparation)
    task = tasks.draw(6, np.random.default_rng(0), chance())
    assert len(task.same) == len(task.changed) == len(task.negatives.bones) == 6
    assert joined([task.supports, task.queries]).bones.shape == (12, 48, 14, 3)
    assert not task.same.diagonal().any()
    # `world0/3` and `world1/3` are one motion under one name.
    assert len(tasks.draw(16, np.random.default_rng(0), chance()).same) <= 8


def test_what_is_the_same_motion_counts_for_nothing() -> None:
    logits: Tensor = torch.randn(5, 5, generator=chance())
    same = torch.zeros(5, 5, dtype=torch.bool)
    same[0, 1] = same[1, 0] = True
    other = torch.where(same, logits + 3, logits)
    torch.testing.assert_close(task_loss(logits, same, 0.7), task_loss(other, same, 0.7))
    assert not torch.allclose(
        task_loss(logits, ~same & same, 0.7), task_loss(other, same & ~same, 0.7)
    )
