"""The part of a clip in which the person does something."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from actioncli.clips.clip import Clip, FloatArray
from actioncli.clips.layouts import DEFAULT_JOINTS, select_joints

# Seconds over which speed is averaged; seconds kept before and after the motion.
_SMOOTHING = 0.3
_MARGIN = 0.15
# Slower than this share of the clip's fast moments (or than this many torso lengths a second)
# counts as standing still.
_SHARE_OF_FAST = 0.2
_STILL = 0.15
# A longer rest separates two performances; a shorter part is no action.
_REST = 1.5
_SHORTEST = 0.5


def active_part(clip: Clip) -> tuple[float, float]:
    """When the person moves, in seconds from the clip's beginning.

    The limbs' speed, relative to the pelvis and in torso lengths, decides. Of several parts with
    longer rests in between, the one with most motion is taken. Where nobody was seen for long
    (confidence 0 throughout), no part goes across. A clip without motion is active as a whole.

    Returns:
        Start and end; (0, duration) if there is nothing to leave out.
    """
    speed = limb_speed(clip)
    width = max(1, round(_SMOOTHING * clip.fps))
    speed = np.convolve(speed, np.ones(width) / width, mode="same").astype(np.float32)
    seen: NDArray[np.bool_] = np.ones(len(clip), np.bool_)
    if clip.confidence is not None and clip.confidence.any():
        seen = np.any(clip.confidence, axis=1)
    fast = float(np.percentile(speed[seen], 95))
    moving = seen & (speed > max(_SHARE_OF_FAST * fast, _STILL))
    best, most = (0.0, clip.duration), 0.0
    for first, last in _stretches(moving, seen, round(_REST * clip.fps)):
        motion = float(speed[first : last + 1].sum())
        if last - first >= _SHORTEST * clip.fps and motion > most:
            margin = round(_MARGIN * clip.fps)
            while margin and not seen[max(first - margin, 0) : last + margin + 1].all():
                margin -= 1
            start = max(first - margin, 0) / clip.fps
            best, most = (start, min((last + margin) / clip.fps, clip.duration)), motion
    return best


def limb_speed(clip: Clip) -> FloatArray:
    """(T,) mean speed of the default joints relative to the pelvis, in torso lengths a second."""
    joints = select_joints(clip.joints, clip.joint_names, DEFAULT_JOINTS, clip.source)
    joints = joints - joints[:, [DEFAULT_JOINTS.index("pelv")]]
    torso = np.median(np.linalg.norm(joints[:, DEFAULT_JOINTS.index("neck")], axis=1))
    velocity = np.gradient(joints, axis=0) * (clip.fps / max(float(torso), 1e-3))
    return np.asarray(np.linalg.norm(velocity, axis=2).mean(axis=1), np.float32)


def _stretches(
    moving: NDArray[np.bool_],
    seen: NDArray[np.bool_],
    rest: int,
) -> list[tuple[int, int]]:
    """First and last frames of the parts with motion; short rests are part of them."""
    found: list[tuple[int, int]] = []
    for frame in np.flatnonzero(moving).tolist():
        if found and frame - found[-1][1] <= rest and seen[found[-1][1] : frame].all():
            found[-1] = (found[-1][0], frame)
        else:
            found.append((frame, frame))
    return found
