"""Training of the parts model."""

from __future__ import annotations

import json
import math
from collections.abc import Sequence
from dataclasses import asdict, dataclass, field
from hashlib import sha256
from pathlib import Path
from typing import Any

import numpy as np
import torch
from torch import Generator, Tensor
from torch.nn import functional

from actioncli._version import __version__
from actioncli.errors import UsageError
from actioncli.model import parts
from actioncli.model.parts_config import PartsConfig
from actioncli.model.weights import write_weights
from actioncli.training.checkpoint import TrainingState, new_optimizer
from actioncli.training.data import TrainingSet, cut_long_recordings
from actioncli.training.loop import Report, arrays, descend, train
from actioncli.training.parts_augment import augment, joined
from actioncli.training.parts_tasks import PartTasks, Task
from actioncli.training.parts_validation import PartsValidation


@dataclass(frozen=True, slots=True)
class PartsRecipe:
    """How to train the parts model.

    Attributes:
        name: as given to `--recipe`.
        config: the model.
        steps: optimiser steps.
        ways: actions a task.
        tasks: tasks a step.
        rate: peak learning rate of AdamW, reached after 100 steps, then falling to a fiftieth as
            a half cosine.
        weight_decay: of matrices.
        dropout: share of features.
        hard: how much of the loss of a query's wrong actions falls on those that would be taken.
        negative: weight of the loss of negatives made of the action itself.
        averaging: of the weights over steps: what is kept from one step to the next.
        validate_every: steps between looks at the validation classes.
    """

    name: str = "parts"
    config: PartsConfig = field(default_factory=PartsConfig)
    steps: int = 2600
    ways: int = 20
    tasks: int = 3
    rate: float = 1e-3
    weight_decay: float = 0.05
    dropout: float = 0.15
    hard: float = 0.7
    negative: float = 1.0
    averaging: float = 0.998
    validate_every: int = 250

    def as_json(self) -> dict[str, Any]:
        """Plain values for the header of the weights."""
        return asdict(self)


def train_parts(
    recipe: PartsRecipe,
    data: TrainingSet,
    validation: PartsValidation,
    out: Path,
    seed: int,
    sources: Sequence[str],
    report: Report = lambda _: None,
    device: str = "cpu",
) -> Path:
    """Train, or go on with an interrupted run, and write the average of the last weights.

    Args:
        recipe: what to do.
        data: training clips.
        validation: clips of other classes, on which the meaning of a confidence is fitted.
        out: where the weights go.
        seed: of initial tensors, tasks and augmentation.
        sources: names of the collections, for the header.
        report: called after each step.
        device: where torch computes.

    Raises:
        UsageError: too few classes for a task.
        WeightsError: as `loop.train`.
    """
    if len(data.members) < recipe.ways:
        raise UsageError(
            f"recipe {recipe.name} needs at least {recipe.ways} classes to train on; the "
            f"collections have {len(data.members)}."
        )
    identity = [recipe.as_json(), seed, data.fingerprint, validation.data.fingerprint, device]
    fingerprint = sha256(json.dumps(identity, sort_keys=True).encode()).hexdigest()
    run = _Parts(recipe, data, validation, out, seed, sources, device)
    return train(run, recipe, out, seed, fingerprint, report)


class _Parts:
    """See `loop.Run`."""

    def __init__(
        self,
        recipe: PartsRecipe,
        data: TrainingSet,
        validation: PartsValidation,
        out: Path,
        seed: int,
        sources: Sequence[str],
        device: str,
    ) -> None:
        """Prepare all clips once."""
        self._recipe, self._data, self._validation = recipe, data, validation
        self._out, self._seed, self._sources, self._device = out, seed, sources, device
        self._tasks = PartTasks(cut_long_recordings(data), recipe.config.preparation, device)

    def start(self) -> TrainingState:
        """Random weights."""
        return _new_state(self._recipe.config, self._seed, self._device)

    def loss(self, state: TrainingState, rng: np.random.Generator) -> tuple[Tensor, float]:
        """Of several tasks."""
        chance = torch.Generator(self._device).manual_seed(int(rng.integers(2**62)))
        torch.manual_seed(int(rng.integers(2**62)))  # dropout has no generator of its own
        ways = self._recipe.ways
        drawn = [self._tasks.draw(ways, rng, chance) for _ in range(self._recipe.tasks)]
        return _loss(self._recipe, state.params, drawn, chance)

    def step(self, state: TrainingState) -> None:
        """AdamW, and the average of the weights."""
        recipe = self._recipe
        descend(state, recipe.rate, recipe.weight_decay, recipe.steps, warm=100, floor=0.02)
        kept = min(recipe.averaging, state.step / (state.step + 10))
        for name, tensor in state.params.items():
            state.best[name].lerp_(tensor.detach(), 1 - kept)

    def validate(self, state: TrainingState) -> None:
        """Look at what the averaged weights do."""
        figures = self._validation.figures(arrays(state.best))
        state.history.append({"step": state.step, **figures})

    def write(self, state: TrainingState) -> None:
        """Write the averaged weights, and what a confidence means."""
        tensors = arrays(state.best)
        metadata = {
            "actioncli": __version__,
            "recipe": self._recipe.as_json(),
            "seed": self._seed,
            "validation": state.history[-1],
            "classes": len(self._data.members),
            "clips": len(self._data.clips),
            "sources": list(self._sources),
        }
        confidence = self._validation.confidence(tensors)
        write_weights(self._out, self._recipe.config, tensors | confidence, metadata)


def _loss(
    recipe: PartsRecipe, params: dict[str, Tensor], drawn: list[Task], chance: Generator
) -> tuple[Tensor, float]:
    """Mean loss of the tasks, and the share of queries whose nearest action is right."""
    clips = [of for task in drawn for of in (task.supports, task.queries, task.negatives)]
    seen = augment(joined(clips), chance)

    def drop(x: Tensor) -> Tensor:
        return functional.dropout(x, recipe.dropout)

    config = recipe.config
    embedded = parts.embed(params, config, parts.tokens(config, *seen), drop)
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


def _new_state(config: PartsConfig, seed: int, device: str) -> TrainingState:
    """Uniform in ±1/√(inputs of the layer), norms at one: PyTorch's usual start."""
    rng = np.random.default_rng([seed, 0x1417])
    params: dict[str, Tensor] = {}
    fan_in = 1
    for name, shape in parts.parameter_shapes(config).items():
        if name.endswith("scale"):
            values = np.ones(shape)
        elif name == "attention.decay":
            values = np.full(shape, parts.DECAY)
        elif name == "positions":
            values = 0.02 * rng.standard_normal(shape)
        elif name.endswith(("shift", "missing")) or name == "part.bias":
            values = np.zeros(shape)
        else:
            fan_in = shape[-2] if len(shape) > 1 else fan_in
            values = rng.uniform(-1, 1, shape) / math.sqrt(fan_in)
        params[name] = torch.nn.Parameter(torch.tensor(values, dtype=torch.float32, device=device))
    # In the order in which a checkpoint gives them back: sums of floats depend on it.
    params = dict(sorted(params.items()))
    average = {name: tensor.detach().clone() for name, tensor in params.items()}
    return TrainingState(0, params, new_optimizer(params), average, -math.inf, [])
