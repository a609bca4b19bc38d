"""What a step descends: the paper's losses on plain episodes, and those of the default recipe."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Protocol

import numpy as np
import torch
from torch import Tensor
from torch.nn import functional

from actioncli.clips.prepare import prepare
from actioncli.model import trx_os
from actioncli.model.config import ModelConfig
from actioncli.model.features import token_features
from actioncli.training.augment import augment
from actioncli.training.data import TrainingSet, cut_long_recordings
from actioncli.training.episodes import draw_episodes
from actioncli.training.losses import episode_loss
from actioncli.training.motions import frames_for_model
from actioncli.training.recipes import Recipe
from actioncli.training.tasks import TaskSource, alike


@dataclass(frozen=True, slots=True, eq=False)
class StepResult:
    """Loss to descend, and what the progress line tells."""

    loss: Tensor
    accuracy: float


class Objective(Protocol):
    """What a recipe descends; everything random in a step comes from the step's generator."""

    def extra_parameters(self) -> dict[str, float]:
        """Numbers that are learned beside the model and left out of the weights."""

    def loss(self, params: dict[str, Tensor], rng: np.random.Generator) -> StepResult:
        """Loss of one step."""


def objective(recipe: Recipe, data: TrainingSet) -> Objective:
    """The recipe's objective on these clips."""
    return ManyWays(recipe, data) if recipe.augmented else PaperEpisodes(recipe, data)


class PaperEpisodes:
    """The paper's: episodes of recorded clips as they are."""

    def __init__(self, recipe: Recipe, data: TrainingSet) -> None:
        """Prepare all clips once."""
        self._recipe, self._data = recipe, data
        how = recipe.config.preparation
        self._frames = torch.from_numpy(np.stack([prepare(clip, how) for clip in data.clips]))

    def extra_parameters(self) -> dict[str, float]:
        """None."""
        return {}

    def loss(self, params: dict[str, Tensor], rng: np.random.Generator) -> StepResult:
        """See `episode_loss`."""
        recipe = self._recipe
        drawn = draw_episodes(self._data, recipe.batch, recipe.ways, rng)
        loss, accuracy = episode_loss(
            params,
            recipe.config,
            self._frames[torch.from_numpy(drawn.support)],
            self._frames[torch.from_numpy(drawn.queries)],
            torch.from_numpy(drawn.targets),
            recipe.sigma,
        )
        return StepResult(loss, accuracy)


class ManyWays:
    """The default's: one task of many ways a step, in which every query meets every support.

    Cross-entropy over -T times a learned temperature, plus sigma times the discriminator's
    binary cross-entropy: every query against its own way (yes), and against the others (no),
    most against the one that would be taken if its own were not enrolled.

    For speed a step sees half of the pairs of tokens, drawn anew each time.
    """

    _DROPOUT = 0.1

    def __init__(self, recipe: Recipe, data: TrainingSet) -> None:
        """Prepare all clips once."""
        self._recipe = recipe
        self._tasks = TaskSource(
            cut_long_recordings(data), recipe.config.preparation, recipe.made_classes
        )

    def extra_parameters(self) -> dict[str, float]:
        """The logarithm of the temperature, which starts at 10/√W."""
        if not self._recipe.temperature:
            return {}
        return {"log_temperature": math.log(10 / self._recipe.config.key_width**0.5)}

    def loss(self, params: dict[str, Tensor], rng: np.random.Generator) -> StepResult:
        """Loss of one task."""
        recipe, config = self._recipe, self._recipe.config
        ways, bones, lengths = self._tasks.draw(recipe.ways, rng)
        torch.manual_seed(int(rng.integers(2**63)))
        chance = torch.Generator().manual_seed(int(rng.integers(2**63)))
        with torch.no_grad():
            same = alike(ways, bones)
            bones = bones.flatten(0, 1)
            if recipe.disturbed:
                bones = augment(bones, chance, recipe.estimated)
            frames = frames_for_model(bones, config.preparation, lengths.flatten(0, 1))
        chosen = torch.randperm(config.pairs, generator=chance)[: config.pairs // 2].sort()[0]
        with torch.autocast("cpu", dtype=torch.bfloat16):
            distances, logits = self._compare(params, config, frames, len(ways), chosen)
        distances, logits = distances.float(), logits.float()
        temperature = params["log_temperature"].exp() if recipe.temperature else 1.0
        scores = (-distances * temperature).masked_fill(same, -1e4)
        own = torch.arange(len(ways))
        loss = functional.cross_entropy(scores, own)
        right = scores.argmax(dim=1) == own
        with torch.no_grad():
            mine = torch.eye(len(ways), dtype=torch.bool)
            rivals = scores.masked_fill(mine, -1e4).softmax(dim=1)
            rivals = (0.7 * rivals + 0.3 / (len(ways) - 1)) * ~(mine | same)
            sure = 0.8 * right + 0.2
        yes = (functional.softplus(-logits.diagonal()) * sure).mean()
        no = (functional.softplus(logits) * rivals).sum(dim=1).mean()
        return StepResult(loss + recipe.sigma * (yes + no), float(right.float().mean()))

    def _compare(
        self,
        params: dict[str, Tensor],
        config: ModelConfig,
        frames: Tensor,
        ways: int,
        chosen: Tensor,
    ) -> tuple[Tensor, Tensor]:
        """T and logits (W, W), query by support, on the chosen pairs alone."""

        def drop(x: Tensor) -> Tensor:
            return functional.dropout(x, self._DROPOUT)

        features = trx_os.psi(params, config, token_features(config, frames), drop)
        features = drop(trx_os.with_positions(params, config, features))
        keys, values = trx_os.pairs(
            params, config, trx_os.project(params, config, features), chosen
        )
        bias = trx_os.place_bias(params, config, keys, chosen)
        bias = bias.bfloat16() if config.near_pairs else bias
        weights = trx_os.attention(keys[ways:, None], keys[None, :ways], bias)
        there = values[ways:, None] - trx_os.prototypes(weights, values[None, :ways])
        if not config.both_ways:
            return trx_os.distance(config, there), self._judge(params, config, there, chosen)
        back = values[None, :ways] - trx_os.prototypes(weights.mT, values[ways:, None])
        distances = (trx_os.distance(config, there) + trx_os.distance(config, back)) / 2
        logits = (self._judge(params, config, there, chosen)
                  + self._judge(params, config, back, chosen)) / 2  # fmt: skip
        return distances, logits

    def _judge(
        self, params: dict[str, Tensor], config: ModelConfig, difference: Tensor, chosen: Tensor
    ) -> Tensor:
        """Disc where only some pairs are known: the others are zero, these count double."""
        seen = trx_os.tuple_features(params, difference) * (config.pairs / len(chosen))
        features = seen.new_zeros(*seen.shape[:-2], config.pairs, seen.shape[-1])
        features[..., chosen, :] = seen
        logits: Tensor = trx_os.judge(params, features)
        return logits
