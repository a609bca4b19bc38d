"""Preparation: from a clip of any layout and length to the few frames that the model compares."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from actioncli.clips.clip import Clip, FloatArray
from actioncli.clips.layouts import DEFAULT_JOINTS, select_joints

# Bones of the default joints from the pelvis outwards: joint, its parent, standard length in
# torso lengths (a rounded adult). A parent always stands before its children.
BONES: tuple[tuple[str, str, float], ...] = (
    ("lhip", "pelv", 0.2),
    ("rhip", "pelv", 0.2),
    ("neck", "pelv", 1.0),
    ("lkne", "lhip", 0.8),
    ("rkne", "rhip", 0.8),
    ("lank", "lkne", 0.78),
    ("rank", "rkne", 0.78),
    ("head", "neck", 0.45),
    ("lsho", "neck", 0.37),
    ("rsho", "neck", 0.37),
    ("lelb", "lsho", 0.58),
    ("relb", "rsho", 0.58),
    ("lwri", "lelb", 0.52),
    ("rwri", "relb", 0.52),
)


@dataclass(frozen=True, slots=True)
class Preparation:
    """What is done to a clip before the model sees it; part of the model's configuration.

    The defaults are the paper's: pelvis-centred, equidistant in time.

    Attributes:
        joints: names of the J joints that the model reads, in its order.
        frames: number of frames F sampled from the clip.
        size: "recorded" keeps metres; "torso" divides by the length of the torso; "standard"
            keeps the direction of every bone and gives it a standard length, so that neither
            the performer's proportions nor where a sensor puts its joints are left. Needs the
            default joints.
        heading: turn about the vertical so that the hips and shoulders of all clips point the
            same way.
        motion: how far frames are equidistant in motion instead of time, from 0 to 1: pauses
            then take few frames and quick movements many.
    """

    joints: tuple[str, ...] = DEFAULT_JOINTS
    frames: int = 16
    size: Literal["recorded", "torso", "standard"] = "recorded"
    heading: bool = False
    motion: float = 0.0


def prepare(clip: Clip, preparation: Preparation) -> FloatArray:
    """The F frames of the joints that the model reads, centred on the pelvis.

    Returns:
        (F, J, 3) float32: metres, or torso lengths where `size` is not "recorded".

    Raises:
        ClipError: the clip's layout lacks a joint that the model reads.
    """
    names = preparation.joints
    frames = sample(_posed(clip, preparation), preparation.frames, preparation.motion)
    # Between two frames a limb that swings is interpolated too short.
    return standard_body(frames, names) if preparation.size == "standard" else frames


def prepared_at(clip: Clip, preparation: Preparation) -> NDArray[np.float64]:
    """Which frames of the clip, fractions allowed, `prepare` takes: (F,), from 0 to T - 1.

    Raises:
        ClipError: as `prepare`.
    """
    return sample_places(_posed(clip, preparation), preparation.frames, preparation.motion)


def _posed(clip: Clip, preparation: Preparation) -> FloatArray:
    """All frames of the clip as the model would see them, (T, J, 3)."""
    names = preparation.joints
    joints = select_joints(clip.joints, clip.joint_names, names, clip.source)
    joints = joints - joints[:, [names.index("pelv")]]
    if preparation.heading:
        joints = turn_to_front(joints, names)
    if preparation.size == "torso":
        return np.asarray(joints / torso_length(joints, names), np.float32)
    if preparation.size == "standard":
        return standard_body(joints, names)
    return joints


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


def torso_length(joints: FloatArray, names: tuple[str, ...]) -> np.float32:
    """Median distance from pelvis to neck, metres; the median, since single frames jump."""
    torso = joints[:, names.index("neck")] - joints[:, names.index("pelv")]
    return np.float32(max(np.median(np.linalg.norm(torso, axis=1)), 1e-3))


def standard_body(joints: FloatArray, names: tuple[str, ...]) -> FloatArray:
    """The same pose on a body of standard proportions: bone directions kept, lengths replaced.

    Args:
        joints: (T, J, 3) with the pelvis at the origin.
        names: J names, the default joints in any order.

    Returns:
        (T, J, 3) in torso lengths.
    """
    children = [names.index(joint) for joint, _, _ in BONES]
    parents = [names.index(parent) for _, parent, _ in BONES]
    length = np.array([length for _, _, length in BONES], np.float32)
    bones = joints[:, children] - joints[:, parents]
    # A bone of no length has no direction and stays a point.
    bones *= (length / (np.linalg.norm(bones, axis=2) + 1e-6))[..., None]
    standard = np.zeros_like(joints)
    for bone, (child, parent) in enumerate(zip(children, parents, strict=True)):
        standard[:, child] = standard[:, parent] + bones[:, bone]
    return standard


def sample(joints: FloatArray, frames: int, motion: float = 0.0) -> FloatArray:
    """`frames` frames from first to last at `sample_places`, linear between neighbours.

    Args:
        joints: (T, J, 3).

    Returns:
        (frames, J, 3).
    """
    at = sample_places(joints, frames, motion)
    before = np.minimum(at.astype(int), len(joints) - 2)
    share = (at - before).astype(np.float32)[:, None, None]
    return np.asarray(joints[before] * (1 - share) + joints[before + 1] * share, np.float32)


def sample_places(joints: FloatArray, frames: int, motion: float = 0.0) -> NDArray[np.float64]:
    """Places from first to last frame, equidistant in time, or partly in motion.

    Args:
        joints: (T, J, 3).
        frames: number of frames wanted.
        motion: share of motion in the clock by which frames are equidistant: with m the mean
            distance that joints move from frame to frame, the clock advances by
            (1 - motion) / (T - 1) + motion · m / Σm.

    Returns:
        (frames,) from 0 to T - 1.
    """
    last = len(joints) - 1
    if not motion:
        return np.linspace(0, last, frames)
    moved = np.linalg.norm(np.diff(joints, axis=0), axis=2).mean(axis=1)
    advance = (1 - motion) / last + motion * moved / max(float(moved.sum()), 1e-9)
    clock = np.concatenate([[0.0], np.cumsum(advance)])
    return np.interp(np.linspace(0, clock[-1], frames), clock, np.arange(last + 1))
