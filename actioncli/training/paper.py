"""The recipe `paper`: TRX-OS as published, on episodes of recorded clips as they are."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np
import torch
from torch import Tensor
from torch.nn import functional

from actioncli.clips.prepare import prepare
from actioncli.errors import UsageError
from actioncli.model import trx_os
from actioncli.model.config import ModelConfig
from actioncli.training.checkpoint import TrainingState
from actioncli.training.data import Indices, TrainingSet, query_of
from actioncli.training.loop import Recipe, Run, arrays
from actioncli.training.validation import Validation


@dataclass(frozen=True, slots=True)
class PaperRecipe(Recipe):
    """See `Recipe`.

    Attributes:
        config: the model.
        batch: episodes per step.
    """

    name: str = "paper"
    steps: int = 1500
    ways: int = 5
    rate: float = 1e-3
    weight_decay: float = 0.01
    warm: int = 50
    floor: float = 0.03
    validate_every: int = 250
    config: ModelConfig = field(default_factory=ModelConfig)
    batch: int = 4


class PaperRun(Run[PaperRecipe]):
    """Keeps the weights that do best on the validation classes."""

    def prepare(self) -> TrainingState:
        """See `Run`."""
        recipe, members = self.recipe, self.data.members
        self._validation = Validation(self.held, recipe.config, self.seed)
        usable = sum(len(rows) > 1 for rows in members.values())
        if usable <= recipe.ways:
            raise UsageError(
                f"recipe {recipe.name} needs more than {recipe.ways} classes with at least 2 clips "
                f"to train on; the collections have {usable}."
            )
        frames = [prepare(clip, recipe.config.preparation) for clip in self.data.clips]
        self._frames = torch.from_numpy(np.stack(frames)).to(self.device)  # (N, F, J, 3)
        return self.start(trx_os.parameter_shapes(recipe.config), {})

    def loss(self, state: TrainingState, rng: np.random.Generator) -> tuple[Tensor, float]:
        """Of `batch` episodes."""
        drawn = draw_episodes(self.data, self.recipe.batch, self.recipe.ways, rng)
        support, queries, targets = (torch.from_numpy(rows).to(self.device) for rows in drawn)
        clips = self._frames[support], self._frames[queries]
        return episode_loss(state.params, self.recipe.config, *clips, targets)

    def validate(self, state: TrainingState) -> None:
        """Keep the weights if they are the best so far."""
        self.keep_best(state, self._validation.figures(arrays(state.params)))

    def result(self, state: TrainingState) -> tuple[dict[str, Any], dict[str, Any]]:
        """The weights that did best."""
        return arrays(state.best), max(state.history, key=lambda figures: figures["score"])


class Episodes(NamedTuple):
    """B episodes of K actions each, as clip numbers.

    Attributes:
        support: (B, K) one clip per action.
        queries: (B, Q).
        targets: (B, Q) the action's place among the K, or -1 for a query of none of them.
    """

    support: Indices
    queries: Indices
    targets: Indices


def draw_episodes(data: TrainingSet, batch: int, ways: int, rng: np.random.Generator) -> Episodes:
    """Draw `batch` episodes: one known query for each way, and as many unknown ones.

    Every other episode takes its actions from one collection, where nothing but the motion
    tells them apart; the others mix collections. Queries come from another performer than the
    support clip's wherever the class has one.
    """
    usable = {c: rows for c, rows in data.members.items() if len(rows) > 1}
    of_source: dict[int, list[int]] = {}
    for c, rows in usable.items():
        of_source.setdefault(int(data.collections[rows[0]]), []).append(c)
    large = [classes for classes in of_source.values() if len(classes) > ways]
    everything = list(usable)
    support = np.empty((batch, ways), np.int64)
    queries = np.empty((batch, 2 * ways), np.int64)
    targets = np.full((batch, 2 * ways), -1, np.int64)
    chances = np.array([len(classes) for classes in large], float)
    for b in range(batch):
        within = large and b % 2 == 0
        pool = large[rng.choice(len(large), p=chances / chances.sum())] if within else everything
        classes = rng.permutation(pool)
        known, others = classes[:ways], classes[ways:]
        for way, c in enumerate(known):
            support[b, way] = rng.choice(usable[int(c)])
            queries[b, way] = query_of(data, usable[int(c)], support[b, way], rng)
            targets[b, way] = way
        for way, c in enumerate(rng.choice(others, ways)):
            queries[b, ways + way] = rng.choice(usable[int(c)])
    return Episodes(support, queries, targets)


def episode_loss(
    params: dict[str, Tensor],
    config: ModelConfig,
    support: Tensor,
    queries: Tensor,
    targets: Tensor,
) -> tuple[Tensor, float]:
    """Cross-entropy over -T, plus the discriminator's binary cross-entropy.

    The discriminator learns from the z known queries whose nearest action is right (it should
    say yes) and from z unknown ones against their nearest action (it should say no).

    Args:
        support: (B, K, F, J, 3) prepared frames, one clip per action.
        queries: (B, Q, F, J, 3).
        targets: (B, Q) place of the query's action, -1 for an unknown one.

    Returns:
        the loss, and the share of known queries whose nearest action is right.
    """
    batch, ways = support.shape[:2]
    asked = queries.shape[1]
    frames = torch.cat([support, queries], dim=1).flatten(0, 1)
    features = trx_os.with_positions(config, trx_os.psi(params, frames))
    keys, values = (
        of_pairs.unflatten(0, (batch, ways + asked))
        for of_pairs in trx_os.pairs(params, config, trx_os.project(params, config, features))
    )
    pair_count = keys.shape[2]
    # All queries of an episode attend to a support clip in one product: (B, K, Q·P, W).
    query_keys = keys[:, ways:].flatten(1, 2)[:, None]
    weights = trx_os.attention(query_keys, keys[:, :ways])
    prototype = trx_os.prototypes(weights, values[:, :ways])
    prototype = prototype.unflatten(2, (asked, pair_count)).transpose(1, 2)
    difference = values[:, ways:, None] - prototype  # (B, Q, K, P, W)
    distances = trx_os.distance(difference)
    known = targets >= 0
    loss = functional.cross_entropy(-distances[known], targets[known])
    nearest = distances.argmin(dim=2)
    right = known & (nearest == targets)
    chosen = difference.gather(
        2, nearest[..., None, None, None].expand(-1, -1, 1, *difference.shape[3:])
    )[:, :, 0]
    z = int(min(right.sum(), (~known).sum()))
    if z:
        judged = torch.cat([chosen[right][:z], chosen[~known][:z]])
        logits = trx_os.discriminator(params, judged)
        same = (torch.arange(2 * z, device=logits.device) < z).to(logits.dtype)
        loss = loss + functional.binary_cross_entropy_with_logits(logits, same)
    return loss, float(right.sum() / known.sum())
