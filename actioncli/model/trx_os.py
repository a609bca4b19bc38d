"""TRX-OS as pure functions, one for each equation of the paper.

Berti, Rosasco, Colledanchise, Natale: "One-Shot Open-Set Skeleton-Based Action Recognition",
arXiv 2209.04288, built on the temporal cross-transformer TRX (Perrett et al., CVPR 2021).

Everything here takes numpy arrays (inference) or torch tensors (training): the functions use
only what the array API standard has. Shapes: N clips, F frames, J joints, D features per frame,
P = F(F-1)/2 ordered frame pairs, W key and value width, Q queries, K actions, n examples.

A linear map of a concatenated pair [a; b] is the sum of a map of a and a map of b. So each frame
is projected once by both halves of the key and the value map, and pairs are formed by adding
rows; the (P, 2D) matrix of concatenated pairs never exists. The projected frames are a clip's
*embedding*, all that later steps need.
"""

from __future__ import annotations

from collections.abc import Mapping
from functools import lru_cache
from typing import Any

import array_api_compat
import numpy as np

from actioncli.model.config import ModelConfig

Array = Any  # a numpy array or a torch tensor; the standard defines no common type
Params = Mapping[str, Array]


def namespace(x: Array) -> Any:
    """The array API functions for `x`.

    numpy's own follow the standard since 2.1. The compatibility layer is only there for torch:
    wrapping numpy, it would import all of numpy's submodules, which takes as long as numpy.
    """
    return np if isinstance(x, np.ndarray) else array_api_compat.array_namespace(x)


def parameter_shapes(config: ModelConfig) -> dict[str, tuple[int, ...]]:
    """Name and shape of every tensor that a model of this configuration has."""
    inputs, width, key = config.inputs, config.width, config.key_width
    pairs = config.preparation.frames * (config.preparation.frames - 1) // 2
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
        "disc.0.weight": (pairs * config.tuple_width, 256),
        "disc.0.bias": (256,),
        "disc.1.weight": (256, 64),
        "disc.1.bias": (64,),
        "disc.2.weight": (64, 1),
        "disc.2.bias": (1,),
    }


def psi(params: Params, x: Array) -> Array:
    """Ψ, features of single frames: J·3 → 2·J·3 → D, ReLU after each layer.

    Args:
        x: (N, F, J·3) prepared frames.

    Returns:
        (N, F, D).
    """
    for layer in ("psi.0", "psi.1"):
        x = _relu(x @ params[f"{layer}.weight"] + params[f"{layer}.bias"])
    return x


@lru_cache(maxsize=8)
def positional_encoding(frames: int, width: int) -> np.ndarray[Any, np.dtype[np.float32]]:
    """Sines and cosines of the frame number, (F, D), a tenth of the usual size as in TRX."""
    position = np.arange(frames)[:, None]
    rate = np.exp(np.arange(0, width, 2) * (-np.log(10000.0) / width))
    encoding = np.stack([np.sin(position * rate), np.cos(position * rate)], axis=2)
    return np.asarray(0.1 * encoding.reshape(frames, -1)[:, :width], np.float32)


def embed(params: Params, config: ModelConfig, x: Array) -> Array:
    """The embedding of clips: every frame under both halves of the key and value maps.

    Args:
        x: (N, F, J, 3) prepared frames.

    Returns:
        (N, F, 4·W): a frame as first of a pair and as second of a pair, as key, then as value.
    """
    xp = namespace(x)
    n, frames = x.shape[:2]
    features = psi(params, xp.reshape(x, (n, frames, config.inputs)))
    features = features + xp.asarray(positional_encoding(frames, config.width))
    halves = []
    for name in ("key", "value"):
        weight = params[f"{name}.weight"]
        halves.append(features @ weight[: config.width, :])
        halves.append(features @ weight[config.width :, :] + params[f"{name}.bias"])
    return xp.concat(halves, axis=-1)


