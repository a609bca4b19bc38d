"""Negatives made of an action itself: nearly its motion, but not the action."""

from __future__ import annotations

import torch
from torch import Generator, Tensor

from actioncli.training.augment import (
    LEFT_ARM,
    LEGS,
    RIGHT_ARM,
    Batch,
    at_times,
    mirrored,
    unit,
)

KINDS = ("reversed", "limb frozen", "static", "four blocks", "first quarter", "mirrored")
# How often each is made: those that pass most easily most often.
SHARES = (0.26, 0.28, 0.07, 0.2, 0.06, 0.13)


def negatives(batch: Batch, kind: Tensor, chance: Generator) -> Batch:
    """Change each clip in the way of its `kind` (N,), a number of `KINDS`."""
    made = [
        backwards(batch),
        _limb_frozen(batch),
        _static(batch, chance),
        at_times(batch, _four_blocks(len(kind), chance)),
        at_times(batch, torch.linspace(0, 0.25, 48, device=kind.device).expand(len(kind), -1)),
        mirrored(batch),
    ]
    row = torch.arange(len(kind), device=kind.device)
    return Batch(*(torch.stack(parts)[kind, row] for parts in zip(*made, strict=True)))


def backwards(batch: Batch) -> Batch:
    """Time reversed."""
    return Batch(*(part.flip(1) for part in batch))


def _limb_frozen(batch: Batch) -> Batch:
    """The arm, or the legs, that move most stay in their mean pose."""
    bones = batch.bones
    limbs = (LEFT_ARM, RIGHT_ARM, LEGS)
    still = bones.mean(1, keepdim=True)
    moved = torch.stack([((bones - still)[:, :, limb] ** 2).sum((1, 2, 3)) for limb in limbs])
    most = moved.argmax(0)
    for number, limb in enumerate(limbs):
        chosen = (most == number)[:, None, None, None]
        bones = bones.clone()
        bones[:, :, limb] = torch.where(chosen, unit(still)[:, :, limb], bones[:, :, limb])
    return batch._replace(bones=bones)


def _static(batch: Batch, chance: Generator) -> Batch:
    """The first pose, trembling by what 5 mm turn a bone."""
    noise = torch.randn(batch.bones.shape, generator=chance, device=chance.device)
    first = Batch(*(part[:, :1].expand_as(part) for part in batch))
    return first._replace(bones=unit(first.bones + 0.015 * noise))


def _four_blocks(count: int, chance: Generator) -> Tensor:
    """Times of clips whose four quarters are in another order, (count, 48)."""
    order = torch.rand(count, 4, generator=chance, device=chance.device).argsort(1)
    kept = (order == torch.arange(4, device=order.device)).all(1, keepdim=True)
    order = torch.where(kept, order.flip(1), order)
    block = torch.arange(48, device=order.device) // 12
    within = torch.arange(48, device=order.device) % 12
    return (order[:, block] * 12 + within) / 47


def apart(one: Batch, other: Batch) -> Tensor:
    """How far motions are apart where a sixth of the clip may pass between like moments, (N,).

    Poses and velocities are compared, so a movement back is not the one forth; but a repeated
    movement is the same whichever repetition it is held against.
    """

    def moments(batch: Batch) -> Tensor:
        bones = batch.bones.reshape(len(batch.bones), 24, 2, -1).mean(2)
        speed = torch.zeros_like(bones)
        speed[:, 1:-1] = (bones[:, 2:] - bones[:, :-2]) / 2
        hands = batch.hands.reshape(len(batch.hands), 24, 2, -1).mean(2)
        return torch.cat([bones, 3 * speed, 0.4 * hands], 2)

    distance = torch.cdist(moments(one), moments(other))
    at = torch.arange(24, device=distance.device)
    distance = distance + 1e3 * ((at[:, None] - at).abs() > 4)
    return (distance.amin(2).mean(1) + distance.amin(1).mean(1)) / 2
