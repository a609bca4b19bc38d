"""Cutting a clip in time, and bringing what was measured to other times."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from actioncli.clips.clip import Clip, FloatArray


def cut(clip: Clip, start: float, end: float) -> Clip:
    """The part of a clip between two times, seconds from its beginning.

    Raises:
        ClipError: nothing moves in it.
    """
    first = round(start * clip.fps)
    kept = slice(first, round(end * clip.fps) + 1)
    return Clip(
        clip.joints[kept],
        clip.joint_names,
        clip.fps,
        None if clip.confidence is None else clip.confidence[kept],
        clip.source,
        clip.notes,
        clip.start + first / clip.fps,
    )


def resample(
    values: FloatArray, times: NDArray[np.float64], wanted: NDArray[np.float64]
) -> FloatArray:
    """Values (T, ...) at other times, linear in between."""
    right = np.searchsorted(times, wanted).clip(1, len(times) - 1)
    share = (wanted - times[right - 1]) / (times[right] - times[right - 1])
    share = share.clip(0, 1).reshape(-1, *[1] * (values.ndim - 1))
    return np.asarray(values[right - 1] * (1 - share) + values[right] * share, np.float32)
