"""TRX-OS as pure functions, one for each equation of the paper.

Berti, Rosasco, Colledanchise, Natale: "One-Shot Open-Set Skeleton-Based Action Recognition",
arXiv 2209.04288, built on the temporal cross-transformer TRX (Perrett et al., CVPR 2021).

Everything here takes numpy arrays (inference) or torch tensors (training): the functions use
only what the array API standard has. Shapes: N clips, F tokens (frames), J joints, D features per
token, P = F(F-1)/2 ordered pairs of tokens, W key and value width, n examples of an action.

A linear map of a concatenated pair [a; b] is the sum of a map of a and a map of b. So each token
is projected once by both halves of the key and the value map, and pairs are formed by adding
rows; the (P, 2D) matrix of concatenated pairs never exists. The projected tokens are a clip's
*embedding*.
"""

from __future__ import annotations

from functools import lru_cache
from typing import Any

import numpy as np

from actioncli.model.arrays import (
    Array,
    Params,
    dot,
    like,
    linear,
    namespace,
    normed,
    relu,
    softmax,
)
from actioncli.model.config import ModelConfig


def parameter_shapes(config: ModelConfig) -> dict[str, tuple[int, ...]]:
    """Name and shape of every tensor that training learns."""
    inputs, width, key = config.inputs, config.width, config.key_width
    return {
        "psi.0.weight": (inputs, 2 * inputs),
        "psi.0.bias": (2 * inputs,),
        "psi.1.weight": (2 * inputs, width),
        "psi.1.bias": (width,),
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


def psi(params: Params, x: Array) -> Array:
    """Ψ, features of tokens: an MLP, J·3 → 2·J·3 → D with ReLU after each layer.

    Args:
        x: (N, F, J, 3) prepared frames.

    Returns:
        (N, F, D).
    """
    x = namespace(x).reshape(x, (*x.shape[:2], x.shape[2] * 3))
    for layer in ("psi.0", "psi.1"):
        x = relu(linear(params, layer, x))
    return x


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


def with_positions(config: ModelConfig, features: Array) -> Array:
    """Add what tells tokens apart by their place in the clip."""
    return features + like(features, positional_encoding(config.tokens, config.width))


@lru_cache(maxsize=8)
def pair_indices(tokens: int) -> tuple[tuple[int, ...], tuple[int, ...]]:
    """First and second token of all ordered pairs p = (i, j), i < j."""
    first, second = np.triu_indices(tokens, k=1)
    return tuple(first.tolist()), tuple(second.tolist())


def pairs(params: Params, config: ModelConfig, projected: Array) -> tuple[Array, Array]:
    """Keys Υ (layer-normalised; queries use the same map) and values Λ of pairs of tokens.

    Args:
        projected: (N, F, 4·W) from `project`.

    Returns:
        keys (N, P, W) and values (N, P, W).
    """
    xp = namespace(projected)
    w = config.key_width
    first, second = (
        xp.asarray(index, device=projected.device) for index in pair_indices(config.tokens)
    )

    def of_pairs(at: int) -> Array:
        return xp.take(projected[..., at : at + w], first, axis=1) + xp.take(
            projected[..., at + w : at + 2 * w], second, axis=1
        )

    return normed(params, "key.norm", of_pairs(0)), of_pairs(2 * w)


def attention(query_keys: Array, support_keys: Array) -> Array:
    """The softmax of the scaled products of keys.

    Args:
        query_keys: (..., P, W).
        support_keys: (..., n·P, W), all examples of one action together.

    Returns:
        (..., P, n·P), the attention of the query's pairs to the support's.
    """
    # Scaling the queries costs half of scaling the products.
    scaled = query_keys / query_keys.shape[-1] ** 0.5
    return softmax(scaled @ namespace(query_keys).matrix_transpose(support_keys))


def prototypes(weights: Array, values: Array) -> Array:
    """Specific prototypes: for each of the query's pairs the attended mean of the support's values.

    Args:
        weights: (..., P, n·P) from `attention`.
        values: (..., n·P, W).

    Returns:
        (..., P, W).
    """
    return weights @ values


def distance(difference: Array) -> Array:
    """T(Q, S): mean over pairs of the squared distance between the values and their prototype.

    The paper writes the Euclidean norm per pair, its authors' code the squared norm, which did
    better; see the measurement in the model card.

    Args:
        difference: (..., P, W), values minus prototype.

    Returns:
        (...).
    """
    return namespace(difference).mean(dot(difference, difference), axis=-1)


def tuple_features(params: Params, difference: Array) -> Array:
    """First layer of Disc: each pair's difference reduced, (..., P, W) → (..., P·16)."""
    x = relu(linear(params, "disc.tuple", difference))
    return namespace(x).reshape(x, (*x.shape[:-2], x.shape[-2] * x.shape[-1]))


def judge(params: Params, features: Array) -> Array:
    """The layers of Disc above `tuple_features`: 256, 64, 1. (..., P·16) → (...) logits, whose
    sigmoid is the probability that query and action agree."""
    for layer in ("disc.0", "disc.1"):
        features = relu(linear(params, layer, features))
    return linear(params, "disc.2", features)[..., 0]


def discriminator(params: Params, difference: Array) -> Array:
    """Disc: whether a difference (..., P, W) is one between two performances of the same action,
    as logits (...)."""
    return judge(params, tuple_features(params, difference))
