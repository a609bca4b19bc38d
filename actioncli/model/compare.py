"""From prepared frames to embeddings, and from embeddings to the score of query and action.

Numpy only: the composition of the parts in `trx_os`, `features` and `warping` at inference.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from actioncli.clips.clip import FloatArray
from actioncli.model import trx_os
from actioncli.model.arrays import Params
from actioncli.model.config import ModelConfig
from actioncli.model.features import mirror, token_features, warp_features
from actioncli.model.warping import warping_cost

# Support pairs that are compared in one piece: enough for full matrix speed, few enough that
# scores stay in the processor's cache.
_BLOCK_PAIRS = 1920

# Distances below this are one and the same clip; keeps logarithms finite.
_SAME = 1e-3


def closing_shapes(config: ModelConfig, cohort: int) -> dict[str, tuple[int, ...]]:
    """Name and shape of the tensors that are computed when training is over.

    `score.weight` and `score.bias` belong to (-log T, -log of the warping cost, log of the
    radii, the discriminator's logit), see `scores`.
    """
    shapes: dict[str, tuple[int, ...]] = {}
    if config.warp_width:
        shapes |= {"warp.components": (42, config.warp_width)}
        shapes |= {"score.weight": (4,), "score.bias": (1,)}
    if config.neighbours:
        shapes |= {"cohort": (cohort, config.tokens, config.embedding_width)}
    return shapes


def embed(params: Params, config: ModelConfig, frames: FloatArray) -> FloatArray:
    """All that comparison needs of clips.

    Args:
        frames: (N, frames, J, 3) prepared frames.

    Returns:
        (N, F, E): the view of the clip (projected tokens, warp features), with `mirrored` the
        view of its mirror image, and with a cohort the clip's radius in every row.
    """
    views = [_view(params, config, frames)]
    if config.mirrored:
        views.append(_view(params, config, mirror(config, frames)))
    if config.neighbours:
        views.append(_radius(params, config, views))
    return np.concatenate(views, axis=2)


def _view(params: Params, config: ModelConfig, frames: FloatArray) -> FloatArray:
    features = trx_os.psi(params, config, token_features(config, frames))
    features = trx_os.with_positions(params, config, features)
    view: FloatArray = trx_os.project(params, config, features)
    if config.warp_width:
        warp = warp_features(config, params["warp.components"], frames)
        view = np.concatenate([view, warp], axis=2)
    return view


def _radius(params: Params, config: ModelConfig, views: Sequence[FloatArray]) -> FloatArray:
    """Mean warping cost to the nearest motions of the cohort, (N, F, 1): how much room is around
    a clip. Ordinary motions have near neighbours, so that near a query says less for them."""
    at = np.s_[..., 4 * config.key_width : config.view_width]
    cohort = params["cohort"][at]
    cost = warping_cost(views[0][at], cohort)
    if config.mirrored:
        np.minimum(cost, config.mirrored * warping_cost(views[1][at], cohort), out=cost)
    nearest = np.sort(cost, axis=1)[:, : config.neighbours].mean(axis=1)
    radius = np.maximum(nearest, _SAME).astype(np.float32)
    return np.broadcast_to(radius[:, None, None], (*views[0].shape[:2], 1))


def scores(
    params: Params, config: ModelConfig, queries: FloatArray, actions: Sequence[FloatArray]
) -> tuple[FloatArray, FloatArray]:
    """Distance and logit of every query and action.

    The paper's model: T, and the logit of the discriminator. With a warping cost D the logit is
    w·(-log T, -log D, log √(r_q·r_s), Disc) + b with the radii r of query and support, and the
    distance is exp(-logit), the odds against their being the same action; so the nearest action
    is the most confident one.

    Args:
        queries: (Q, F, E) embeddings.
        actions: K times (n, F, E), the examples of each.

    Returns:
        distance (Q, K) and logit (Q, K); the confidence is the logit's sigmoid.
    """
    parts = score_parts(params, config, queries, actions)
    if not config.warp_width:
        return parts[..., 0], parts[..., 3]
    logit = np.asarray(weighted(config, parts) @ params["score.weight"] + params["score.bias"])
    return np.exp(np.minimum(-logit, 60)), logit


def weighted(config: ModelConfig, parts: FloatArray) -> FloatArray:
    """What the score's weights multiply, from what `score_parts` measures: (..., 4) → (..., 4)."""
    terms = np.log(np.maximum(parts, _SAME))
    terms[..., :2] *= -1
    terms[..., 3] = parts[..., 3]
    return terms


def score_parts(
    params: Params, config: ModelConfig, queries: FloatArray, actions: Sequence[FloatArray]
) -> FloatArray:
    """T, warping cost, geometric mean of the radii and logit of Disc, (Q, K, 4).

    A query is seen mirrored for an action that its mirror image warps to at less than 1/`mirrored`
    of the cost; T and the cost are then multiplied by `mirrored`. Of several examples, T attends
    to all together; the cost and the support's attention to the query are those of the best one.
    """
    parts = np.ones((len(queries), len(actions), 4), np.float32)
    views = np.zeros((len(queries), len(actions)), np.intp)
    if config.warp_width:
        views = _warp(config, queries, actions, parts)
    width = config.view_width
    asked = [
        trx_os.pairs(params, config, queries[..., view * width :])
        for view in range(2 if config.mirrored else 1)
    ]
    for block in _blocks(config, actions):
        stacked = np.stack([actions[action] for action in block])
        k, n = stacked.shape[:2]
        projected = stacked.reshape(k * n, *stacked.shape[2:])
        keys, values = (
            of_pairs.reshape(k, n * config.pairs, -1)
            for of_pairs in trx_os.pairs(params, config, projected)
        )
        for q in range(len(queries)):
            for view, (query_keys, query_values) in enumerate(asked):
                seen = np.flatnonzero(views[q, block] == view)
                if not len(seen):
                    continue
                # Most often all actions of a block are seen alike: no copy then.
                part = slice(None) if len(seen) == k else seen
                t, logit = _attended(
                    params, config, query_keys[q], query_values[q], keys[part], values[part]
                )
                columns = np.asarray(block)[seen]
                parts[q, columns, 0] = t * (config.mirrored if view else 1)
                parts[q, columns, 3] = logit
    return parts


def _attended(
    params: Params,
    config: ModelConfig,
    query_keys: FloatArray,
    query_values: FloatArray,
    keys: FloatArray,
    values: FloatArray,
) -> tuple[FloatArray, FloatArray]:
    """T and logit (K,) of one query (P, W) against K actions (K, n·P, W)."""
    bias = trx_os.place_bias(params, config, keys)
    if config.near_pairs:
        bias = np.tile(bias, keys.shape[1] // config.pairs)
    weights = trx_os.attention(query_keys, keys, bias)
    difference = query_values - trx_os.prototypes(weights, values)
    t = trx_os.distance(config, difference)
    logit = trx_os.discriminator(params, difference)
    if config.both_ways:
        back = values - trx_os.prototypes(np.swapaxes(weights, -1, -2), query_values)
        back = back.reshape(len(back), -1, config.pairs, config.key_width)
        each = trx_os.distance(config, back)
        best = each.argmin(axis=1)
        at = np.arange(len(back))
        t = (t + each[at, best]) / 2
        logit = (logit + trx_os.discriminator(params, back[at, best])) / 2
    return t, logit


def _warp(
    config: ModelConfig,
    queries: FloatArray,
    actions: Sequence[FloatArray],
    parts: FloatArray,
) -> NDArray[np.intp]:
    """Fill in cost and radii of `parts`; tell which view of the query each action is given."""
    examples = np.concatenate(list(actions))
    starts = np.cumsum([0, *(len(action) for action in actions[:-1])])
    first = 4 * config.key_width
    cost = np.stack(
        [
            factor
            * warping_cost(
                queries[..., at : at + config.warp_width],
                examples[..., first : first + config.warp_width],
            )
            for factor, at in ((1.0, first), (config.mirrored, first + config.view_width))
            if factor
        ]
    )
    view = cost.argmin(axis=0)
    cost = cost.min(axis=0)
    # The best example of each action, in the orientation that suits it.
    parts[..., 1] = np.minimum.reduceat(cost, starts, axis=1)
    best = np.stack(
        [start + cost[:, start : start + len(action)].argmin(axis=1)
         for start, action in zip(starts, actions, strict=True)],
        axis=1,
    )  # fmt: skip
    if config.neighbours:
        radius = examples[:, 0, -1]
        parts[..., 2] = np.sqrt(queries[:, 0, -1][:, None] * radius[best])
    return np.take_along_axis(view, best, axis=1)


def _blocks(config: ModelConfig, actions: Sequence[FloatArray]) -> Iterator[list[int]]:
    """Indices of actions with equally many examples, a block at a time."""
    by_count: dict[int, list[int]] = {}
    for action, embedding in enumerate(actions):
        by_count.setdefault(len(embedding), []).append(action)
    for count, members in by_count.items():
        size = max(1, _BLOCK_PAIRS // (count * config.pairs))
        for start in range(0, len(members), size):
            yield members[start : start + size]


def sigmoid(x: NDArray[Any]) -> FloatArray:
    """1 / (1 + exp(-x)); tanh cannot overflow, exp can."""
    return np.asarray(0.5 + 0.5 * np.tanh(0.5 * x), np.float32)


def softmax(x: NDArray[Any]) -> FloatArray:
    """Along the last axis."""
    weights = np.exp(x - x.max(axis=-1, keepdims=True))
    return np.asarray(weights / weights.sum(axis=-1, keepdims=True), np.float32)
