"""Limbs that a sensor takes for each other: the left arm jumps to where the right one was."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from actioncli.clips.clip import FloatArray
from actioncli.clips.skeleton import DEFAULT_JOINTS, LIMBS, centred, torso_length

# Two limbs changed places between two frames if their way is this much shorter so, and would be
# longer than this many torso lengths (of all their joints together) if they had not. Of 2,443 clips
# of sixteen collections, a fifth of each, two have such frames, both by a Kinect.
_SHORTER, _LEAST = 0.35, 0.5
_COLUMNS = [[DEFAULT_JOINTS.index(name) for name in limb] for limb in LIMBS.values()]


def limb_swaps(body: FloatArray) -> NDArray[np.intp]:
    """Which joint each joint of a body really is, (T, J) columns of `DEFAULT_JOINTS`.

    Both joints of a pair of elbows or knees go to the other side at once, with what lies beyond
    them, and with shoulders or hips or without. What is so in less than half of the frames is
    taken for the mistake.

    Args:
        body: (T, J, 3) the default joints.
    """
    columns = np.tile(np.arange(len(DEFAULT_JOINTS)), (len(body), 1))
    joints = centred(body, DEFAULT_JOINTS)
    ways = _ways(joints, joints)
    least = _LEAST * torso_length(joints, DEFAULT_JOINTS)
    for left, right in (_COLUMNS[:2], _COLUMNS[2:]):
        stay = ways[:, left] + ways[:, right]
        far = stay.sum(axis=1) > least
        if not far.any():
            continue
        sides = joints[:, left], joints[:, right]
        cross = _ways(*sides) + _ways(*sides[::-1])
        whole, outer = cross.sum(axis=1), stay[:, 0] + cross[:, 1:].sum(axis=1)
        turns = far & (np.minimum(whole, outer) < _SHORTER * stay.sum(axis=1))
        for turn, first in ((turns & (whole <= outer), 0), (turns & (whole > outer), 1)):
            swapped = np.concatenate([[0], np.cumsum(turn) % 2]) > 0
            if swapped.mean() > 0.5:
                swapped = ~swapped
            rows = np.flatnonzero(swapped)[:, None]
            one, other = left[first:], right[first:]
            columns[rows, one + other] = columns[rows, other + one]
    return columns


def _ways(before: FloatArray, now: FloatArray) -> FloatArray:
    """How far joints (T, J, 3) go from each frame to the next of others, (T - 1, J)."""
    way = now[1:] - before[:-1]
    return np.asarray(np.sqrt(np.vecdot(way, way)))
