"""TRX-OS as pure functions, one for each equation of the paper.

Berti, Rosasco, Colledanchise, Natale: "One-Shot Open-Set Skeleton-Based Action Recognition",
arXiv 2209.04288, built on the temporal cross-transformer TRX (Perrett et al., CVPR 2021).

Everything here takes numpy arrays (inference) or torch tensors (training): the functions use
only what the array API standard has. Shapes: N clips, F tokens (the paper's are single frames),
J joints, D features per token, P = F(F-1)/2 ordered pairs of tokens, W key and value width,
n examples of an action.

A linear map of a concatenated pair [a; b] is the sum of a map of a and a map of b. So each token
is projected once by both halves of the key and the value map, and pairs are formed by adding
rows; the (P, 2D) matrix of concatenated pairs never exists. The projected tokens are the larger
part of a clip's *embedding*.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import lru_cache
from typing import Any

import numpy as np

from actioncli.model.arrays import (
    Array,
    Params,
    dot,
    linear,
    namespace,
    normed,
    relu,
    total,
)
from actioncli.model.config import ModelConfig


def parameter_shapes(config: ModelConfig) -> dict[str, tuple[int, ...]]:
    """Name and shape of every tensor that training learns."""
    inputs, width, key = config.inputs, config.width, config.key_width
    shapes: dict[str, tuple[int, ...]] = {}
    if config.convolutions:
        shapes |= {"psi.0.weight": (inputs, width), "psi.0.bias": (width,)}
        for block in range(config.convolutions):
            name = f"psi.block{block}"
            shapes |= {
                f"{name}.norm.scale": (width,),
                f"{name}.norm.shift": (width,),
                f"{name}.conv.weight": (3 * width, width),
                f"{name}.conv.bias": (width,),
                f"{name}.out.weight": (width, width),
                f"{name}.out.bias": (width,),
            }
        shapes |= {"psi.norm.scale": (width,), "psi.norm.shift": (width,)}
        shapes |= {"positions": (config.tokens, width)}
    else:
        shapes |= {
            "psi.0.weight": (inputs, 2 * inputs),
            "psi.0.bias": (2 * inputs,),
            "psi.1.weight": (2 * inputs, width),
            "psi.1.bias": (width,),
        }
    return shapes | {
        "key.weight": (2 * width, key),
        "key.bias": (key,),
        "key.norm.scale": (key,),
        "key.norm.shift": (key,),
        "value.weight": (2 * width, key),
        "value.bias": (key,),
        "disc.tuple.weight": (key, config.tuple_width),
        "disc.tuple.bias": (config.tuple_width,),
        "disc.0.weight": (config.pairs * config.tuple_width, 256),
        "disc.0.bias": (256,),
        "disc.1.weight": (256, 64),
        "disc.1.bias": (64,),
        "disc.2.weight": (64, 1),
        "disc.2.bias": (1,),
    }


def _kept(x: Array) -> Array:
    return x


def psi(
    params: Params, config: ModelConfig, x: Array, drop: Callable[[Array], Array] = _kept
) -> Array:
    """Ψ, features of tokens.

    The paper's is an MLP, J·3 → 2·J·3 → D with ReLU after each layer. With `convolutions` it is
    a linear map and residual blocks x + out(ReLU(conv(norm(x)))), the convolution over three
    neighbouring tokens, and a layer norm at the end.

    Args:
        x: (N, F, inputs) from `token_features`.
        drop: dropout, in training.

    Returns:
        (N, F, D).
    """
    xp = namespace(x)
    if not config.convolutions:
        for layer in ("psi.0", "psi.1"):
            x = relu(linear(params, layer, x))
        return x
    x = linear(params, "psi.0", x)
    for block in range(config.convolutions):
        name = f"psi.block{block}"
        inner = normed(params, f"{name}.norm", x)
        edge = xp.zeros_like(inner[:, :1])
        beside = [
            xp.concat([edge, inner[:, :-1]], axis=1),
            inner,
            xp.concat([inner[:, 1:], edge], axis=1),
        ]
        inner = relu(linear(params, f"{name}.conv", xp.concat(beside, axis=2)))
        x = x + drop(linear(params, f"{name}.out", inner))
    return normed(params, "psi.norm", x)


@lru_cache(maxsize=8)
def positional_encoding(tokens: int, width: int) -> np.ndarray[Any, np.dtype[np.float32]]:
    """Sines and cosines of the token's number, (F, D), a tenth of the usual size as in TRX."""
    position = np.arange(tokens)[:, None]
    rate = np.exp(np.arange(0, width, 2) * (-np.log(10000.0) / width))
    encoding = np.stack([np.sin(position * rate), np.cos(position * rate)], axis=2)
    return np.asarray(0.1 * encoding.reshape(tokens, -1)[:, :width], np.float32)


