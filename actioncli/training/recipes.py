"""Recipes: everything that decides what a training run produces, apart from data and seed."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Any

from actioncli.clips.prepare import Preparation
from actioncli.model.config import ModelConfig


@dataclass(frozen=True, slots=True)
class Recipe:
    """How to train.

    Attributes:
        name: as given to `--recipe`.
        config: the model.
        steps: optimiser steps.
        ways: actions per episode.
        batch: episodes per step; the default recipe has one, of many ways.
        rate: peak learning rate of AdamW, reached after 50 steps, then falling to nearly zero
            as a half cosine.
        weight_decay: of matrices.
        sigma: weight of the discriminator's loss.
        augmented: one task of many ways a step, see `tasks` and `objectives.ManyWays`; else the
            paper's episodes of recorded clips. The rest belongs to it:
        disturbed: clips go through `augment`.
        estimated: share of clips that also go through `estimator`, as if found in video.
        validate_every: steps between looks at the validation classes.
    """

    name: str
    config: ModelConfig
    steps: int
    ways: int
    batch: int = 1
    rate: float = 1e-3
    weight_decay: float = 0.01
    sigma: float = 1.0
    augmented: bool = False
    disturbed: bool = False
    estimated: float = 0.0
    validate_every: int = 250

    def as_json(self) -> dict[str, Any]:
        """Plain values for the header of the weights."""
        return asdict(self)


RECIPES = {
    recipe.name: recipe
    for recipe in (
        Recipe(
            "default",
            ModelConfig(
                Preparation(frames=48, size="standard", heading=True, motion=0.5),
                key_width=64,
                distance="l2",
                body_features=True,
                convolutions=2,
                both_ways=True,
                warp_width=16,
                neighbours=20,
                mirrored=1.5,
            ),
            steps=6000,
            ways=20,
            weight_decay=0.05,
            augmented=True,
            disturbed=True,
            estimated=0.8,
            validate_every=500,
        ),
        Recipe("paper", ModelConfig(), steps=1500, ways=5, batch=4),
    )
}