@lru_cache(maxsize=8)
def pair_indices(frames: int) -> tuple[tuple[int, ...], tuple[int, ...]]:
    """First and second frame of all ordered pairs p = (i, j), i < j."""
    first, second = np.triu_indices(frames, k=1)
    return tuple(first.tolist()), tuple(second.tolist())


def pairs(params: Params, config: ModelConfig, embedding: Array) -> tuple[Array, Array]:
    """Keys Υ (layer-normalised; queries use the same map) and values Λ of all frame pairs.

    Args:
        embedding: (N, F, 4·W) from `embed`.

    Returns:
        keys (N, P, W) and values (N, P, W).
    """
    xp = namespace(embedding)
    w = config.key_width
    first, second = (xp.asarray(index) for index in pair_indices(embedding.shape[1]))

    def of_pairs(at: int) -> Array:
        return xp.take(embedding[..., at : at + w], first, axis=1) + xp.take(
            embedding[..., at + w : at + 2 * w], second, axis=1
        )

    keys = layer_norm(of_pairs(0), params["key.norm.scale"], params["key.norm.shift"])
    return keys, of_pairs(2 * w)


def layer_norm(x: Array, scale: Array, shift: Array) -> Array:
    """Zero mean and unit variance along the last axis, then scaled and shifted."""
    xp = namespace(x)
    centred = x - xp.mean(x, axis=-1, keepdims=True)
    variance = xp.mean(centred * centred, axis=-1, keepdims=True)
    return centred / xp.sqrt(variance + 1e-5) * scale + shift


def prototypes(query_keys: Array, support_keys: Array, support_values: Array) -> Array:
    """Query-specific prototypes: each query pair attends to all pairs of an action's examples.

    Args:
        query_keys: (..., P, W).
        support_keys, support_values: (..., n·P, W), all examples of one action together.

    Returns:
        (..., P, W): for each query pair the attended mean of the support's values.
    """
    xp = namespace(query_keys)
    scores = query_keys @ xp.matrix_transpose(support_keys) / query_keys.shape[-1] ** 0.5
    weights = xp.exp(scores - xp.max(scores, axis=-1, keepdims=True))
    # Normalising the product instead of the weights divides W instead of n·P numbers a row.
    return weights @ support_values / xp.sum(weights, axis=-1, keepdims=True)


def distance(config: ModelConfig, difference: Array) -> Array:
    """T(Q, S): mean over pairs of the distance between the query's values and its prototype.

    The paper writes the Euclidean norm per pair, its authors' code the squared norm; see
    `ModelConfig.distance` and the measurement in the model card.

    Args:
        difference: (..., P, W), query values minus prototype.

    Returns:
        (...).
    """
    xp = namespace(difference)
    squared = xp.sum(difference * difference, axis=-1)
    if config.distance == "l2":
        squared = xp.sqrt(squared + 1e-12)
    return xp.mean(squared, axis=-1)


def discriminator(params: Params, difference: Array) -> Array:
    """Disc: whether a difference is one between two performances of the same action.

    Each pair's difference is reduced W → 16, all are flattened, then 256, 64, 1.

    Args:
        difference: (..., P, W).

    Returns:
        (...) logits; their sigmoid is the probability that query and action agree.
    """
    xp = namespace(difference)
    x = _relu(difference @ params["disc.tuple.weight"] + params["disc.tuple.bias"])
    x = xp.reshape(x, (*x.shape[:-2], x.shape[-2] * x.shape[-1]))
    for layer in ("disc.0", "disc.1"):
        x = _relu(x @ params[f"{layer}.weight"] + params[f"{layer}.bias"])
    return (x @ params["disc.2.weight"] + params["disc.2.bias"])[..., 0]


def _relu(x: Array) -> Array:
    # `where` and `maximum` with a scalar are not in every version of the standard; this is.
    return x * namespace(x).astype(x > 0, x.dtype)
