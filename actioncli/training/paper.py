"""The recipe `paper`: TRX-OS as published, on episodes of recorded clips as they are."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np
import torch
from torch import Tensor

from actioncli.clips.prepare import prepare
from actioncli.errors import UsageError
from actioncli.model.config import ModelConfig
from actioncli.model.trx_os import parameter_shapes
from actioncli.training.checkpoint import TrainingState
from actioncli.training.episodes import draw_episodes
from actioncli.training.loop import Recipe, Run, arrays
from actioncli.training.paper_loss import episode_loss
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
        return self.start(parameter_shapes(recipe.config), {})

    def loss(self, state: TrainingState, rng: np.random.Generator) -> tuple[Tensor, float]:
        """Of `batch` episodes."""
        drawn = draw_episodes(self.data, self.recipe.batch, self.recipe.ways, rng)
        support, queries, targets = (
            torch.from_numpy(rows).to(self.device)
            for rows in (drawn.support, drawn.queries, drawn.targets)
        )
        clips = self._frames[support], self._frames[queries]
        return episode_loss(state.params, self.recipe.config, *clips, targets)

    def validate(self, state: TrainingState) -> None:
        """Keep the weights if they are the best so far."""
        self.keep_best(state, self._validation.figures(arrays(state.params)))

    def result(self, state: TrainingState) -> tuple[dict[str, Any], dict[str, Any]]:
        """The weights that did best."""
        return arrays(state.best), max(state.history, key=lambda figures: figures["score"])
