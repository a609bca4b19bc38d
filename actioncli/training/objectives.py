"""What a step descends: the paper's losses on plain episodes, and those of the default recipe."""

from __future__ import annotations

from typing import NamedTuple, Protocol

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
from actioncli.training.distributed import ALONE, Processes
from actioncli.training.episodes import draw_episodes
from actioncli.training.losses import episode_loss
from actioncli.training.motions import frames_for_model
from actioncli.training.recipes import Recipe
from actioncli.training.tasks import TaskSource, alike


class StepResult(NamedTuple):
    """Loss to descend, and what the progress line tells; of several processes, one's share."""

    loss: Tensor
    accuracy: float


class Objective(Protocol):
    """What a recipe descends; everything random in a step comes from the step's generator.

    The shares that the processes of a run compute of a step add up to what one alone computes.
    """

    def loss(self, params: dict[str, Tensor], rng: np.random.Generator) -> StepResult:
        """Loss of one step, or this process's share of it."""


def objective(recipe: Recipe, data: TrainingSet, processes: Processes = ALONE) -> Objective:
    """The recipe's objective on these clips."""
    of_recipe = ManyWays if recipe.augmented else PaperEpisodes
    return of_recipe(recipe, data, processes)


class PaperEpisodes:
    """The paper's: episodes of recorded clips as they are, shared by processes."""

    def __init__(self, recipe: Recipe, data: TrainingSet, processes: Processes = ALONE) -> None:
        """Prepare all clips once."""
        self._recipe, self._data, self._processes = recipe, data, processes
        how = recipe.config.preparation
        self._frames = torch.from_numpy(np.stack([prepare(clip, how) for clip in data.clips]))

    def loss(self, params: dict[str, Tensor], rng: np.random.Generator) -> StepResult:
        """See `episode_loss`."""
        recipe = self._recipe
        drawn = draw_episodes(self._data, recipe.batch, recipe.ways, rng)
        ours = self._processes.share(recipe.batch)
        loss, accuracy = episode_loss(
            params,
            recipe.config,
            self._frames[torch.from_numpy(drawn.support[ours])],
            self._frames[torch.from_numpy(drawn.queries[ours])],
            torch.from_numpy(drawn.targets[ours]),
            recipe.sigma,
            self._processes,
        )
        return StepResult(loss, accuracy)


class ManyWays:
    """The default's: one task of many ways a step, in which every query meets every support.

    Cross-entropy over -T, plus sigma times the discriminator's binary cross-entropy: every query
    against its own way (yes), and against the others (no), most against the one that would be
    taken if its own were not enrolled.

    For speed a step sees half of the pairs of tokens, drawn anew each time. Of several processes,
    each embeds all clips and compares its share of the queries.
    """

    _DROPOUT = 0.1

    def __init__(self, recipe: Recipe, data: TrainingSet, processes: Processes = ALONE) -> None:
        """Prepare all clips once."""
        self._recipe, self._processes = recipe, processes
        self._tasks = TaskSource(cut_long_recordings(data), recipe.config.preparation)

    def loss(self, params: dict[str, Tensor], rng: np.random.Generator) -> StepResult:
        """Loss of one task."""
        recipe, config = self._recipe, self._recipe.config
        bones, lengths = self._tasks.draw(recipe.ways, rng)
        ways = bones.shape[1]
        ours = self._processes.share(ways)
        torch.manual_seed(int(rng.integers(2**63)))
        chance = torch.Generator().manual_seed(int(rng.integers(2**63)))
        with torch.no_grad():
            same = alike(bones)[ours]
            bones = bones.flatten(0, 1)
            if recipe.disturbed:
                bones = augment(bones, chance, recipe.estimated)
            frames = frames_for_model(bones, config.preparation, lengths.flatten(0, 1))
        chosen = torch.randperm(config.pairs, generator=chance)[: config.pairs // 2].sort()[0]
        with torch.autocast("cpu", dtype=torch.bfloat16):
            distances, logits = self._compare(params, config, frames, ours, chosen)
        distances, logits = distances.float(), logits.float()
        scores = (-distances).masked_fill(same, -1e4)
        own = torch.arange(ways)[ours]
        loss = functional.cross_entropy(scores, own)
        right = scores.argmax(dim=1) == own
        with torch.no_grad():
            mine = torch.eye(ways, dtype=torch.bool)[ours]
            rivals = scores.masked_fill(mine, -1e4).softmax(dim=1)
            rivals = (0.7 * rivals + 0.3 / (ways - 1)) * ~(mine | same)
            sure = 0.8 * right + 0.2
        yes = (functional.softplus(-logits.diagonal(ours.start)) * sure).mean()
        no = (functional.softplus(logits) * rivals).sum(dim=1).mean()
        loss = loss + recipe.sigma * (yes + no)
        part = len(own) / ways
        return StepResult(loss * part, float(right.float().mean()) * part)

    def _compare(
        self,
        params: dict[str, Tensor],
        config: ModelConfig,
        frames: Tensor,
        ours: slice,
        chosen: Tensor,
    ) -> tuple[Tensor, Tensor]:
        """T and logits (our queries, W), query by support, on the chosen pairs alone."""

        def drop(x: Tensor) -> Tensor:
            return functional.dropout(x, self._DROPOUT)

        features = trx_os.psi(params, config, token_features(config, frames), drop)
        features = drop(trx_os.with_positions(params, config, features))
        keys, values = trx_os.pairs(
            params, config, trx_os.project(params, config, features), chosen
        )
        ways = len(frames) // 2
        of_support, of_queries = slice(ways), slice(ways + ours.start, ways + ours.stop)
        bias = trx_os.place_bias(params, config, keys, chosen)
        bias = bias.bfloat16() if config.near_pairs else bias
        weights = trx_os.attention(keys[of_queries, None], keys[None, of_support], bias)
        there = values[of_queries, None] - trx_os.prototypes(weights, values[None, of_support])
        if not config.both_ways:
            return trx_os.distance(config, there), self._judge(params, config, there, chosen)
        back = values[None, of_support] - trx_os.prototypes(weights.mT, values[of_queries, None])
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
