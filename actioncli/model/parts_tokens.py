"""What the part transformer reads of prepared clips, for numpy arrays and torch tensors alike."""

from __future__ import annotations

from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from actioncli.clips.parts import PARTS
from actioncli.clips.skeleton import BONES
from actioncli.model.arrays import Array, like, namespace
from actioncli.model.config import PartsConfig

# Bones of torso, arms and legs; the last one of each ends where the part ends.
PART_BONES = ((2, 7, 0), (8, 10, 12), (9, 11, 13), (0, 3, 5), (1, 4, 6))
BODY, HAND = 33, 180  # numbers a token: see `tokens`


@lru_cache(maxsize=1)
def _reach() -> NDArray[np.float32]:
    """(14, 14): length of each bone that leads from the pelvis to a joint, else 0."""
    row = {child: at for at, (child, _, _) in enumerate(BONES)}
    reach = np.zeros((len(BONES), len(BONES)), np.float32)
    for at, (child, parent, length) in enumerate(BONES):
        if parent in row:
            reach[at] = reach[row[parent]]
        reach[at, row[child]] = length
    return reach


def tokens(
    config: PartsConfig, bones: Array, hands: Array, missing: Array
) -> tuple[Array, Array, Array]:
    """What the first layer reads of clips (see `PartFrames`): neighbouring frames are averaged.

    Of a part of the body 3 bones' directions, their deviation from the clip's mean, where the
    part ends, the joints' velocity, and the end's deviation; of a hand 20 bones' directions,
    deviations and velocities. The factors bring them to like size.

    Returns:
        body (N, T, 5, 33), hands (N, T, 2, 180), and missing (N, P, T) as 0 or 1.
    """
    xp = namespace(bones)
    n, t, step = len(bones), config.tokens, bones.shape[1] // config.tokens
    bones = xp.mean(xp.reshape(bones, (n, t, step, len(BONES), 3)), axis=2)
    place = xp.matmul(like(bones, _reach()), bones)
    turned, moved = _deviation(bones), _deviation(place)
    velocity = _velocity(place)
    body = xp.stack(
        [
            _flat(
                bones[:, :, part],
                1.5 * turned[:, :, part],
                place[:, :, part[-1:]],
                3 * velocity[:, :, part],
                1.5 * moved[:, :, part[-1:]],
            )
            for part in map(list, PART_BONES)
        ],
        axis=2,
    )
    absent = xp.astype(missing, bones.dtype)
    absent = xp.mean(xp.reshape(absent, (n, t, step, len(PARTS))), axis=2)
    # A hand is there if it was seen in any of a token's frames, the body in most of them.
    most = like(bones, np.array([0.5] * (len(PARTS) - 2) + [0.99] * 2, np.float32))
    gone = xp.astype(absent > most, bones.dtype)
    hands = xp.reshape(hands, (n, t, step, 2, 20, 3))
    frames = xp.reshape(1 - xp.astype(missing[:, :, -2:], bones.dtype), (n, t, step, 2, 1, 1))
    there = 1 - gone[:, :, -2:][..., None, None]  # (N, T, 2, 1, 1)
    hands = xp.sum(hands * frames, axis=2) / (xp.sum(frames, axis=2) + 1 - there)
    mean = xp.sum(hands * there, axis=1, keepdims=True)
    mean = mean / (xp.sum(there, axis=1, keepdims=True) + 1e-6)
    hand_velocity = _velocity(hands)
    inner = there[:, 2:] * there[:, :-2]
    edge = xp.zeros_like(there[:, :1])
    hand_velocity = hand_velocity * xp.concat([edge, inner, edge], axis=1)
    hands = _flat(hands, 1.5 * (hands - mean) * there, 3 * hand_velocity)
    return body, hands, xp.permute_dims(gone, (0, 2, 1))


def _flat(*parts: Array) -> Array:
    """Numbers side by side: (..., K, 3) each to (..., ΣK·3)."""
    xp = namespace(parts[0])
    flat = [xp.reshape(part, (*part.shape[:-2], 3 * part.shape[-2])) for part in parts]
    return xp.concat(flat, axis=-1)


def _deviation(x: Array) -> Array:
    """From the mean over time, axis 1."""
    return x - namespace(x).mean(x, axis=1, keepdims=True)


def _velocity(x: Array) -> Array:
    """Central differences over time, axis 1; zero at both ends."""
    xp = namespace(x)
    edge = xp.zeros_like(x[:, :1])
    return xp.concat([edge, (x[:, 2:] - x[:, :-2]) / 2, edge], axis=1)
