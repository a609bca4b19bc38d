"""Dynamic time warping between short sequences, many pairs at once. Numpy only: nothing learns
through it."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from actioncli.clips.clip import FloatArray

# Pairs warped in one piece: enough to make up for the calls, and their cost matrices stay in the
# processor's cache.
_BLOCK_PAIRS = 1024


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
    left = _left_factors(queries)
    for column in range(0, len(supports), wide):
        right = _right_factors(supports[column : column + wide])
        for row in range(0, len(queries), step):
            block = np.s_[row : row + step, column : column + wide]
            cost[block] = _warped(left[row : row + step], right)
    return cost


def _left_factors(frames: NDArray[Any]) -> FloatArray:
    """(Q, F, V + 2) rows (-2a, |a|², 1); see `_right_factors`."""
    left = np.ones((*frames.shape[:2], frames.shape[2] + 2), np.float32)
    left[..., :-2] = frames
    left[..., -2] = (left[..., :-2] ** 2).sum(axis=-1)
    left[..., :-2] *= -2
    return left


def _right_factors(frames: NDArray[Any]) -> FloatArray:
    """(V + 2, G, S) columns (b, 1, |b|²): their product with the rows is |a - b|²."""
    right = np.ones((frames.shape[2] + 2, frames.shape[1], frames.shape[0]), np.float32)
    right[:-2] = frames.transpose(2, 1, 0)
    right[-1] = (right[:-2] ** 2).sum(axis=0)
    return right


def _warped(left: FloatArray, right: FloatArray) -> FloatArray:
    """(Q, S) cost of the cheapest path through the matrix of frame distances of each pair.

    Cells of an anti-diagonal do not depend on one another, so each is one step for all pairs.
    """
    (q, f), (numbers, g, s) = left.shape[:2], right.shape
    # Row i of the matrix is shifted right by i, which makes a column of each anti-diagonal.
    slanted = np.empty((f + g - 1, f, q, s), np.float32)
    one_row, one_column, *pair = slanted.strides
    cells = np.lib.stride_tricks.as_strided(
        slanted, (f, g, q, s), (one_row + one_column, one_row, *pair)
    )
    for query in range(q):
        squared = (left[query] @ right.reshape(numbers, g * s)).reshape(f, g, s)
        # Rounding can leave the square of a zero distance a hair below zero.
        np.maximum(squared, 0, out=squared)
        np.sqrt(squared, out=cells[:, :, query])
    # Rows are counted from 1; row 0, and cells that were never filled, lie outside the matrix.
    before, last, now = np.full((3, f + 1, q, s), np.inf, np.float32)
    last[1] = slanted[0, 0]
    for diagonal in range(1, f + g - 1):
        low, high = max(0, diagonal - g + 1), min(diagonal, f - 1) + 1
        here = now[low + 1 : high + 1]
        np.minimum(last[low + 1 : high + 1], last[low:high], out=here)
        np.minimum(here, before[low:high], out=here)
        here += slanted[diagonal, low:high]
        before, last, now = last, now, before
    return np.asarray(last[f] * np.float32(2 / (f + g)), np.float32)
