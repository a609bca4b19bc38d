"""The shapes in which people save joint positions."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from actioncli.clips.clip import FloatArray
from actioncli.clips.formats.files import check_range
from actioncli.clips.recording import LARGEST_CLIP
from actioncli.errors import ClipError


def to_people(values: NDArray[Any], where: str) -> FloatArray:
    """(T, J, 3), (T, J x 3), (T, P, J, 3), or one of them in a batch of one, to (T, P, J, 3).

    Raises:
        ClipError: it has another shape, or does not hold numbers.
    """
    if values.dtype.kind not in "iuf":
        raise ClipError(f"{where}: joint positions must be numbers, not {values.dtype}.")
    given = values.shape
    if values.ndim > 3 and given[0] == 1:
        values = values[0]
    if values.ndim == 2 and values.shape[1] and values.shape[1] % 3 == 0:
        values = values.reshape(len(values), -1, 3)
    if values.ndim == 3:
        values = values[:, None]
    if values.ndim != 4 or values.shape[3] != 3 or 0 in values.shape:
        hint = ""
        if 2 in given[-1:]:
            hint = " Positions in the image (2D) are not enough."
        elif 4 in given[-1:]:
            hint = " Save x, y and z alone, a fourth number as `confidence` (.npz, .json)."
        raise ClipError(
            f"{where}: joint positions must be (frames, joints, 3), (frames, joints x 3) or "
            f"(frames, people, joints, 3), not {given}.{hint}"
        )
    if values.size > LARGEST_CLIP:
        raise ClipError(
            f"{where}: holds {values.size} numbers in an array of shape {given}, more than the "
            f"{LARGEST_CLIP} that a clip may have; cut out the action."
        )
    with np.errstate(over="ignore", invalid="ignore"):
        positions = np.ascontiguousarray(values, dtype=np.float32)
    check_range(positions, where)
    return positions
