"""Dynamic time warping between short sequences, many pairs at once. Numpy only: nothing learns
through it."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from actioncli.clips.clip import FloatArray

# Pairs warped in one piece: their cost matrices stay in the processor's cache.
_BLOCK_PAIRS = 512


def warping_cost(queries: NDArray[Any], supports: NDArray[Any]) -> FloatArray:
    """Cost of the cheapest alignment of every query with every support, per frame.

    The alignment starts at the first frames, ends at the last ones and moves on by one frame in
    either sequence or in both: with c the Euclidean distance between frames,
    C[i, j] = c[i, j] + min(C[i-1, j], C[i, j-1], C[i-1, j-1]); the result is 2·C[-1, -1] / (F + G).

    Args:
        queries: (Q, F, V).
        supports: (S, G, V).

    Returns:
        (Q, S) float32 in the unit of the frames.
    """
    cost = np.empty((len(queries), len(supports)), np.float32)
    wide = max(1, min(len(supports), _BLOCK_PAIRS))
    step = max(1, _BLOCK_PAIRS // wide)
    for row in range(0, len(queries), step):
        for column in range(0, len(supports), wide):
            block = np.s_[row : row + step], np.s_[column : column + wide]
            cost[block] = _warped(_frame_distances(queries[block[0]], supports[block[1]]))
    return cost


def _frame_distances(queries: NDArray[Any], supports: NDArray[Any]) -> FloatArray:
    """(F, G, Q, S) distance between frame f of query q and frame g of support s.

    From |a - b|² = |a|² + |b|² - 2ab, so that one matrix product serves all pairs.
    """
    (q, f, numbers), (s, g) = queries.shape, supports.shape[:2]
    a = np.asarray(queries, np.float32).reshape(q * f, numbers)
    b = np.asarray(supports, np.float32).reshape(s * g, numbers)
    squared = (a * a).sum(1)[:, None] + (b * b).sum(1) - 2 * (a @ b.T)
    # Rounding can leave the square of a zero distance a hair below zero.
    distance: FloatArray = np.sqrt(np.maximum(squared, 0))
    return distance.reshape(q, f, s, g).transpose(1, 3, 0, 2)


def _warped(cost: FloatArray) -> FloatArray:
    """(Q, S) cost of the cheapest path through each (F, G) matrix of `cost` (F, G, Q, S).

    Cells of an anti-diagonal do not depend on one another, so each is one step for all pairs.
    Row f is shifted right by f, which makes a column of each anti-diagonal; what lies outside
    the matrix costs infinity.
    """
    f, g = cost.shape[:2]
    slanted = np.full((f + g - 1, f, *cost.shape[2:]), np.inf, np.float32)
    for row in range(f):
        slanted[row : row + g, row] = cost[row]
    before = np.full(slanted.shape[1:], np.inf, np.float32)
    last = before.copy()
    last[0] = slanted[0, 0]
    for diagonal in slanted[1:]:
        now = last.copy()
        np.minimum(now[1:], last[:-1], out=now[1:])
        np.minimum(now[1:], before[:-1], out=now[1:])
        now += diagonal
        before, last = last, now
    return np.asarray(2 * last[f - 1] / (f + g), np.float32)
