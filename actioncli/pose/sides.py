"""Undo frames in which the network took left for right.

Seen from behind or from far away, BlazePose now and then exchanges left and right for a few
frames, the arms, the legs or both. A limb cannot jump to the other side and back, so the
exchange that makes the body's path shortest is taken.
"""

from __future__ import annotations

from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from actioncli.clips.clip import FloatArray
from actioncli.clips.skeleton import LAYOUTS, mirrored_columns

JOINT_NAMES = LAYOUTS["blazepose_33"]
# The same with both hands.
ALL_NAMES = LAYOUTS["holistic_75"]

# Column of each landmark's twin on the other side; the nose is its own.
TWINS = np.array(mirrored_columns(ALL_NAMES))


def _columns(*joints: str) -> list[int]:
    return [JOINT_NAMES.index(side + joint) for joint in joints for side in "lr"]


ARMS = _columns("sho", "elb", "wri")
_LEGS = _columns("hip", "kne", "ank")
LIMBS = ARMS + _LEGS
_FIRST_OF_LEGS = JOINT_NAMES.index("lhip")
_LAST_OF_BODY = len(JOINT_NAMES)
# (joints that go together, joints whose path is measured); hands hang on the arms.
_HALVES = (
    (np.r_[0:_FIRST_OF_LEGS, _LAST_OF_BODY : len(ALL_NAMES)], ARMS),
    (np.arange(_FIRST_OF_LEGS, _LAST_OF_BODY), _LEGS),
)
# Metres of path that an exchanged frame must save: what the network says holds unless it leaps.
_COST_OF_EXCHANGE = 0.01


def settle_sides(
    world: FloatArray, visibility: FloatArray
) -> tuple[FloatArray, FloatArray, NDArray[np.bool_]]:
    """Exchange left and right where the network mixed them up.

    Args:
        world: (T, J, 3) metres, consecutive frames; J is 33, or 75 with hands.
        visibility: (T, J).

    Returns:
        Both of them in order, and (T,) which frames were changed.
    """
    world, visibility = world.copy(), visibility.copy()
    changed = np.zeros(len(world), np.bool_)
    for half, limbs in _HALVES:
        joints = half[half < world.shape[1]]
        exchange = _shortest_path(world[:, limbs], world[:, TWINS[limbs]])
        frames = np.flatnonzero(exchange)
        twins = TWINS[joints]
        world[np.ix_(frames, joints)] = world[np.ix_(frames, twins)]
        visibility[np.ix_(frames, joints)] = visibility[np.ix_(frames, twins)]
        changed |= exchange
    return world, visibility, changed


def _shortest_path(straight: FloatArray, crossed: FloatArray) -> NDArray[np.bool_]:
    """(T,) which frames to exchange, by dynamic programming over both choices of each frame."""
    choices = np.stack([straight, crossed], axis=1)  # (T, 2, joints, 3)
    price = np.array([0.0, _COST_OF_EXCHANGE])
    cost, came_from = price, []
    for before, now in pairwise(choices):
        steps = np.linalg.norm(before[:, np.newaxis] - now, axis=-1).mean(axis=-1)  # (from, to)
        total = cost[:, np.newaxis] + steps
        came_from.append(total.argmin(axis=0))
        cost = total.min(axis=0) + price
    path = [int(cost.argmin())]
    for origin in reversed(came_from):
        path.append(int(origin[path[-1]]))
    return np.array(path[::-1], np.bool_)
