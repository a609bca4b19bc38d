"""Why a clip is as far from an action as it is: which joints, which moments, which frame pairs.

*Attribution.* The nearest enrolled example of the action, played at the query's pace (aligned by
dynamic time warping), is turned into the query part by part. With v(S) the distance to the action
of a motion in which the parts S move as in the query and all others as in the example, part i is
given the mean over orders of v(S and i) - v(S), S being the parts before it: Shapley's value
(L. Shapley: A value for n-person games, 1953), estimated over a few orders and their reverses as
in Castro, Gómez, Tejada (2009). In every order the differences add up to v(all) - v(none), so

    distance = base + Σ parts,        base = v(none), the distance of the example itself,

holds exactly however few the orders are. Parts are the bones (named after the joint at their far
end) in one account, and the moments of the clip in another: two ways to cut the same distance.
A negative part brings the query nearer to the action than the example is.

*Attention.* Of each pair of the query's moments, how much it attends to which pair of the
example's, and how much of T, the mean difference of pairs from their prototypes, is its own.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from actioncli.clips.clip import Clip, FloatArray
from actioncli.clips.prepare import prepare
from actioncli.clips.skeleton import BONES, DEFAULT_JOINTS
from actioncli.model import compare, trx_os
from actioncli.model.config import ModelConfig
from actioncli.model.embedding import embed, in_view, query_view, token_columns
from actioncli.model.features import mirror
from actioncli.recognition.recognizer import Recognizer

# Orders in which parts are exchanged; each is also taken backwards.
_ORDERS = 2


@dataclass(frozen=True, slots=True, eq=False)
class Attended:
    """A pair of the query's moments, and the pair of the example's that it attends to most.

    Attributes:
        query: the two moments of the query.
        example: those of the example.
        weight: share of its attention to the whole action that goes there.
        share: of T that this pair of the query contributes, in [0, 1].
    """

    query: tuple[int, int]
    example: tuple[int, int]
    weight: float
    share: float


@dataclass(frozen=True, slots=True, eq=False)
class Explanation:
    """The distance between a query and an action, taken apart.

    Attributes:
        distance: as `Recognizer.compare` gives it.
        base: distance of the example itself, at the query's pace.
        joints: from joint to its part of the distance; with `base` they add up to it.
        moments: (M,) the same for equal stretches of the prepared clip.
        example: which of the action's examples the query is nearest to.
        mirrored: whether the query is compared with left and right exchanged.
        attention: (M, M) share of attention from the query's moments to the example's; rows add
            up to at most 1, the rest goes to other examples.
        pairs: the pairs of moments that differ most, first the largest share of T.
    """

    distance: float
    base: float
    joints: dict[str, float]
    moments: NDArray[np.float64]
    example: int
    mirrored: bool
    attention: NDArray[np.float64]
    pairs: tuple[Attended, ...]


def explain(
    recognizer: Recognizer, query: Clip, examples: Sequence[Clip], pairs: int = 3
) -> Explanation:
    """Take the distance between a query and an action apart.

    Args:
        recognizer: whose distance.
        query: the clip.
        examples: all enrolled clips of the action.
        pairs: how many pairs of moments are wanted.

    Raises:
        ClipError: a clip lacks joints that the model reads.
    """
    config = recognizer.weights.trx_os
    frames = prepare(query, config.preparation)
    enrolled = np.stack([prepare(clip, config.preparation) for clip in examples])
    asked, support = (recognizer.embed(clips) for clips in ([query], examples))
    distance = float(recognizer.compare(asked, {"": support}).distance[0, 0])
    example, mirrored = _nearest(recognizer, asked, support)
    reference = enrolled[example]
    if mirrored:
        reference = mirror(config, reference[None])[0]
    reference = reference[_pace(frames, reference)]

    def distances(made: Sequence[FloatArray]) -> NDArray[np.float64]:
        embedded = embed(recognizer.weights.tensors, config, np.stack(made), queries=True)
        return recognizer.compare(embedded, {"": support}).distance[:, 0].astype(np.float64)

    def shares(
        parts: int, exchange: Callable[[NDArray[np.bool_]], FloatArray]
    ) -> NDArray[np.float64]:
        """Shapley values of parts, from what `exchange` makes where some are the query's."""
        rng = np.random.default_rng(0)
        orders = [rng.permutation(parts) for _ in range(_ORDERS)]
        orders += [order[::-1] for order in orders]
        # In each order, all steps between none and all.
        made = [exchange(np.argsort(order) < on) for order in orders for on in range(1, parts)]
        between = distances(made).reshape(len(orders), parts - 1)
        added = np.zeros(parts)
        for order, found in zip(orders, between, strict=True):
            added[order] += np.diff([base, *found, distance])
        return added / len(orders)

    def with_moments(on: NDArray[np.bool_]) -> FloatArray:
        return np.where(np.repeat(on, len(frames) // len(on))[:, None, None], frames, reference)

    (base,) = distances([reference])
    parts = _parts(config)
    of_joints = shares(len(parts), lambda on: _with_joints(config, frames, reference, on))
    weights, of_pair = _attention(recognizer, asked, support, mirrored)
    weights = weights[:, example]
    first, second = (np.array(each) for each in trx_os.pair_indices(config.tokens))
    attention = np.zeros((config.tokens, config.tokens))
    for ends in (first, second):
        np.add.at(attention, (ends[:, None], ends[None, :]), weights)
    largest = np.argsort(-of_pair, kind="stable")[:pairs]
    best = weights.argmax(axis=1)
    return Explanation(
        distance=distance,
        base=float(base),
        joints=dict(zip(parts, of_joints.tolist(), strict=True)),
        moments=shares(config.tokens, with_moments),
        example=example,
        mirrored=mirrored,
        # Every moment is an end of M - 1 pairs.
        attention=attention / (config.tokens - 1),
        pairs=tuple(
            Attended(
                query=(int(first[pair]), int(second[pair])),
                example=(int(first[best[pair]]), int(second[best[pair]])),
                weight=float(weights[pair, best[pair]]),
                share=float(of_pair[pair]),
            )
            for pair in largest
        ),
    )


def _nearest(recognizer: Recognizer, asked: FloatArray, support: FloatArray) -> tuple[int, bool]:
    """The example that the query is nearest to, and whether it is so mirrored."""
    config = recognizer.weights.trx_os
    if not config.warp_width:
        each = {str(n): support[n : n + 1] for n in range(len(support))}
        return int(recognizer.compare(asked, each).distance.argmin()), False
    warped = compare.warp(recognizer.weights.tensors, config, asked, list(support[:, None]))
    example = int(warped.cost[0].argmin())
    return example, bool(warped.mirrored[0, example])


def _pace(query: FloatArray, example: FloatArray) -> NDArray[np.intp]:
    """For each frame of the query the frame of the example that warping aligns with it."""
    cost = np.sqrt(((query[:, None] - example) ** 2).sum(axis=(2, 3)))
    total = np.full((len(query) + 1, len(example) + 1), np.inf)
    total[0, 0] = 0
    for i, j in np.ndindex(cost.shape):
        total[i + 1, j + 1] = cost[i, j] + min(total[i, j], total[i, j + 1], total[i + 1, j])
    aligned: list[list[int]] = [[] for _ in query]
    i, j = len(query), len(example)
    while i and j:
        aligned[i - 1].append(j - 1)
        back = ((i - 1, j - 1), (i - 1, j), (i, j - 1))
        i, j = min(back, key=lambda at: total[at])
    return np.array([round(float(np.mean(each))) for each in aligned])


def _parts(config: ModelConfig) -> tuple[str, ...]:
    """Joints that can be exchanged: far ends of bones, or all but the pelvis of other layouts."""
    names = config.preparation.joints
    if set(names) == set(DEFAULT_JOINTS):
        return tuple(joint for joint, _, _ in BONES)
    return tuple(name for name in names if name != "pelv")


def _with_joints(
    config: ModelConfig, query: FloatArray, reference: FloatArray, on: NDArray[np.bool_]
) -> FloatArray:
    """The example with some parts from the query, (F, J, 3)."""
    names = config.preparation.joints
    made = reference.copy()
    if set(names) != set(DEFAULT_JOINTS):
        columns = [names.index(part) for part in np.array(_parts(config))[on]]
        made[:, columns] = query[:, columns]
        return made
    # Bones, not positions: no bone is stretched, and an arm follows the shoulder it hangs on.
    for (child, parent, _), chosen in zip(BONES, on, strict=True):
        source = query if chosen else reference
        at, above = names.index(child), names.index(parent)
        made[:, at] = made[:, above] + (source[:, at] - source[:, above])
    return made


def _attention(
    recognizer: Recognizer, asked: FloatArray, support: FloatArray, mirrored: bool
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Attention from the query's pairs to those of each example (P, n, P), and each pair's share
    of T (P,)."""
    params, config = recognizer.weights.tensors, recognizer.weights.trx_os
    view, columns = query_view(params, config, asked), token_columns(config)
    seen = in_view(asked, columns, view)
    query_keys, query_values = (each[0] for each in trx_os.pairs(params, config, seen))
    beside = support[..., columns[view[0] ^ mirrored]]
    keys, values = (
        each.reshape(-1, config.key_width) for each in trx_os.pairs(params, config, beside)
    )
    weights = trx_os.attention(query_keys, keys)
    difference = query_values - trx_os.prototypes(weights, values)
    of_pair = np.array([float(trx_os.distance(config, each[None])) for each in difference])
    weights = (weights / weights.sum(axis=1, keepdims=True)).astype(np.float64)
    return weights.reshape(config.pairs, len(support), config.pairs), of_pair / of_pair.sum()
