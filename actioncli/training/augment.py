"""Augmentation for the part transformer: what merely accompanies an action must not decide.

Everything works on batches of prepared clips: bones (N, 48, 14, 3) and hands (N, 48, 40, 3) as unit
vectors, missing parts (N, 48, 7). Strengths are in radians for directions and in shares of the
clip for time.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any, NamedTuple

import torch
from torch import Generator, Tensor

from actioncli.clips.skeleton import BONES, mirrored_columns

_BONE = {child: bone for bone, (child, _, _) in enumerate(BONES)}
_LENGTHS = torch.tensor([length for _, _, length in BONES])[:, None]
LEGS = [_BONE[joint] for joint in ("lkne", "rkne", "lank", "rank")]
LEFT_ARM = [_BONE[joint] for joint in ("lsho", "lelb", "lwri")]
RIGHT_ARM = [_BONE[joint] for joint in ("rsho", "relb", "rwri")]
_TRUNK = [_BONE[joint] for joint in ("lhip", "rhip", "neck")]


class Batch(NamedTuple):
    """N prepared clips as tensors, see `PartFrames`."""

    bones: Tensor
    hands: Tensor
    missing: Tensor

    def rows(self, rows: Any) -> Batch:
        """Some of the clips."""
        return Batch(*(part[rows] for part in self))


def unit(vectors: Tensor) -> Tensor:
    """Vectors of length one; the zero vector stays."""
    scaled: Tensor = vectors / (torch.linalg.vector_norm(vectors, dim=-1, keepdim=True) + 1e-6)
    return scaled


def joined(batches: Sequence[Batch]) -> Batch:
    """All clips of several batches, one batch after another."""
    return Batch(*(torch.cat(parts) for parts in zip(*batches, strict=True)))


def augment(batch: Batch, chance: Generator, estimated: float = 0.6) -> Batch:
    """Another performance of each clip, by another person, before another sensor.

    Args:
        estimated: share of clips that look as if a pose estimator had found them in video.
    """
    bones, hands, missing = _warped(_transplanted(batch, chance), chance)
    n = len(bones)
    mean = bones.mean(1, keepdim=True)
    bones = mean + (bones - mean) * (0.75 + 0.6 * _uniform(chance, n, 1, 1, 1))
    bones = bones + 0.08 * _normal(chance, n, 1, 14, 3)
    bones = _seen_by_camera(unit(_turned(bones, (0.25, 0.12, 0.07), chance)), chance, estimated)
    trembling = _uniform(chance, n, 1, 1, 1) * (_uniform(chance, n, 1, 1, 1) < 0.4)
    bones = bones + 0.05 * _uniform(chance, n, 1, 1, 1) * _wander(chance, n, 42, 12).reshape(
        n, 48, 14, 3
    )
    bones = bones + 0.04 * trembling * _normal(chance, n, 48, 14, 3)
    hands = hands + 0.12 * _normal(chance, n, 1, 40, 3) * _uniform(chance, n, 1, 1, 1)
    hands = hands + 0.08 * _uniform(chance, n, 1, 1, 1) * _normal(chance, n, 48, 40, 3)
    hands = unit(_turned(hands, (0.2, 0.15, 0.15), chance))
    return _unseen(Batch(unit(bones), hands, missing), chance)


def _transplanted(batch: Batch, chance: Generator) -> Batch:
    """In three clips of ten, limbs that hardly move take the posture of another clip's limb."""
    bones = batch.bones
    moved = bones - bones.mean(1, keepdim=True)
    whole = (moved**2).sum((1, 2, 3)) + 1e-6
    for limb in (LEGS, LEFT_ARM, RIGHT_ARM):
        share = (moved[:, :, limb] ** 2).sum((1, 2, 3)) / whole
        chosen = (_uniform(chance, len(bones)) < 0.3) & (share < 0.12)
        order = torch.randperm(len(bones), generator=chance, device=bones.device)
        mean = bones[:, :, limb].mean(1, keepdim=True)[order]
        other = unit(mean + moved[:, :, limb])
        bones = bones.clone()
        bones[:, :, limb] = torch.where(chosen[:, None, None, None], other, bones[:, :, limb])
    return batch._replace(bones=bones)


def _warped(batch: Batch, chance: Generator) -> Batch:
    """Up to 12 % cut off either end of six clips in ten, and the tempo varied."""
    n, frames = batch.bones.shape[:2]
    cut = [0.12 * _uniform(chance, n, 1) * (_uniform(chance, n, 1) < 0.6) for _ in range(2)]
    t = torch.linspace(0, 1, frames, device=batch.bones.device)[None]
    bend = 0.25 * (2 * _uniform(chance, n, 1) - 1)
    t = t + bend * torch.sin(math.pi * t) / math.pi
    t = t + 0.06 * _normal(chance, n, 1) * torch.sin(2 * math.pi * t)
    return at_times(batch, cut[0] + (1 - cut[0] - cut[1]) * t)


