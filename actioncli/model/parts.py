"""The part transformer: a cross-transformer that compares two clips body part by body part.

Every token of the query attends to the support's tokens of the same part; from what it finds
come query-specific prototypes, as in TRX-OS, and the differences of all parts to them are judged
to one logit. Both clips ask in turn, and the logit is the mean of both.

Everything here takes numpy arrays (inference) or torch tensors (training). Shapes: N clips, Q
queries, S supports, P = 7 parts, T tokens, D width, W key width, E features of evidence.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import lru_cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from actioncli.clips.parts import PARTS
from actioncli.model.arrays import Array, Params, like, linear, namespace, normed, relu, softmax
from actioncli.model.config import PartsConfig
from actioncli.model.parts_tokens import BODY, HAND

_KERNEL, _GROUPS = 5, 4
# How much a prototype's attention falls off with the distance in time, at first.
DECAY = 3.0


class Embedded(NamedTuple):
    """What comparison needs of N clips.

    Attributes:
        keys, values: (P, N, T, W).
        present: (P, N, T, 1), 1 where the part was seen, else 0.
    """

    keys: Array
    values: Array
    present: Array


def parameter_shapes(config: PartsConfig) -> dict[str, tuple[int, ...]]:
    """Name and shape of every tensor that training learns."""
    p, d, w, e = len(PARTS), config.width, config.key_width, config.evidence
    shapes: dict[str, tuple[int, ...]] = {
        "body.weight": (p - 2, BODY, d),
        "hand.weight": (HAND, d),
        "part.bias": (p, d),
        "part.missing": (p, d),
        "positions": (config.tokens, d),
    }
    for block in range(config.layers):
        name = f"block{block}"
        for norm in ("conv", "mix", "mlp"):
            shapes |= {f"{name}.{norm}.scale": (d,), f"{name}.{norm}.shift": (d,)}
        shapes |= {
            f"{name}.conv.weight": (_GROUPS, _KERNEL * d // _GROUPS, d // _GROUPS),
            f"{name}.conv.bias": (d,),
            f"{name}.reduce.weight": (d, d // 4),
            f"{name}.reduce.bias": (d // 4,),
            f"{name}.mix.weight": (p * (d // 4), d),
            f"{name}.mix.bias": (d,),
            f"{name}.up.weight": (d, 2 * d),
            f"{name}.up.bias": (2 * d,),
            f"{name}.down.weight": (2 * d, d),
            f"{name}.down.bias": (d,),
        }
    return shapes | {
        "norm.scale": (d,),
        "norm.shift": (d,),
        "key.weight": (d, w),
        "key.bias": (w,),
        "key.norm.scale": (w,),
        "key.norm.shift": (w,),
        "value.weight": (d, w),
        "value.bias": (w,),
        "attention.scale": (1,),
        "attention.decay": (1,),
        "evidence.apart.weight": (w, e),
        "evidence.query.weight": (w, e),
        "evidence.difference.weight": (w, e),
        "evidence.bias": (e,),
        "parts.weight": (p * e, 2 * e),
        "parts.bias": (2 * e,),
        "moment.weight": (2 * e, 1),
        "judge0.weight": (6 * e, 64),
        "judge0.bias": (64,),
        "judge1.weight": (64, 1),
        "judge1.bias": (1,),
    }


def fitted_shapes(config: PartsConfig) -> dict[str, tuple[int, ...]]:
    """Name and shape of what is fitted when training is over: the map from logit to confidence,
    sigmoid(scale · logit + shift), and the weights of the pooled vector, see `parts_compare`."""
    pool = len(PARTS), 4 * config.key_width
    return {"confidence.scale": (1,), "confidence.shift": (1,), "pool.weight": pool}


def embed(
    params: Params,
    config: PartsConfig,
    tokens: tuple[Array, Array, Array],
    drop: Callable[[Array], Array] = lambda x: x,
) -> Embedded:
    """Keys and values of every token of every part.

    Args:
        tokens: from `parts_tokens.tokens`.
        drop: dropout, in training.
    """
    body, hands, gone = tokens
    xp = namespace(body)
    # Parts first: (P, N, T, ...), a matrix for each part of the body and one for both hands.
    body = xp.permute_dims(body, (2, 0, 1, 3))
    p, n, t, d = len(PARTS), body.shape[1], config.tokens, config.width
    body = xp.reshape(body, (p - 2, n * t, BODY)) @ params["body.weight"]
    hands = xp.reshape(xp.permute_dims(hands, (2, 0, 1, 3)), (2, n * t, HAND))
    x = xp.concat([body, hands @ params["hand.weight"]], axis=0) + params["part.bias"][:, None]
    gone = xp.reshape(xp.permute_dims(gone, (1, 0, 2)), (p, n * t, 1))
    x = drop(x * (1 - gone) + params["part.missing"][:, None] * gone)
    x = xp.reshape(x, (p, n, t, d)) + params["positions"]
    for block in range(config.layers):
        name = f"block{block}"
        x = x + drop(_convolved(params, name, normed(params, f"{name}.conv", x)))
        reduced = linear(params, f"{name}.reduce", normed(params, f"{name}.mix", x))
        reduced = xp.reshape(xp.permute_dims(reduced, (1, 2, 0, 3)), (n, t, p * (d // 4)))
        x = x + drop(linear(params, f"{name}.mix", reduced))[None]
        inner = relu(linear(params, f"{name}.up", normed(params, f"{name}.mlp", x)))
        x = x + drop(linear(params, f"{name}.down", inner))
    x = normed(params, "norm", x)
    keys = normed(params, "key.norm", linear(params, "key", x))
    return Embedded(keys, linear(params, "value", x), xp.reshape(1 - gone, (p, n, t, 1)))


def logits(
    params: Params,
    config: PartsConfig,
    queries: Embedded,
    supports: Embedded,
    drop: Callable[[Array], Array] = lambda x: x,
) -> Array:
    """(Q, S): whether a query shows what a support shows."""
    xp = namespace(queries.keys)
    there = _one_way(params, config, _side_by_side(queries), supports, drop)  # (S, Q)
    back = _one_way(params, config, _side_by_side(supports), queries, drop)  # (Q, S)
    return (xp.permute_dims(there, (1, 0)) + back) / 2


def paired_logits(
    params: Params,
    config: PartsConfig,
    queries: Embedded,
    supports: Embedded,
    drop: Callable[[Array], Array] = lambda x: x,
) -> Array:
    """(N,): of N queries, each against the support in the same place."""
    there = _one_way(params, config, queries, supports, drop)
    return ((there + _one_way(params, config, supports, queries, drop)) / 2)[:, 0]


def attention(params: Params, config: PartsConfig, queries: Embedded, supports: Embedded) -> Array:
    """How much each token of queries attends to the tokens of the same part of supports.

    Args:
        queries: (P, 1, Q·T, W), all side by side for every support; or (P, S, T, W), one for
            each support.
        supports: (P, S, T, W).

    Returns:
        (P, S, Q·T, T), rows of sum 1.
    """
    xp = namespace(queries.keys)
    rows, t = queries.keys.shape[2] // config.tokens, config.tokens
    apart = like(queries.keys, _apart(t))
    near = xp.abs(params["attention.decay"]) * (apart if rows == 1 else xp.tile(apart, (rows, 1)))
    scaled = queries.keys * (params["attention.scale"] / config.key_width**0.5)
    scores = scaled @ xp.matrix_transpose(supports.keys) - near
    # A support without a part at all is attended to evenly, and its evidence is not counted.
    unseen = xp.matrix_transpose((1 - supports.present) * _ever(supports))
    return softmax(scores - 1e4 * unseen)


def _ever(clips: Embedded) -> Array:
    """(P, N, 1, 1), 1 where a clip shows a part at any time."""
    return namespace(clips.keys).max(clips.present, axis=2, keepdims=True)


def _one_way(
    params: Params,
    config: PartsConfig,
    queries: Embedded,
    supports: Embedded,
    drop: Callable[[Array], Array],
) -> Array:
    """Logits (S, Q) of what queries find in each support; shapes as in `attention`."""
    xp = namespace(queries.keys)
    w, t = config.key_width, config.tokens
    s, q = supports.keys.shape[1], queries.keys.shape[2] // t
    weights = attention(params, config, queries, supports)
    # Evidence is relu([|q - p|, q, q - p] M + b) of the values q and their prototype p; what of it
    # is linear in p is attended to beside p itself, before there are pairs.
    reduced = supports.values @ params["evidence.difference.weight"]
    found = weights @ xp.concat([supports.values, reduced], axis=-1)  # (P, S, Q·T, W + E)
    own = params["evidence.query.weight"] + params["evidence.difference.weight"]
    asked = queries.values @ own + params["evidence.bias"]
    apart_values = xp.abs(queries.values - found[..., :w])
    evidence = relu(apart_values @ params["evidence.apart.weight"] + asked - found[..., w:])
    evidence = evidence * (queries.present * _ever(supports))
    evidence = xp.reshape(xp.permute_dims(evidence, (1, 2, 0, 3)), (s, q, t, -1))
    moments = drop(relu(linear(params, "parts", evidence)))  # (S, Q, T, 2E)
    importance = xp.permute_dims(moments @ params["moment.weight"], (0, 1, 3, 2))  # (S, Q, 1, T)
    pooled = xp.concat(
        [
            (softmax(importance) @ moments)[:, :, 0],
            xp.mean(moments, axis=2),
            xp.max(moments, axis=2),
        ],
        axis=-1,
    )
    judged = drop(relu(linear(params, "judge0", pooled)))
    return linear(params, "judge1", judged)[..., 0]


def _side_by_side(clips: Embedded) -> Embedded:
    """(P, N, T, ·) to (P, 1, N·T, ·)."""
    xp = namespace(clips.keys)
    return Embedded(*(xp.reshape(x, (x.shape[0], 1, -1, x.shape[-1])) for x in clips))


@lru_cache(maxsize=8)
def _apart(tokens: int) -> NDArray[np.float32]:
    """(T, T) distance of tokens in time, in lengths of the clip."""
    at = np.arange(tokens, dtype=np.float32)
    return np.asarray(np.abs(at[:, None] - at) / tokens, np.float32)


def _convolved(params: Params, name: str, x: Array) -> Array:
    """ReLU of a convolution over time in groups of features, zeros beyond the ends."""
    xp = namespace(x)
    p, n, t, d = x.shape
    half, group = _KERNEL // 2, d // _GROUPS
    edge = xp.zeros_like(x[:, :, :half])
    padded = xp.concat([edge, x, edge], axis=2)
    padded = xp.reshape(padded, (p, n, t + 2 * half, _GROUPS, 1, group))
    beside = xp.concat([padded[:, :, at : at + t] for at in range(_KERNEL)], axis=4)
    beside = xp.permute_dims(beside, (3, 0, 1, 2, 4, 5))
    rows = xp.reshape(beside, (_GROUPS, p * n * t, _KERNEL * group)) @ params[f"{name}.conv.weight"]
    rows = xp.reshape(xp.permute_dims(rows, (1, 0, 2)), (p, n, t, d))
    return relu(rows + params[f"{name}.conv.bias"])
