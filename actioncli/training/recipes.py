"""Recipes: everything that decides what a training run produces, apart from data and seed."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Any

from actioncli.model.config import ModelConfig


@dataclass(frozen=True, slots=True)
class Recipe:
    """How to train.

    Attributes:
        name: as given to `--recipe`.
        config: the model.
        steps: optimiser steps.
        batch: episodes per step.
        ways: actions per episode.
        rate: peak learning rate of Adam, reached after 100 steps, then falling to zero as a
            half cosine.
        sigma: weight of the discriminator's loss.
        validate_every: steps between looks at the validation classes.
    """

    name: str
    config: ModelConfig
    steps: int
    batch: int
    ways: int
    rate: float
    sigma: float = 1.0
    validate_every: int = 250

    def as_json(self) -> dict[str, Any]:
        """Plain values for the header of the weights."""
        return asdict(self)


RECIPES = {
    recipe.name: recipe
    for recipe in (Recipe("paper", ModelConfig(), steps=1500, batch=4, ways=5, rate=1e-3),)
}