def project(params: Params, config: ModelConfig, features: Array) -> Array:
    """Every token under both halves of the key and the value map.

    Args:
        features: (N, F, D) from `psi`.

    Returns:
        (N, F, 4·W): a token as first of a pair and as second of a pair, as key, then as value.
    """
    xp = namespace(features)
    halves = []
    for name in ("key", "value"):
        weight = params[f"{name}.weight"]
        halves.append(features @ weight[: config.width, :])
        halves.append(features @ weight[config.width :, :] + params[f"{name}.bias"])
    return xp.concat(halves, axis=-1)


def with_positions(params: Params, config: ModelConfig, features: Array) -> Array:
    """Add what tells tokens apart by their place in the clip; fixed, or learned if it is there."""
    if config.convolutions:
        return features + params["positions"]
    encoding = positional_encoding(config.tokens, config.width)
    return features + namespace(features).asarray(encoding, device=features.device)


@lru_cache(maxsize=8)
def pair_indices(tokens: int) -> tuple[tuple[int, ...], tuple[int, ...]]:
    """First and second token of all ordered pairs p = (i, j), i < j."""
    first, second = np.triu_indices(tokens, k=1)
    return tuple(first.tolist()), tuple(second.tolist())


def pairs(
    params: Params, config: ModelConfig, projected: Array, chosen: Array | None = None
) -> tuple[Array, Array]:
    """Keys Υ (layer-normalised; queries use the same map) and values Λ of pairs of tokens.

    Args:
        projected: (N, F, 4·W) from `project`; further columns are ignored.
        chosen: numbers of the pairs to form; all P without it.

    Returns:
        keys (N, P, W) and values (N, P, W).
    """
    xp = namespace(projected)
    w = config.key_width
    first, second = (
        xp.asarray(index, device=projected.device) for index in pair_indices(config.tokens)
    )
    if chosen is not None:
        first, second = first[chosen], second[chosen]

    def of_pairs(at: int) -> Array:
        return xp.take(projected[..., at : at + w], first, axis=1) + xp.take(
            projected[..., at + w : at + 2 * w], second, axis=1
        )

    return normed(params, "key.norm", of_pairs(0)), of_pairs(2 * w)


def attention(query_keys: Array, support_keys: Array) -> Array:
    """Exponentials of the scaled products of keys, not yet divided by their sum.

    Args:
        query_keys: (..., P, W).
        support_keys: (..., n·P, W), all examples of one action together.

    Returns:
        (..., P, n·P); rows divided by their sum are the attention of the query's pairs to the
        support's, columns divided by theirs that of the support's pairs to the query's.
    """
    xp = namespace(query_keys)
    # Scaling the queries costs half of scaling the products.
    scaled = query_keys / query_keys.shape[-1] ** 0.5
    scores = scaled @ xp.matrix_transpose(support_keys)
    # One largest score for rows and columns: normalised keys keep scores within ±√W.
    return xp.exp(scores - xp.max(scores, axis=(-2, -1), keepdims=True))


def prototypes(weights: Array, values: Array) -> Array:
    """Specific prototypes: for each pair of one side the attended mean of the other's values.

    Args:
        weights: (..., P, n·P) from `attention`.
        values: (..., n·P, W).

    Returns:
        (..., P, W).
    """
    # Normalising the product instead of the weights divides W instead of n·P numbers a row.
    return weights @ values / total(weights)


def distance(config: ModelConfig, difference: Array) -> Array:
    """T(Q, S): mean over pairs of the distance between the values and their prototype.

    The paper writes the Euclidean norm per pair, its authors' code the squared norm; see
    `ModelConfig.distance` and the measurement in the model card.

    Args:
        difference: (..., P, W), values minus prototype.

    Returns:
        (...).
    """
    xp = namespace(difference)
    squared = dot(difference, difference)
    if config.distance == "l2":
        squared = xp.sqrt(squared + 1e-6)
    return xp.mean(squared, axis=-1)


def tuple_features(params: Params, difference: Array) -> Array:
    """First layer of Disc: each pair's difference reduced, (..., P, W) → (..., P, 16)."""
    return relu(linear(params, "disc.tuple", difference))


def judge(params: Params, features: Array) -> Array:
    """The layers of Disc above `tuple_features`: flatten, 256, 64, 1.

    Args:
        features: (..., P, 16).

    Returns:
        (...) logits; their sigmoid is the probability that query and action agree.
    """
    xp = namespace(features)
    x = xp.reshape(features, (*features.shape[:-2], features.shape[-2] * features.shape[-1]))
    for layer in ("disc.0", "disc.1"):
        x = relu(linear(params, layer, x))
    return linear(params, "disc.2", x)[..., 0]


def discriminator(params: Params, difference: Array) -> Array:
    """Disc: whether a difference is one between two performances of the same action.

    Args:
        difference: (..., P, W).

    Returns:
        (...) logits.
    """
    return judge(params, tuple_features(params, difference))
