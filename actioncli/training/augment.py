"""Augmentation: other performers, sensors and pose estimators than those that were recorded.

Strengths are in radians for directions and in shares of the clip for time. They were chosen on
validation classes; the model card tells what each is worth.
"""

from __future__ import annotations

import torch
from torch import Generator, Tensor

from actioncli.training.estimator import estimate
from actioncli.training.motions import (
    LEFT_ARM,
    LEFT_LEG,
    LENGTHS,
    RIGHT_ARM,
    RIGHT_LEG,
    at_times,
    unit,
)


def augment(bones: Tensor, chance: Generator, estimated: float) -> Tensor:
    """Everything that may happen to a recording, each clip another way.

    Args:
        bones: (B, T, 14, 3) unit bone directions.
        chance: where randomness comes from.
        estimated: share of clips that look as if a pose estimator had found them in video.
    """
    bones = warp_time(bones, chance)
    bones = swap_limbs(bones, chance)
    bones = freeze_bones(bones, chance)
    bones = exaggerate(disturb(bones, chance), chance)
    if estimated:
        chosen = _uniform(chance, len(bones), 1, 1, 1) < estimated
        bones = torch.where(chosen, estimate(bones, chance), bones)
    return turn(bones, chance)


def warp_time(bones: Tensor, chance: Generator) -> Tensor:
    """Cut up to 15 % off each end, vary the tempo, let three in ten idle before or after."""
    batch, frames = bones.shape[:2]
    begin = 0.15 * _uniform(chance, batch)
    end = 1 - 0.15 * _uniform(chance, batch)
    knots = (1 + 0.375 * (2 * _uniform(chance, batch, 5) - 1)).clamp(min=0.2)
    tempo = torch.nn.functional.interpolate(
        knots[:, None], frames - 1, mode="linear", align_corners=True
    )[:, 0]
    progress = torch.cat([torch.zeros(batch, 1), tempo.cumsum(dim=1)], dim=1)
    progress = progress / progress[:, -1:]
    before, after = (
        0.4 * _uniform(chance, batch) * (_uniform(chance, batch) < 0.3) for _ in range(2)
    )
    progress = progress * (1 + before + after)[:, None] - before[:, None]
    times = begin[:, None] + (end - begin)[:, None] * progress.clamp(0, 1)
    return at_times(bones, times * (frames - 1))


def swap_limbs(bones: Tensor, chance: Generator) -> Tensor:
    """One clip in ten has its arms or its legs exchanged for some frames, as estimators do."""
    bones = bones.clone()
    for clip in torch.nonzero(_uniform(chance, len(bones)) < 0.1)[:, 0].tolist():
        first = int(_uniform(chance, 1) * 50)
        span = slice(first, first + 3 + int(_uniform(chance, 1) * 12))
        left, right = (LEFT_ARM, RIGHT_ARM) if _uniform(chance, 1) < 0.5 else (LEFT_LEG, RIGHT_LEG)
        frames = bones[clip, span]  # a view, so that writing to it changes the clip
        frames[:, left], frames[:, right] = frames[:, right], frames[:, left]
    return bones


def freeze_bones(bones: Tensor, chance: Generator) -> Tensor:
    """Three clips in ten lose a joint for a while, and it is interpolated."""
    bones = bones.clone()
    last = bones.shape[1] - 1
    for clip in torch.nonzero(_uniform(chance, len(bones)) < 0.3)[:, 0].tolist():
        bone = int(_uniform(chance, 1) * bones.shape[2])
        first = int(_uniform(chance, 1) * 50)
        end = min(last, first + 5 + int(_uniform(chance, 1) * 20))
        share = torch.linspace(0, 1, end - first + 1)[:, None]
        line = bones[clip, first, bone] * (1 - share) + bones[clip, end, bone] * share
        bones[clip, first : end + 1, bone] = line
    return bones


def disturb(bones: Tensor, chance: Generator) -> Tensor:
    """Joints that a sensor places otherwise, that wander and that tremble; often worse in depth."""
    batch, frames, count = bones.shape[:3]
    wander = torch.nn.functional.interpolate(
        _normal(chance, batch, count * 3, 8), frames, mode="linear", align_corners=True
    )
    wander = wander.transpose(1, 2).reshape(batch, frames, count, 3)
    error = (
        0.07 * _normal(chance, batch, 1, count, 3)
        + 0.06 * _uniform(chance, batch, 1, 1, 1) * wander
        + 0.05 * _uniform(chance, batch, 1, 1, 1) * _normal(chance, batch, frames, count, 3)
    )
    deep = 2 * _uniform(chance, batch, 1, 1, 1) * (_uniform(chance, batch, 1, 1, 1) < 0.5)
    depth = 1 + deep * torch.tensor([0.0, 0.0, 1.0])
    # An error of a joint's place turns a short bone more than a long one.
    return unit(bones + depth * error / LENGTHS.clamp(min=0.3).sqrt())


def exaggerate(bones: Tensor, chance: Generator) -> Tensor:
    """Larger or smaller movements about the mean pose: style."""
    mean = bones.mean(dim=1, keepdim=True)
    factor = (1 + 0.15 * torch.randn(len(bones), generator=chance)).clamp(0.5, 1.6)
    return unit(mean + (bones - mean) * factor[:, None, None, None])


def turn(bones: Tensor, chance: Generator) -> Tensor:
    """A heading that was found a little wrong, a camera that looks up or down or is tilted."""
    turns = torch.eye(3).repeat(len(bones), 1, 1)
    for strength, (i, j) in ((0.2, (0, 2)), (0.1, (1, 2)), (0.06, (0, 1))):
        angle = strength * torch.randn(len(bones), generator=chance)
        one = torch.eye(3).repeat(len(bones), 1, 1)
        one[:, i, i] = one[:, j, j] = angle.cos()
        one[:, i, j], one[:, j, i] = -angle.sin(), angle.sin()
        turns = turns @ one
    return torch.einsum("btjc,bdc->btjd", bones, turns)


def _uniform(chance: Generator, *shape: int) -> Tensor:
    return torch.rand(*shape, generator=chance)


def _normal(chance: Generator, *shape: int) -> Tensor:
    return torch.randn(*shape, generator=chance)
