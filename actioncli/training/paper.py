"""The recipe `paper`: TRX-OS as published, on episodes of recorded clips as they are."""

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
from numpy.typing import NDArray
from torch import Tensor

from actioncli._version import __version__
from actioncli.clips.prepare import prepare
from actioncli.errors import UsageError
from actioncli.model.config import ModelConfig
from actioncli.model.trx_os import parameter_shapes, positional_encoding
from actioncli.model.weights import Weights, write_weights
from actioncli.training.checkpoint import TrainingState, new_optimizer
from actioncli.training.data import TrainingSet
from actioncli.training.episodes import draw_episodes
from actioncli.training.loop import Report, arrays, descend, train
from actioncli.training.paper_loss import episode_loss
from actioncli.training.paper_validation import Validation


@dataclass(frozen=True, slots=True)
class PaperRecipe:
    """How to train.

    Attributes:
        name: as given to `--recipe`.
        config: the model.
        steps: optimiser steps.
        ways: actions per episode.
        batch: episodes per step.
        rate: peak learning rate of AdamW, reached after 50 steps, then falling to nearly zero
            as a half cosine.
        weight_decay: of matrices.
        sigma: weight of the discriminator's loss.
        validate_every: steps between looks at the validation classes.
    """

    name: str = "paper"
    config: ModelConfig = field(default_factory=ModelConfig)
    steps: int = 1500
    ways: int = 5
    batch: int = 4
    rate: float = 1e-3
    weight_decay: float = 0.01
    sigma: float = 1.0
    validate_every: int = 250

    def as_json(self) -> dict[str, Any]:
        """Plain values for the header of the weights."""
        return asdict(self)


def train_paper(
    recipe: PaperRecipe,
    data: TrainingSet,
    validation: Validation,
    out: Path,
    seed: int,
    sources: Sequence[str],
    report: Report = lambda _: None,
) -> Path:
    """Train, or go on with an interrupted run, and write the weights that did best.

    Args:
        recipe: what to do.
        data: training clips.
        validation: clips of other classes; the weights that do best on them are kept.
        out: where the weights go.
        seed: of initial tensors and episodes.
        sources: names of the collections, for the header.
        report: called after each step.

    Raises:
        UsageError: too few classes for the recipe's episodes.
        WeightsError: as `loop.train`.
    """
    usable = sum(len(rows) > 1 for rows in data.members.values())
    if usable <= recipe.ways:
        raise UsageError(
            f"recipe {recipe.name} needs more than {recipe.ways} classes with at least 2 clips "
            f"to train on; the collections have {usable}."
        )
    identity = [recipe.as_json(), seed, data.fingerprint, validation.data.fingerprint]
    fingerprint = sha256(json.dumps(identity, sort_keys=True).encode()).hexdigest()
    run = _Paper(recipe, data, validation, out, seed, sources)
    return train(run, recipe, out, seed, fingerprint, report)


class _Paper:
    """See `loop.Run`."""

    def __init__(
        self,
        recipe: PaperRecipe,
        data: TrainingSet,
        validation: Validation,
        out: Path,
        seed: int,
        sources: Sequence[str],
    ) -> None:
        """Prepare all clips once."""
        self._recipe, self._data, self._validation = recipe, data, validation
        self._out, self._seed, self._sources = out, seed, sources
        how = recipe.config.preparation
        self._frames = torch.from_numpy(np.stack([prepare(clip, how) for clip in data.clips]))

    def start(self) -> TrainingState:
        """Uniform in ±1/√(inputs of the layer), norms at one: PyTorch's usual start."""
        rng = np.random.default_rng([self._seed, 0x1417])
        params: dict[str, Tensor] = {}
        fan_in = 1
        for name, shape in parameter_shapes(self._recipe.config).items():
            values: NDArray[np.floating[Any]]
            if name.endswith("scale"):
                values = np.ones(shape)
            elif name.endswith("shift"):
                values = np.zeros(shape)
            elif name == "positions":
                values = positional_encoding(*shape)
            else:
                fan_in = shape[0] if len(shape) == 2 else fan_in
                values = rng.uniform(-1, 1, shape) / math.sqrt(fan_in)
            params[name] = torch.nn.Parameter(torch.tensor(values, dtype=torch.float32))
        # In the order in which a checkpoint gives them back: sums of floats depend on it.
        params = dict(sorted(params.items()))
        return TrainingState(0, params, new_optimizer(params), {}, -math.inf, [])

    def loss(self, state: TrainingState, rng: np.random.Generator) -> tuple[Tensor, float]:
        """Of `batch` episodes."""
        recipe = self._recipe
        drawn = draw_episodes(self._data, recipe.batch, recipe.ways, rng)
        return episode_loss(
            state.params,
            recipe.config,
            self._frames[torch.from_numpy(drawn.support)],
            self._frames[torch.from_numpy(drawn.queries)],
            torch.from_numpy(drawn.targets),
            recipe.sigma,
        )

    def step(self, state: TrainingState) -> None:
        """AdamW."""
        recipe = self._recipe
        descend(state, recipe.rate, recipe.weight_decay, recipe.steps, warm=50, floor=0.03)

    def validate(self, state: TrainingState) -> None:
        """Keep the weights if they are the best so far."""
        now = Weights(self._recipe.config, arrays(state.params), {}, f"step-{state.step}", Path())
        figures = self._validation.figures(now)
        state.history.append({"step": state.step, **asdict(figures)})
        if figures.score > state.score:
            state.score = figures.score
            state.best = {name: tensor.detach().clone() for name, tensor in state.params.items()}

    def write(self, state: TrainingState) -> None:
        """Write the weights that did best."""
        best = max(state.history, key=lambda entry: entry["score"])
        metadata = {
            "actioncli": __version__,
            "recipe": self._recipe.as_json(),
            "seed": self._seed,
            "best_step": best["step"],
            "validation": best,
            "classes": len(self._data.members),
            "clips": len(self._data.clips),
            "sources": list(self._sources),
        }
        write_weights(self._out, self._recipe.config, arrays(state.best), metadata)
