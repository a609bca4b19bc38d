"""Bones in training: their standard lengths, their numbers, unit vectors."""

from __future__ import annotations

import torch
from torch import Tensor

from actioncli.clips.skeleton import BONES

LENGTHS = torch.tensor([length for _, _, length in BONES])[:, None]
_AT = {child: bone for bone, (child, _, _) in enumerate(BONES)}


def bones_of(*joints: str) -> list[int]:
    """Numbers of the bones that end in these joints."""
    return [_AT[joint] for joint in joints]


def unit(vectors: Tensor) -> Tensor:
    """Vectors of length one; the zero vector stays."""
    scaled: Tensor = vectors / (torch.linalg.vector_norm(vectors, dim=-1, keepdim=True) + 1e-6)
    return scaled
