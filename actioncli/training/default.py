"""Recipe `default`: one task of many ways a step, in which every query meets every support.

Cross-entropy over -T, plus the discriminator's binary cross-entropy: every query against its own
way (yes), and against the others (no), most against the one that would be taken if its own were not
enrolled. For speed a step sees half of the pairs of tokens, drawn anew each time.
"""

from __future__ import annotations

from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
import torch
from torch import Tensor
from torch.nn import functional

from actioncli.clips.prepare import Preparation
from actioncli.errors import UsageError
from actioncli.model import trx_os
from actioncli.model.config import ModelConfig
from actioncli.model.features import token_features
from actioncli.model.weights import Weights
from actioncli.training.augment import augment
from actioncli.training.checkpoint import TrainingState
from actioncli.training.data import cut_long_recordings
from actioncli.training.finalize import finalize
from actioncli.training.loop import Recipe, Run, arrays
from actioncli.training.motions import frames_for_model
from actioncli.training.paper_validation import Validation
from actioncli.training.tasks import TaskSource, alike

_DROPOUT = 0.1


@dataclass(frozen=True, slots=True)
class DefaultRecipe(Recipe):
    """See `Recipe`.

    Attributes:
        config: the model.
        estimated: share of clips that go through `estimator`, as if found in video.
    """

    name: str = "default"
    steps: int = 6000
    ways: int = 20
    rate: float = 1e-3
    weight_decay: float = 0.05
    warm: int = 50
    floor: float = 0.03
    validate_every: int = 500
    config: ModelConfig = field(
        default_factory=lambda: ModelConfig(
            Preparation(frames=48, size="standard", heading=True, motion=0.5),
            key_width=64,
            distance="l2",
            body_features=True,
            convolutions=2,
            both_ways=True,
            warp_width=16,
            neighbours=20,
            mirrored=1.5,
        )
    )
    estimated: float = 0.8


class DefaultRun(Run[DefaultRecipe]):
    """Keeps the weights that do best on the validation classes."""

    def prepare(self) -> TrainingState:
        """See `Run`."""
        recipe = self.recipe
        if self.device != "cpu":
            raise UsageError(f"recipe {recipe.name} is trained on the CPU; leave --device out.")
        if len(self.data.members) <= recipe.ways // 4:
            raise UsageError(
                f"recipe {recipe.name} needs more than {recipe.ways // 4} classes to train on; the "
                f"collections have {len(self.data.members)}."
            )
        self._validation = Validation(self.held, self.seed)
        self._tasks = TaskSource(cut_long_recordings(self.data), recipe.config.preparation)
        shapes = trx_os.parameter_shapes(recipe.config)
        places = {"positions": trx_os.positional_encoding(*shapes["positions"])}
        return self.start(shapes, places)

    def loss(self, state: TrainingState, rng: np.random.Generator) -> tuple[Tensor, float]:
        """Of one task."""
        config = self.recipe.config
        bones, lengths = self._tasks.draw(self.recipe.ways, rng)
        ways = bones.shape[1]
        torch.manual_seed(int(rng.integers(2**63)))  # dropout has no generator of its own
        chance = torch.Generator().manual_seed(int(rng.integers(2**63)))
        with torch.no_grad():
            same = alike(bones)  # (W, W), query by support
            bones = augment(bones.flatten(0, 1), chance, self.recipe.estimated)
            frames = frames_for_model(bones, config.preparation, lengths.flatten(0, 1))
        chosen = torch.randperm(config.pairs, generator=chance)[: config.pairs // 2].sort()[0]
        with torch.autocast("cpu", dtype=torch.bfloat16):
            distances, logits = _compare(state.params, config, frames, chosen)
        distances, logits = distances.float(), logits.float()
        scores = (-distances).masked_fill(same, -1e4)
        own = torch.arange(ways)
        loss = functional.cross_entropy(scores, own)
        right = scores.argmax(dim=1) == own
        with torch.no_grad():
            mine = torch.eye(ways, dtype=torch.bool)
            rivals = scores.masked_fill(mine, -1e4).softmax(dim=1)
            rivals = (0.7 * rivals + 0.3 / (ways - 1)) * ~(mine | same)
            sure = 0.8 * right + 0.2
        yes = (functional.softplus(-logits.diagonal()) * sure).mean()
        no = (functional.softplus(logits) * rivals).sum(dim=1).mean()
        return loss + yes + no, float(right.float().mean())

    def validate(self, state: TrainingState) -> None:
        """Look with T and discriminator alone: the rest is added at the end."""
        plain = replace(self.recipe.config, warp_width=0, neighbours=0, mirrored=0.0)
        figures = self._validation.figures(
            Weights(plain, arrays(state.params), {}, f"step-{state.step}", Path())
        )
        self.keep_best(state, asdict(figures))

    def result(self, state: TrainingState) -> tuple[dict[str, Any], dict[str, Any]]:
        """The weights that did best, with warp components, cohort and score."""
        tensors = finalize(self.recipe.config, arrays(state.best), self.data, self.seed)
        return tensors, max(state.history, key=lambda figures: figures["score"])


def _compare(
    params: dict[str, Tensor], config: ModelConfig, frames: Tensor, chosen: Tensor
) -> tuple[Tensor, Tensor]:
    """T and logits (W, W), query by support, on the chosen pairs alone.

    Args:
        frames: (2·W, F, J, 3), those that enrol before those that ask.
        chosen: numbers of pairs of tokens.
    """

    def drop(x: Tensor) -> Tensor:
        return functional.dropout(x, _DROPOUT)

    features = trx_os.psi(params, config, token_features(config, frames), drop)
    features = drop(trx_os.with_positions(params, config, features))
    keys, values = trx_os.pairs(params, config, trx_os.project(params, config, features), chosen)
    ways = len(frames) // 2
    weights = trx_os.attention(keys[ways:, None], keys[None, :ways])  # (W, W, P, P)
    there = values[ways:, None] - trx_os.prototypes(weights, values[None, :ways])
    back = values[None, :ways] - trx_os.prototypes(weights.mT, values[ways:, None])
    distances = (trx_os.distance(config, there) + trx_os.distance(config, back)) / 2
    logits = [_judge(params, config, difference, chosen) for difference in (there, back)]
    return distances, (logits[0] + logits[1]) / 2


def _judge(
    params: dict[str, Tensor], config: ModelConfig, difference: Tensor, chosen: Tensor
) -> Tensor:
    """Disc where only some pairs were seen: the others are zero, these count double."""
    seen = trx_os.tuple_features(params, difference) * (config.pairs / len(chosen))
    features = seen.new_zeros(*seen.shape[:-2], config.pairs, seen.shape[-1])
    features[..., chosen, :] = seen
    logits: Tensor = trx_os.judge(params, features)
    return logits
