"""Actions that nobody recorded, made of two that somebody did."""

from __future__ import annotations

import numpy as np
import torch
from torch import Tensor

from actioncli.training.augment import LEGS, Batch, at_times

# Shares of tasks with legs of another action, and with another action's second half; in these, the
# shares of actions that are so changed.
LEGS_OF_ANOTHER, HALF_OF_ANOTHER = 0.5, 0.2
_WITH_LEGS, _WITH_HALF = 0.4, 0.3


def composed(pair: list[Batch], rng: np.random.Generator) -> list[Batch]:
    """Supports and queries (W clips each) of one action for each place, some now of new ones.

    A new action has arms and trunk of one and legs of another, or the first half of one and then
    the second half of another; in both batches of the same two.
    """
    u, w = rng.random(), len(pair[0].bones)
    if w < 2 or u >= LEGS_OF_ANOTHER + HALF_OF_ANOTHER:
        return pair
    other = torch.from_numpy((np.arange(w) + 1 + rng.integers(w - 1)) % w)
    legs = u < LEGS_OF_ANOTHER
    changed = torch.from_numpy(rng.random(w) < (_WITH_LEGS if legs else _WITH_HALF))
    make = with_legs_of if legs else followed_by
    return [where(changed, make(clips, clips.rows(other)), clips) for clips in pair]


def where(chosen: Tensor, one: Batch, other: Batch) -> Batch:
    """Clips of `one` where `chosen` (N,), of `other` elsewhere."""

    def shaped(like: Tensor) -> Tensor:
        return chosen.to(like.device).reshape(-1, *[1] * (like.ndim - 1))

    return Batch(*(torch.where(shaped(a), a, b) for a, b in zip(one, other, strict=True)))


def with_legs_of(clips: Batch, other: Batch) -> Batch:
    """Legs, and whether they were seen, of other clips."""
    bones, missing = clips.bones.clone(), clips.missing.clone()
    bones[:, :, LEGS] = other.bones[:, :, LEGS]
    missing[:, :, 3:5] = other.missing[:, :, 3:5]
    return Batch(bones, clips.hands, missing)


def followed_by(clips: Batch, other: Batch) -> Batch:
    """All of each clip in the first half of the time, then all of another."""
    n, frames = clips.bones.shape[:2]
    times = torch.linspace(0, 1, frames // 2, device=clips.bones.device).repeat(n, 2)
    first, second = at_times(clips, times), at_times(other, times)
    half = frames // 2
    return Batch(
        *(torch.cat([a[:, :half], b[:, half:]], 1) for a, b in zip(first, second, strict=True))
    )
