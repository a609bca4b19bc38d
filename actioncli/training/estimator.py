"""Augmentation: bodies as a pose estimator finds them in the pictures of one camera.

Such estimators see two dimensions and guess the third: limbs are drawn out or flattened in depth,
lean towards or away from the camera for a while, and follow quick movements late, since estimates
are smoothed. What the picture does not show is put where it most often is.
"""

from __future__ import annotations

import torch
from torch import Generator, Tensor

from actioncli.training.motions import FRAMES, LENGTHS, bones_of, unit

# Hands and lower legs leave the picture, or hide behind something, before all else does.
_OUT_OF_SIGHT = (
    bones_of("lank", "rank"),
    bones_of("lkne", "rkne", "lank", "rank"),
    bones_of("lwri"),
    bones_of("rwri"),
)
_HIDDEN = 0.25


def estimate(bones: Tensor, chance: Generator) -> Tensor:
    """What an estimator might have made of each clip.

    Args:
        bones: (B, 64, 14, 3) unit bone directions, the body facing -z.
        chance: where randomness comes from.

    Returns:
        the same shape, unit vectors.
    """
    bones = hide(bones, chance)
    return lag(mistake_depth(bones, chance), chance)


def mistake_depth(bones: Tensor, chance: Generator) -> Tensor:
    """Scale each bone's depth by 0.5 to 1.1, then let it lean by what stays and what wanders."""
    batch, frames, count = bones.shape[:3]
    around = 0.6 * torch.randn(batch, generator=chance)
    above = 0.15 * torch.randn(batch, generator=chance)
    depth = torch.stack(
        [around.sin() * above.cos(), -above.sin(), around.cos() * above.cos()], dim=1
    )[:, None, None]
    scale = 0.5 + 0.6 * torch.rand(batch, 1, 1, 1, generator=chance)
    wander = torch.nn.functional.interpolate(
        torch.randn(batch, count, 7, generator=chance), frames, mode="linear", align_corners=True
    ).mT[..., None]
    strength = torch.rand(2, batch, 1, 1, 1, generator=chance)
    lean = 0.2 * strength[0] * torch.randn(batch, 1, count, 1, generator=chance)
    lean = (lean + 0.25 * strength[1] * wander) / LENGTHS.clamp(min=0.3).sqrt()
    along = (bones * depth).sum(dim=-1, keepdim=True)
    return unit(bones + ((scale - 1) * along + lean) * depth)


def hide(bones: Tensor, chance: Generator) -> Tensor:
    """A quarter of the clips do not show hands or legs, whose bones stay near their mean."""
    bones = bones.clone()
    for clip in torch.nonzero(torch.rand(len(bones), generator=chance) < _HIDDEN)[:, 0].tolist():
        hidden = _OUT_OF_SIGHT[int(torch.randint(len(_OUT_OF_SIGHT), (1,), generator=chance))]
        unseen = bones[clip][:, hidden]
        seen = 0.3 * torch.rand(1, generator=chance)
        bones[clip][:, hidden] = unit(unseen.mean(dim=0) + seen * (unseen - unseen.mean(dim=0)))
    return bones


def lag(bones: Tensor, chance: Generator) -> Tensor:
    """Follow the motion late: an exponential average with up to 4 of 64 frames' memory."""
    memory = 4 * torch.rand(len(bones), 1, 1, generator=chance)
    back = torch.arange(FRAMES)[:, None] - torch.arange(FRAMES)
    weight = torch.where(back >= 0, torch.exp(-back / memory.clamp(min=0.05)), 0.0)
    weight = weight / weight.sum(dim=2, keepdim=True)
    return unit(torch.einsum("bts,bsjc->btjc", weight, bones))
