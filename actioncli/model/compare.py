"""From embeddings to the score of query and action, numpy only."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from actioncli.clips.clip import FloatArray
from actioncli.model import trx_os
from actioncli.model.arrays import Params
from actioncli.model.config import ModelConfig
from actioncli.model.embedding import SAME, in_view, query_view, token_columns, warp_columns
from actioncli.model.warping import warping_cost

# Support pairs that are compared in one piece: enough for full matrix speed, few enough that
# scores stay in the processor's cache.
_BLOCK_PAIRS = 1920

# Queries whose pairs are kept at a time.
_BLOCK_QUERIES = 64

# Examples up to which every action is compared in full, and how many are at least beyond; and how
# many are at most, where more of them may be nearest. By how much T and Disc may add more to such
# an action than to any that was compared first. Measured on recordings (docs/benchmarks.md).
EXACT, _AT_MOST = 256, 512
_SLACK = 0.6
# Actions that are compared in full, however many examples each of them has.
_FEWEST = 8


def scores(
    params: Params, config: ModelConfig, queries: FloatArray, actions: Sequence[FloatArray]
) -> tuple[FloatArray, FloatArray]:
    """Distance and logit of every query and action.

    The paper's model: T, and the logit of the discriminator. With a warping cost D the logit is
    w·(-log T, -log D, log √(r_q·r_s), Disc) + b with the radii r of query and support, and the
    distance is exp(-logit), the odds against their being the same action; so the nearest action
    is the most confident one.

    D and the radii cost a fiftieth of T and Disc. So of more than `EXACT` examples only the
    actions with the largest approximate logit, without T and Disc, are compared in full, and then
    of as many again those that would be nearest if T and Disc added to it `_SLACK` more
    than to any so far. What is still left gets the least that they added: never nearer
    than what was compared in full.

    Args:
        queries: (Q, F, E) embeddings.
        actions: K times (n, F, E), the examples of each.

    Returns:
        distance (Q, K) and logit (Q, K); the confidence is the logit's sigmoid.
    """
    if not config.warp_width:
        parts = score_parts(params, config, queries, actions)
        return parts[..., 0], parts[..., 3]
    warped = warp(params, config, queries, actions)
    counts = np.array([len(action) for action in actions])
    chosen = None
    if counts.sum() > EXACT:
        cheap = approximate_logit(params, warped)
        chosen = _largest(cheap, counts, EXACT)
    parts = _parts(params, config, queries, actions, warped, chosen)
    logit = _logit(params, parts)
    if chosen is not None:
        best = np.where(chosen, logit, -np.inf).max(axis=1, keepdims=True)
        most = np.where(chosen, logit - cheap, -np.inf).max(axis=1, keepdims=True)
        rivals = ~chosen & (cheap + most + _SLACK >= best) & _largest(cheap, counts, _AT_MOST)
        if rivals.any():
            parts = _parts(params, config, queries, actions, warped, rivals)
            logit = np.where(rivals, _logit(params, parts), logit)
            chosen |= rivals
        least = np.where(chosen, logit - cheap, np.inf).min(axis=1, keepdims=True)
        logit = np.where(chosen, logit, cheap + least)
    return np.exp(np.minimum(-logit, 60)), logit


def approximate_logit(params: Params, warped: Warped) -> FloatArray:
    """The logit without what T and Disc add, (Q, K): what can be had cheaply."""
    return _logit(params, _unattended(warped))


def _logit(params: Params, parts: FloatArray) -> FloatArray:
    """(..., 4) from `score_parts` → (...)."""
    return np.asarray(weighted(parts) @ params["score.weight"] + params["score.bias"])


def _largest(cheap: FloatArray, counts: NDArray[np.intp], examples: int) -> NDArray[np.bool_]:
    """Which actions to compare in full, (Q, K): the largest of `cheap` (Q, K), so many examples
    and at least `_FEWEST` actions of them for each query; it does not depend on their order."""
    order = np.argsort(-cheap, axis=1)
    before = np.cumsum(counts[order], axis=1) - counts[order]
    last = np.maximum((before < examples).sum(axis=1), min(_FEWEST, len(counts))) - 1
    least = np.take_along_axis(cheap, order, axis=1)[np.arange(len(cheap)), last]
    return np.asarray(cheap >= least[:, None])


def weighted(parts: FloatArray) -> FloatArray:
    """What the score's weights multiply, from what `score_parts` measures: (..., 4) → (..., 4)."""
    terms = np.log(np.maximum(parts, SAME))
    terms[..., :2] *= -1
    terms[..., 3] = parts[..., 3]
    return terms


