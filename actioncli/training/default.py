"""The recipe `default`: training of the part transformer."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np
import torch
from torch import Generator, Tensor
from torch.nn import functional

from actioncli.clips.clip import FloatArray
from actioncli.errors import UsageError
from actioncli.model import parts, parts_compare, parts_tokens
from actioncli.model.config import PartsConfig
from actioncli.training.augment import augment, joined
from actioncli.training.checkpoint import TrainingState
from actioncli.training.data import Indices, TrainingSet, cut_long_recordings
from actioncli.training.loop import Recipe, Run, arrays
from actioncli.training.pooling import pool_weight
from actioncli.training.tasks import Task, Tasks
from actioncli.training.validation import Validation

# Motions of other people that come with the weights, and clips that the pooled vector is fitted on.
COHORT, POOLED = 96, 400


@dataclass(frozen=True, slots=True)
class DefaultRecipe(Recipe):
    """See `Recipe`.

    Attributes:
        config: the model.
        tasks: tasks a step, each of `ways` actions.
        dropout: share of features.
        hard: how much of the loss of a query's wrong actions falls on those that would be taken.
        negative: weight of the loss of negatives made of the action itself.
        averaging: of the weights over steps: what is kept from one step to the next.
    """

    name: str = "default"
    steps: int = 3600
    ways: int = 20
    rate: float = 1e-3
    weight_decay: float = 0.05
    warm: int = 100
    floor: float = 0.02
    validate_every: int = 300
    config: PartsConfig = field(default_factory=PartsConfig)
    tasks: int = 3
    dropout: float = 0.15
    hard: float = 0.7
    negative: float = 1.5
    averaging: float = 0.998


class DefaultRun(Run[DefaultRecipe]):
    """Gives the average of the last weights; the held-out classes tell what a confidence means."""

    def prepare(self) -> TrainingState:
        """See `Run`."""
        recipe, classes = self.recipe, len(self.data.members)
        self._validation = Validation(self.held, recipe.config, self.seed)
        if classes < recipe.ways:
            raise UsageError(
                f"recipe {recipe.name} needs at least {recipe.ways} classes to train on; the "
                f"collections have {classes}."
            )
        data = cut_long_recordings(self.data)
        self._tasks = Tasks(data, recipe.config.preparation, self.device)
        begin = {"attention.decay": parts.DECAY, "part.bias": 0.0, "part.missing": 0.0}
        return self.start(parts.parameter_shapes(recipe.config), begin)

    def loss(self, state: TrainingState, rng: np.random.Generator) -> tuple[Tensor, float]:
        """Of several tasks."""
        chance = torch.Generator(self.device).manual_seed(int(rng.integers(2**62)))
        ways = self.recipe.ways
        drawn = [self._tasks.draw(ways, rng, chance) for _ in range(self.recipe.tasks)]
        return _loss(self.recipe, state.params, drawn, chance)

    def step(self, state: TrainingState) -> None:
        """AdamW, and the average of the weights."""
        super().step(state)
        kept = min(self.recipe.averaging, state.step / (state.step + 10))
        for name, tensor in state.params.items():
            state.best[name].lerp_(tensor.detach(), 1 - kept)

    def validate(self, state: TrainingState) -> None:
        """Look at what the averaged weights do."""
        figures = self._validation.figures(arrays(state.best))
        state.history.append({"step": state.step, **figures})

    def result(self, state: TrainingState) -> tuple[dict[str, Any], dict[str, Any]]:
        """The averaged weights in half precision, what a confidence means, and other people's
        motions for `calibrate`."""
        tensors = {name: _halved(array) for name, array in arrays(state.best).items()}
        config, rng = self.recipe.config, np.random.default_rng([self.seed, 0xC0])
        tensors |= self._validation.confidence(tensors)
        some = [self.data.clips[row] for row in _spread(self.data, POOLED, rng)]
        tensors["pool.weight"] = _halved(pool_weight(tensors, config, some))
        cohort = parts_compare.embed(tensors, config, some[:COHORT])
        stored = {name: array.astype(np.float16) if array.ndim > 1 else array
                  for name, array in tensors.items()}  # fmt: skip
        return stored | {"cohort": cohort.astype(np.float16)}, state.history[-1]


def _halved(array: FloatArray) -> FloatArray:
    """Matrices as half precision keeps them."""
    return array.astype(np.float16).astype(np.float32) if array.ndim > 1 else array


def _spread(data: TrainingSet, count: int, rng: np.random.Generator) -> Indices:
    """Clips of all collections, the small ones favoured by the root of their size."""
    chances = 1 / np.sqrt(np.bincount(data.collections)[data.collections])
    count = min(count, len(data.clips))
    return rng.choice(len(data.clips), count, replace=False, p=chances / chances.sum())


def _loss(
    recipe: DefaultRecipe, params: dict[str, Tensor], drawn: list[Task], chance: Generator
) -> tuple[Tensor, float]:
    """Mean loss of the tasks, and the share of queries whose nearest action is right."""
    clips = [of for task in drawn for of in (task.supports, task.queries, task.negatives)]
    seen = augment(joined(clips), chance)

    def drop(x: Tensor) -> Tensor:
        # A byte a number: four times as fast on a processor as torch's own dropout.
        words = torch.empty(-(-x.numel() // 8), dtype=torch.int64, device=x.device)
        words.random_(-(2**63), None, generator=chance)
        kept = words.view(torch.uint8)[: x.numel()].view(x.shape) >= round(256 * recipe.dropout)
        return x * (kept / (1 - recipe.dropout))

    config = recipe.config
    embedded = parts.embed(params, config, parts_tokens.tokens(config, *seen), drop)
    losses, right, start = [], [], 0
    for task in drawn:
        w = len(task.same)
        supports, queries, made = (
            parts.Embedded(*(x[:, start + at * w : start + (at + 1) * w] for x in embedded))
            for at in range(3)
        )
        start += 3 * w
        logits = parts.logits(params, config, queries, supports, drop)
        losses.append(task_loss(logits, task.same, recipe.hard))
        fooled = functional.softplus(parts.paired_logits(params, config, made, supports, drop))
        share = task.changed / task.changed.sum().clamp(min=1)
        losses[-1] = losses[-1] + recipe.negative * (fooled * share).sum()
        nearest = logits.detach().masked_fill(task.same, -1e4).argmax(1)
        right.append((nearest == torch.arange(w, device=nearest.device)).float().mean())
    return torch.stack(losses).mean(), torch.stack(right).mean().item()


def task_loss(logits: Tensor, same: Tensor, hard: float) -> Tensor:
    """Cross-entropy over queries and over supports, and whether each pair is one action, where
    the wrong actions that would be taken weigh most.

    Args:
        logits: (W, W) of query i, an example of action i, and support j.
        same: (W, W) pairs that count for nothing.
        hard: share of the weight that goes by how likely a wrong action is taken.
    """
    w = len(logits)
    own = torch.eye(w, dtype=torch.bool, device=logits.device)
    target = torch.arange(w, device=logits.device)
    masked = logits.masked_fill(same, -1e4)
    taken = masked.detach().masked_fill(own, -1e4).softmax(1)
    rivals = (hard * taken + (1 - hard) / (w - 1)) * ~(own | same)
    closed = functional.cross_entropy(masked, target) + functional.cross_entropy(masked.T, target)
    accepted = functional.softplus(-logits.diagonal()).mean()
    return closed / 2 + accepted + (functional.softplus(logits) * rivals).sum(1).mean()