def at_times(batch: Batch, times: Tensor) -> Batch:
    """Clips at other times (N, 48), 0 for the first frame and 1 for the last."""
    last = batch.bones.shape[1] - 1
    at = times.clamp(0, 1) * last
    before = at.floor().long().clamp(max=last - 1)
    share = (at - before)[..., None, None]
    row = torch.arange(len(at), device=at.device)[:, None]
    nearest = before + (share[..., 0, 0] >= 0.5)
    bones = batch.bones[row, before] * (1 - share) + batch.bones[row, before + 1] * share
    # Hands of which only one neighbour was seen cannot be interpolated.
    return Batch(unit(bones), batch.hands[row, nearest], batch.missing[row, nearest])


def _seen_by_camera(bones: Tensor, chance: Generator, estimated: float) -> Tensor:
    """Bones as a pose network finds them: what moves along the line of sight is flattened, every
    bone leans, most of all in depth, and wanders.

    BlazePose beside optical motion capture (17,847 frames, eight cameras, windows of 3 s): the
    slope of found on true depth is 0.62 (quartiles 0.44 and 0.76); a bone's direction is off by
    0.19 across, 0.23 up and 0.26 in depth throughout, and wanders by 0.08, 0.06 and 0.11.
    """
    n = len(bones)
    chosen = (_uniform(chance, n, 1, 1, 1) < estimated).float()
    around, above = 0.6 * _normal(chance, n), 0.15 * _normal(chance, n)
    depth = torch.stack([around.sin() * above.cos(), -above.sin(), around.cos() * above.cos()], 1)[
        :, None, None
    ]
    along = (bones * depth).sum(-1, keepdim=True)
    scale = 0.4 + 0.6 * _uniform(chance, n, 1, 1, 1)
    lean = 0.3 * _uniform(chance, n, 1, 1, 1) * _normal(chance, n, 1, 14, 1)
    lean = lean + 0.25 * _uniform(chance, n, 1, 1, 1) * _wander(chance, n, 14, 7)[..., None]
    lean = lean / _LENGTHS.to(bones.device).clamp(min=0.3).sqrt()
    across = 0.2 * _uniform(chance, n, 1, 1, 1) * _normal(chance, n, 1, 14, 3)
    return unit(bones + chosen * (((scale - 1) * along + lean) * depth + across))


def _unseen(batch: Batch, chance: Generator) -> Batch:
    """Parts that were not seen: legs out of the picture, arms hidden, hands lost for a while."""
    bones, hands, missing = batch
    n = len(bones)
    drop = _uniform(chance, n, 7) < 0.05
    drop[:, 0] = False
    no_legs = _uniform(chance, n) < 0.18
    drop[:, 3:5] |= no_legs[:, None]
    drop[:, 1:3] |= _uniform(chance, n, 2) < 0.06
    drop[:, 5:] |= (_uniform(chance, n) < 0.15)[:, None]
    # Somebody at a desk has no hips either: they are put below the shoulders.
    desk = (no_legs & (_uniform(chance, n) < 0.5))[:, None, None, None]
    trunk = torch.tensor([[-1.0, 0, 0], [1.0, 0, 0], [0, 1.0, 0]], device=bones.device)
    bones = bones.clone()
    bones[:, :, _TRUNK] = torch.where(desk, trunk, bones[:, :, _TRUNK])
    for_a_while = _wander(chance, n, 7, 8)
    lost = for_a_while > torch.tensor([9.0, 2.2, 2.2, 2.2, 2.2, 1.3, 1.3], device=bones.device)
    missing = missing | drop[:, None] | lost
    there = ~missing[:, :, 5:].repeat_interleave(20, -1)[..., None]
    return Batch(bones, hands * there, missing)


def mirrored(batch: Batch) -> Batch:
    """Left and right exchanged."""
    order = mirrored_columns([child for child, _, _ in BONES])
    flip = torch.tensor([-1.0, 1.0, 1.0], device=batch.bones.device)
    hands = torch.cat([batch.hands[:, :, 20:], batch.hands[:, :, :20]], 2)
    return Batch(
        batch.bones[:, :, order] * flip, hands * flip, batch.missing[..., [0, 2, 1, 4, 3, 6, 5]]
    )


def _turned(x: Tensor, strengths: tuple[float, float, float], chance: Generator) -> Tensor:
    """A heading found a little wrong, a camera that looks up or down, or is tilted."""
    whole = torch.eye(3, device=x.device).expand(len(x), 3, 3)
    for strength, (i, j) in zip(strengths, ((0, 2), (1, 2), (0, 1)), strict=True):
        angle = strength * _normal(chance, len(x))
        one = torch.eye(3, device=x.device).repeat(len(x), 1, 1)
        one[:, i, i] = one[:, j, j] = angle.cos()
        one[:, i, j], one[:, j, i] = -angle.sin(), angle.sin()
        whole = whole @ one
    return (x.flatten(1, 2) @ whole.mT).reshape(x.shape)


def _wander(chance: Generator, n: int, count: int, knots: int) -> Tensor:
    """Slow random courses over the 48 frames, (N, 48, count)."""
    return torch.nn.functional.interpolate(
        _normal(chance, n, count, knots), 48, mode="linear", align_corners=True
    ).mT


def _uniform(chance: Generator, *shape: int) -> Tensor:
    return torch.rand(*shape, generator=chance, device=chance.device)


def _normal(chance: Generator, *shape: int) -> Tensor:
    return torch.randn(*shape, generator=chance, device=chance.device)
