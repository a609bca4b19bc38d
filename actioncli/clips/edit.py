"""Cutting a clip in time, mirroring it, and bringing what was measured to other times."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from actioncli.clips.clip import Clip, FloatArray
from actioncli.clips.skeleton import (
    DEFAULT_JOINTS,
    HAND_JOINTS,
    default_columns,
    midpoints,
    mirrored_columns,
)


def cut(clip: Clip, start: float, end: float) -> Clip:
    """The part of a clip between two times, seconds from its beginning.

    Raises:
        ClipError: nothing moves in it.
    """
    first = round(start * clip.fps)
    kept = slice(first, round(end * clip.fps) + 1)
    confidence = None if clip.confidence is None else clip.confidence[kept]
    start = clip.start + first / clip.fps
    return replace(clip, joints=clip.joints[kept], confidence=confidence, start=start)


def mirrored(clip: Clip) -> Clip:
    """The joints that models read, with left and right exchanged."""
    columns = {**default_columns(clip.joint_names)}
    columns |= {name: (at,) for at, name in enumerate(clip.joint_names) if name in HAND_JOINTS}
    names = [name for name in (*DEFAULT_JOINTS, *HAND_JOINTS) if columns.get(name)]
    groups = [columns[name] for name in names]
    order = mirrored_columns(names)
    joints = midpoints(clip.joints, groups)[:, order] * np.array([-1, 1, 1], np.float32)
    confidence = None
    if clip.confidence is not None:
        seen = [clip.confidence[:, list(group)].min(axis=1) for group in groups]
        confidence = np.stack(seen, axis=1)[:, order]
    source = f"{clip.source} (mirrored)".lstrip()
    return Clip(joints, names, clip.fps, confidence, source, clip.notes, clip.start)


def resample(
    values: FloatArray, times: NDArray[np.float64], wanted: NDArray[np.float64]
) -> FloatArray:
    """Values (T, ...) at other times, linear in between."""
    right = np.searchsorted(times, wanted).clip(1, len(times) - 1)
    share = (wanted - times[right - 1]) / (times[right] - times[right - 1])
    share = share.clip(0, 1).reshape(-1, *[1] * (values.ndim - 1))
    return np.asarray(values[right - 1] * (1 - share) + values[right] * share, np.float32)