def score_parts(
    params: Params, config: ModelConfig, queries: FloatArray, actions: Sequence[FloatArray]
) -> FloatArray:
    """T, warping cost, geometric mean of the radii and logit of Disc, (Q, K, 4).

    An action is seen mirrored if its mirror image warps to the query at less than 1/`mirrored` of
    the cost; T and the cost are then multiplied by `mirrored`. Of several examples, T attends to
    all together; the cost and the support's attention to the query are those of the best one.
    """
    return _parts(params, config, queries, actions, warp(params, config, queries, actions), None)


def _parts(
    params: Params,
    config: ModelConfig,
    queries: FloatArray,
    actions: Sequence[FloatArray],
    warped: Warped,
    chosen: NDArray[np.bool_] | None,
) -> FloatArray:
    """`score_parts`, T and Disc only where `chosen` (Q, K) says so."""
    parts = _unattended(warped)
    for start in range(0, len(queries), _BLOCK_QUERIES):
        rows = slice(start, start + _BLOCK_QUERIES)
        view = warped.view[rows]
        asked = in_view(queries[rows], token_columns(config), view)
        query_keys, query_values = trx_os.pairs(params, config, asked)
        for side, columns in enumerate(token_columns(config)):
            # (queries here, K): whose action is needed, and needed as seen from this side.
            wanted = (view[:, None] ^ warped.mirrored[rows]) == side
            if chosen is not None:
                wanted &= chosen[rows]
            for block in _blocks(config, actions, np.flatnonzero(wanted.any(axis=0)).tolist()):
                stacked = np.stack([actions[action][..., columns] for action in block])
                k, n = stacked.shape[:2]
                projected = stacked.reshape(k * n, *stacked.shape[2:])
                keys, values = (
                    of_pairs.reshape(k, n * config.pairs, -1)
                    for of_pairs in trx_os.pairs(params, config, projected)
                )
                qs, ks = np.nonzero(wanted[:, block])
                which = np.asarray(block)[ks]
                size = max(1, _BLOCK_PAIRS // (n * config.pairs))
                reduced = []
                # A single query meets the block as it is; nothing is copied then.
                whole = np.array_equal(ks, np.arange(k))
                for at in range(0, len(qs), size):
                    one = slice(at, at + size)
                    t, features = _attended(
                        params,
                        config,
                        query_keys[qs[one]],
                        query_values[qs[one]],
                        keys[one] if whole else keys[ks[one]],
                        values[one] if whole else values[ks[one]],
                    )
                    parts[start + qs[one], which[one], 0] = t
                    reduced.append(features)
                # The largest layer of Disc is read once for the whole block.
                logits = trx_os.judge(params, np.concatenate(reduced))
                parts[start + qs, which, 3] = logits.mean(axis=1)
    if config.mirrored:
        parts[..., 0] *= np.where(warped.mirrored, np.float32(config.mirrored), 1)
    return parts


def _attended(
    params: Params,
    config: ModelConfig,
    query_keys: FloatArray,
    query_values: FloatArray,
    keys: FloatArray,
    values: FloatArray,
) -> tuple[FloatArray, FloatArray]:
    """T (B,), and what Disc makes of pairs (B, ways, P, 16), of B queries (B, P, W), each against
    one action (B, n·P, W)."""
    weights = trx_os.attention(query_keys, keys)
    difference = query_values - trx_os.prototypes(weights, values)
    t = trx_os.distance(config, difference)
    ways = [difference]
    if config.both_ways:
        back = values - trx_os.prototypes(np.swapaxes(weights, -1, -2), query_values)
        back = back.reshape(len(back), -1, config.pairs, config.key_width)
        each = trx_os.distance(config, back)
        best = each.argmin(axis=1)
        at = np.arange(len(back))
        t = (t + each[at, best]) / 2
        ways.append(back[at, best])
    return t, trx_os.tuple_features(params, np.stack(ways, axis=1))


class Warped(NamedTuple):
    """What the best example of each action gives, (Q, K) each: the warping cost, the geometric
    mean of the radii, and whether its mirror image suits the query better; and in which view (Q,)
    the queries were asked, see `query_view`."""

    cost: FloatArray
    radius: FloatArray
    mirrored: NDArray[np.bool_]
    view: NDArray[np.intp]


def warp(
    params: Params, config: ModelConfig, queries: FloatArray, actions: Sequence[FloatArray]
) -> Warped:
    """Warp queries (Q, F, E) to all examples of K actions and to their mirror images."""
    shape = len(queries), len(actions)
    view = query_view(params, config, queries)
    if not config.warp_width:
        ones = np.ones(shape, np.float32)
        return Warped(ones, ones, np.zeros(shape, np.bool_), view)
    # Only these columns of all examples are ever side by side.
    seen = [
        np.concatenate([action[..., columns] for action in actions])
        for columns in warp_columns(config)
    ]
    asked = in_view(queries, warp_columns(config), view)
    # (views, Q, examples): first those as they are beside the query, then their mirror images.
    cost = np.stack([warping_cost(asked, examples) for examples in seen])
    cost = np.where(view[:, None] > 0, cost[::-1], cost)
    cost[1:] *= config.mirrored
    mirrored = cost.argmin(axis=0) > 0
    cost = cost.min(axis=0)
    counts = [len(action) for action in actions]
    starts = np.cumsum([0, *counts[:-1]])
    least = np.minimum.reduceat(cost, starts, axis=1)
    # The first example of each action that has the least cost.
    examples = np.arange(cost.shape[1])
    places = np.where(cost == np.repeat(least, counts, axis=1), examples, len(examples))
    best = np.minimum.reduceat(places, starts, axis=1)
    radius = np.ones(shape, np.float32)
    if config.neighbours:
        of_examples = np.concatenate([action[:, 0, -1] for action in actions])
        radius = np.sqrt(queries[:, 0, -1][:, None] * of_examples[best])
    return Warped(least, radius, np.take_along_axis(mirrored, best, axis=1), view)


def _unattended(warped: Warped) -> FloatArray:
    """(Q, K, 4) as `score_parts`, with what says nothing in the places of T, 1, and Disc, 0."""
    ones = np.ones_like(warped.cost)
    return np.stack([ones, warped.cost, warped.radius, 0 * ones], axis=-1)


def _blocks(
    config: ModelConfig, actions: Sequence[FloatArray], wanted: Sequence[int]
) -> Iterator[list[int]]:
    """Of the wanted indices of actions, those with equally many examples, a block at a time."""
    by_count: dict[int, list[int]] = {}
    for action in wanted:
        by_count.setdefault(len(actions[action]), []).append(action)
    for count, members in by_count.items():
        size = max(1, _BLOCK_PAIRS // (count * config.pairs))
        for start in range(0, len(members), size):
            yield members[start : start + size]


def sigmoid(x: NDArray[Any]) -> FloatArray:
    """1 / (1 + exp(-x)); tanh cannot overflow, exp can."""
    return np.asarray(0.5 + 0.5 * np.tanh(0.5 * x), np.float32)
