"""Arrays of numpy (inference) and torch (training) under one namespace, and the layers on them."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import array_api_compat
import numpy as np
from numpy.typing import NDArray

Array = Any  # a numpy array or a torch tensor; the standard defines no common type
Params = Mapping[str, Array]


def namespace(x: Array) -> Any:
    """The array API functions for `x`.

    numpy's own follow the standard since 2.1. The compatibility layer is only there for torch:
    wrapping numpy, it would import all of numpy's submodules, which takes as long as numpy.
    """
    return np if isinstance(x, np.ndarray) else array_api_compat.array_namespace(x)


def dot(x: Array, y: Array) -> Array:
    """Sum of products along the last axis. numpy does it without an array of the products."""
    return np.vecdot(x, y) if isinstance(x, np.ndarray) else namespace(x).sum(x * y, axis=-1)


def total(x: Array) -> Array:
    """Sum along the last axis, which stays. A matrix product is faster for numpy than its own sum,
    above all where the axis was swapped with another."""
    if isinstance(x, np.ndarray):
        return (x @ np.ones(x.shape[-1], x.dtype))[..., np.newaxis]
    return namespace(x).sum(x, axis=-1, keepdims=True)


def like(x: Array, constant: NDArray[Any]) -> Array:
    """A constant as an array of the same kind, type and device as `x`."""
    if isinstance(x, np.ndarray):
        return constant
    return namespace(x).asarray(constant, dtype=x.dtype, device=x.device)


def relu(x: Array) -> Array:
    """The positive part."""
    return np.maximum(x, 0) if isinstance(x, np.ndarray) else namespace(x).relu(x)


def softmax(x: Array) -> Array:
    """Along the last axis."""
    if not isinstance(x, np.ndarray):
        return namespace(x).softmax(x, dim=-1)
    weights = np.exp(x - np.max(x, axis=-1, keepdims=True))
    return weights / np.sum(weights, axis=-1, keepdims=True)


def linear(params: Params, name: str, x: Array) -> Array:
    """A layer. Its rows are put below each other: numpy would multiply a matrix for each clip."""
    weight = params[f"{name}.weight"]
    xp = namespace(x)
    rows = xp.reshape(x, (-1, x.shape[-1])) @ weight + params[f"{name}.bias"]
    return xp.reshape(rows, (*x.shape[:-1], weight.shape[1]))


def normed(params: Params, name: str, x: Array) -> Array:
    """Layer norm: zero mean and unit variance along the last axis, then scaled and shifted."""
    scale, shift = params[f"{name}.scale"], params[f"{name}.shift"]
    numbers = x.shape[-1]
    if not isinstance(x, np.ndarray):
        return namespace(x).layer_norm(x, (numbers,), scale, shift, 1e-5)
    centred = x - total(x) / numbers
    variance = dot(centred, centred)[..., None] / numbers
    return centred / np.sqrt(variance + 1e-5) * scale + shift


def sigmoid(x: NDArray[Any]) -> NDArray[Any]:
    """1 / (1 + exp(-x)); tanh cannot overflow, exp can."""
    return np.asarray(0.5 + 0.5 * np.tanh(0.5 * x), np.float32)
