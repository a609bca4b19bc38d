"""Preparation: from a clip of any layout and length to the few frames that the model compares."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from actioncli.clips.clip import Clip, FloatArray
from actioncli.clips.layouts import DEFAULT_JOINTS, select_joints


@dataclass(frozen=True, slots=True)
class Preparation:
    """What is done to a clip before the model sees it; part of the model's configuration.

    Attributes:
        joints: names of the J joints that the model reads, in its order.
        frames: number of frames F sampled from the clip.
        scale: divide by the length of the torso, so that children and adults, and sensors of
            different calibration, look alike.
        heading: turn about the vertical so that the hips and shoulders of all clips point the
            same way.
    """

    joints: tuple[str, ...] = DEFAULT_JOINTS
    frames: int = 16
    scale: bool = False
    heading: bool = False


def prepare(clip: Clip, preparation: Preparation) -> FloatArray:
    """F equidistant frames of the joints that the model reads, centred on the pelvis.

    Returns:
        (F, J, 3) float32: metres, or torso lengths where `scale` is on.

    Raises:
        ClipError: the clip's layout lacks a joint that the model reads.
    """
    joints = select_joints(clip.joints, clip.joint_names, preparation.joints, clip.source)
    names = preparation.joints
    joints = joints - joints[:, [names.index("pelv")]]
    if preparation.heading:
        joints = turn_to_front(joints, names)
    if preparation.scale:
        joints = joints / torso_length(joints, names)
    return sample(joints, preparation.frames)


def sample(joints: FloatArray, frames: int) -> FloatArray:
    """`frames` equidistant frames from first to last, linear between neighbours."""
    at = np.linspace(0, len(joints) - 1, frames)
    before = np.minimum(at.astype(int), len(joints) - 2)
    share = (at - before).astype(np.float32)[:, None, None]
    return np.asarray(joints[before] * (1 - share) + joints[before + 1] * share, np.float32)


def torso_length(joints: FloatArray, names: tuple[str, ...]) -> np.float32:
    """Median distance from pelvis to neck, metres; the median, since single frames jump."""
    torso = joints[:, names.index("neck")] - joints[:, names.index("pelv")]
    return np.float32(max(np.median(np.linalg.norm(torso, axis=1)), 1e-3))


def turn_to_front(joints: FloatArray, names: tuple[str, ...]) -> FloatArray:
    """Turn about the vertical until the mean left-to-right axis of hips and shoulders is +x.

    One turn for the whole clip: what the person turns during the action stays visible.
    """
    right = joints[:, names.index("rhip")] + joints[:, names.index("rsho")]
    left = joints[:, names.index("lhip")] + joints[:, names.index("lsho")]
    across = (right - left).mean(axis=0)
    angle = np.arctan2(across[2], across[0])
    cos, sin = np.cos(angle), np.sin(angle)
    turn = np.array([[cos, 0, -sin], [0, 1, 0], [sin, 0, cos]], np.float32)
    return np.asarray(joints @ turn, np.float32)
