"""One array namespace for numpy (inference) and torch (training)."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import array_api_compat
import numpy as np

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
