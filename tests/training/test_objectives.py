"""Every switch of the default recipe can be turned off, and a step still has its gradients."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
import torch

from actioncli.training.data import TrainingSet
from actioncli.training.loop import _new_state
from actioncli.training.objectives import objective
from actioncli.training.recipes import RECIPES, Recipe

DEFAULT = RECIPES["default"]


def changed(model: dict[str, Any], preparation: dict[str, Any], training: dict[str, Any]) -> Recipe:
    config = replace(DEFAULT.config, **model)
    config = replace(config, preparation=replace(config.preparation, **preparation))
    return replace(DEFAULT, config=config, ways=5, **training)


@pytest.mark.parametrize(
    ("model", "preparation", "training"),
    [
        ({}, {}, {}),
        ({"both_ways": False}, {}, {}),
        ({"near_pairs": True}, {}, {}),
        ({"convolutions": 0}, {}, {}),
        ({"distance": "squared"}, {}, {}),
        ({"body_features": False}, {"size": "torso"}, {}),
        ({}, {"frames": 16, "motion": 0.0}, {}),
        ({}, {"heading": False}, {}),
        ({}, {}, {"disturbed": False}),
    ],
    ids=lambda changes: ",".join(changes) or "-",
)
def test_a_step_reaches_every_parameter(
    world: TrainingSet,
    model: dict[str, Any],
    preparation: dict[str, Any],
    training: dict[str, Any],
) -> None:
    recipe = changed(model, preparation, training)
    aim = objective(recipe, world)
    params = _new_state(recipe.config, 0).params
    result = aim.loss(params, np.random.default_rng(0))
    result.loss.backward()  # type: ignore[no-untyped-call]  # torch declares no types here
    assert torch.isfinite(result.loss)
    for name, tensor in params.items():
        assert tensor.grad is not None, name
        assert torch.isfinite(tensor.grad).all(), name
