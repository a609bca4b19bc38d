"""Dynamic time warping between short sequences, many pairs at once."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from actioncli.clips.clip import FloatArray

# Pairs warped in one piece: their cost matrices stay in the processor's cache.
_BLOCK_PAIRS = 512


def dtw_distance(queries: NDArray[Any], supports: NDArray[Any]) -> FloatArray:
    """Cost of the cheapest alignment of every query with every support, per frame.

    The alignment starts at the first frames, ends at the last ones and moves on by one frame in
    either sequence or in both: with c the distance between frames,
    D[i, j] = c[i, j] + min(D[i-1, j], D[i, j-1], D[i-1, j-1]); the result is D[-1, -1] / (F + G).
    The distance between two frames is the root mean square over joints of the distance in space.

    Args:
        queries: (Q, F, J, 3) prepared frames.
        supports: (S, G, J, 3) prepared frames.

    Returns:
        (Q, S) float32 in the unit of the joints.
    """
    distance = np.empty((len(queries), len(supports)), np.float32)
    step = max(1, _BLOCK_PAIRS // max(1, len(supports)))
    for start in range(0, len(queries), step):
        block = slice(start, start + step)
        distance[block] = _warped(_frame_distances(queries[block], supports))
    return distance


def _frame_distances(queries: NDArray[Any], supports: NDArray[Any]) -> FloatArray:
    """(F, G, Q, S) distance between frame f of query q and frame g of support s.

    From |a - b|² = |a|² + |b|² - 2ab, so that one matrix product serves all pairs.
    """
    (q, f, joints, _), (s, g) = queries.shape, supports.shape[:2]
    a = np.asarray(queries, np.float32).reshape(q * f, joints * 3)
    b = np.asarray(supports, np.float32).reshape(s * g, joints * 3)
    squared = (a * a).sum(1)[:, None] + (b * b).sum(1) - 2 * (a @ b.T)
    # rounding can leave the square of a zero distance a hair below zero
    distance: FloatArray = np.sqrt(np.maximum(squared, 0) / np.float32(joints))
    return distance.reshape(q, f, s, g).transpose(1, 3, 0, 2)


def _warped(cost: FloatArray) -> FloatArray:
    """(Q, S) cost of the cheapest path through each (F, G) matrix of `cost` (F, G, Q, S).

    Cells of an anti-diagonal do not depend on one another, so each is one step for all pairs.
    `before` and `last` are the two anti-diagonals done so far, indexed by the row f, with one
    row of infinity in front of the first.
    """
    f, g = cost.shape[:2]
    outside = np.full((f + 1, *cost.shape[2:]), np.inf, np.float32)
    before, last = outside, outside.copy()
    before[0] = 0  # the path enters at (-1, -1)
    for diagonal in range(f + g - 1):
        rows = np.arange(max(0, diagonal - g + 1), min(f, diagonal + 1))
        best = np.minimum(np.minimum(last[rows], last[rows + 1]), before[rows])
        now = np.full_like(outside, np.inf)
        now[rows + 1] = cost[rows, diagonal - rows] + best
        before, last = last, now
    return np.asarray(last[f] / (f + g), np.float32)
