"""Motions that training can bend: bone directions over time, from which bodies are rebuilt.

Everything here works on batches (B, 64, 14, 3) of unit vectors along the bones of
`actioncli.clips.skeleton.BONES`, turned to the common heading, equidistant in time. Parts of two
people's motions can be put together without tearing a body apart, and whatever is added to a
direction leaves the bones' lengths as they are.
"""

from __future__ import annotations

import numpy as np
import torch
from torch import Tensor

from actioncli.clips.clip import Clip
from actioncli.clips.prepare import Preparation, prepare
from actioncli.clips.skeleton import BONES, DEFAULT_JOINTS, LIMBS, bone_columns

FRAMES = 64

_AT = {child: bone for bone, (child, _, _) in enumerate(BONES)}
LENGTHS = torch.tensor([length for _, _, length in BONES])[:, None]


def bones_of(*joints: str) -> list[int]:
    """Numbers of the bones that end in these joints."""
    return [_AT[joint] for joint in joints]


# The two bones of each limb.
LEFT_ARM, RIGHT_ARM, LEFT_LEG, RIGHT_LEG = (bones_of(*limb[1:]) for limb in LIMBS.values())


def directions(clips: list[Clip], preparation: Preparation) -> Tensor:
    """Clips as (N, 64, 14, 3) unit bone directions, with or without a common heading."""
    how = Preparation(frames=FRAMES, size="standard", heading=preparation.heading)
    return unit(_bones(clips, how))


def bone_lengths(clips: list[Clip], preparation: Preparation) -> Tensor:
    """How long the model will see each clip's bones, (N, 14): the standard, or their medians."""
    if preparation.size == "standard":
        return LENGTHS[:, 0].expand(len(clips), -1)
    bones = _bones(clips, Preparation(frames=FRAMES, size=preparation.size))
    lengths: Tensor = torch.linalg.vector_norm(bones, dim=-1).median(dim=1).values
    return lengths


def _bones(clips: list[Clip], how: Preparation) -> Tensor:
    joints = torch.from_numpy(np.stack([prepare(clip, how) for clip in clips]))
    children, parents = bone_columns(DEFAULT_JOINTS)
    bones: Tensor = joints[:, :, children] - joints[:, :, parents]
    return bones


def bodies(bones: Tensor, lengths: Tensor = LENGTHS) -> Tensor:
    """Bodies with these bone directions, (..., 14, 3) → (..., 15, 3).

    Args:
        bones: unit vectors.
        lengths: (..., 14, 1); without it those of the standard body.
    """
    long = bones * lengths
    joints: dict[str, Tensor] = {"pelv": torch.zeros_like(bones[..., 0, :])}
    for bone, (child, parent, _) in enumerate(BONES):
        joints[child] = joints[parent] + long[..., bone, :]
    return torch.stack([joints[name] for name in DEFAULT_JOINTS], dim=-2)


def unit(vectors: Tensor) -> Tensor:
    """Vectors of length one; the zero vector stays."""
    scaled: Tensor = vectors / (torch.linalg.vector_norm(vectors, dim=-1, keepdim=True) + 1e-6)
    return scaled


def at_times(bones: Tensor, times: Tensor) -> Tensor:
    """Interpolate in time.

    Args:
        bones: (B, T, 14, 3).
        times: (B, n) in frames, between 0 and T - 1.

    Returns:
        (B, n, 14, 3).
    """
    before = times.floor().long().clamp(0, bones.shape[1] - 2)
    share = (times - before)[..., None, None]
    row = torch.arange(len(bones))[:, None]
    return bones[row, before] * (1 - share) + bones[row, before + 1] * share


def frames_for_model(bones: Tensor, preparation: Preparation, lengths: Tensor) -> Tensor:
    """What `prepare` would give, equidistant in motion as far as it says.

    Args:
        bones: (B, 64, 14, 3).
        preparation: the model's.
        lengths: (B, 14) from `bone_lengths`.

    Returns:
        (B, frames, 15, 3).
    """
    long = lengths[:, None, :, None]
    joints = bodies(bones, long)
    last = bones.shape[1] - 1
    moved = torch.linalg.vector_norm(joints[:, 1:] - joints[:, :-1], dim=-1).mean(dim=-1)
    share = moved / moved.sum(dim=1, keepdim=True).clamp(min=1e-9)
    advance = (1 - preparation.motion) / last + preparation.motion * share
    clock = torch.cat([torch.zeros(len(bones), 1), advance.cumsum(dim=1)], dim=1)
    clock = clock / clock[:, -1:]
    ticks = torch.linspace(0, 1, preparation.frames).expand(len(bones), -1).contiguous()
    after = torch.searchsorted(clock.contiguous(), ticks).clamp(1, last)
    low, high = clock.gather(1, after - 1), clock.gather(1, after)
    times = after - 1 + ((ticks - low) / (high - low + 1e-9)).clamp(0, 1)
    return bodies(unit(at_times(bones, times)), long)
