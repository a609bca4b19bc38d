"""Preparation: from a clip of any layout and length to the few frames that the model compares."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import groupby
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
    frames: FloatArray = prepare_all([clip], preparation)[0]
    return frames


def prepare_all(clips: Sequence[Clip], preparation: Preparation) -> FloatArray:
    """`prepare` for N clips at once, (N, F, J, 3).

    Raises:
        ClipError: as `prepare`.
    """
    names, frames = preparation.joints, preparation.frames
    if len(clips) == 0:
        return np.empty((0, frames, len(names), 3), np.float32)
    joints, lengths = _posed(clips, preparation)
    at = _places(joints, lengths, frames, preparation.motion)
    sampled = _between(joints, at, lengths)
    if preparation.size == "standard":
        # Between two frames a limb that swings is interpolated too short.
        sampled = standard_body(sampled, names)
    return sampled.reshape(len(clips), frames, len(names), 3)


def prepared_at(clip: Clip, preparation: Preparation) -> NDArray[np.float64]:
    """Which frames of the clip, fractions allowed, `prepare` takes: (F,), from 0 to T - 1.

    Raises:
        ClipError: as `prepare`.
    """
    joints, _ = _posed([clip], preparation)
    return sample_places(joints, preparation.frames, preparation.motion)


def _posed(clips: Sequence[Clip], preparation: Preparation) -> tuple[FloatArray, NDArray[np.intp]]:
    """All frames of the clips as the model would see them, one clip after another, (ΣT, J, 3),
    and their lengths (N,)."""
    names = preparation.joints
    parts = []
    for given, alike in groupby(clips, key=lambda clip: clip.joint_names):
        group = list(alike)
        recorded = np.concatenate([clip.joints for clip in group])
        parts.append(select_joints(recorded, given, names, group[0].source))
    lengths = np.array([len(clip) for clip in clips])
    joints = np.concatenate(parts)
    joints -= joints[:, [names.index("pelv")]]
    if preparation.heading:
        joints = turn_to_front(joints, names, lengths)
    if preparation.size == "torso":
        parts = np.split(joints, np.cumsum(lengths)[:-1])
        joints = np.concatenate([part / torso_length(part, names) for part in parts])
    if preparation.size == "standard":
        joints = standard_body(joints, names)
    return np.asarray(joints, np.float32), lengths


def turn_to_front(
    joints: FloatArray, names: tuple[str, ...], lengths: NDArray[np.intp] | None = None
) -> FloatArray:
    """Turn about the vertical until the mean left-to-right axis of hips and shoulders is +x.

    One turn for a whole clip: what the person turns during the action stays visible.

    Args:
        joints: (T, J, 3).
        names: J names.
        lengths: of the clips that stand one after another in `joints`; one clip without it.
    """
    right = joints[:, names.index("rhip")] + joints[:, names.index("rsho")]
    left = joints[:, names.index("lhip")] + joints[:, names.index("lsho")]
    counts = np.array([len(joints)]) if lengths is None else lengths
    # Only the direction of the sum matters, so there is no need for the mean.
    across = np.add.reduceat(right - left, np.cumsum(counts) - counts, axis=0)
    angle = np.repeat(np.arctan2(across[:, 2], across[:, 0]), counts)[:, None]
    cos, sin = np.cos(angle), np.sin(angle)
    x, y, z = joints[..., 0], joints[..., 1], joints[..., 2]
    return np.asarray(np.stack([x * cos + z * sin, y, z * cos - x * sin], axis=-1), np.float32)


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
    bones *= (length / (_norm(bones) + np.float32(1e-6)))[..., None]
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
    lengths = np.array([len(joints)])
    return _between(joints, _places(joints, lengths, frames, motion), lengths)


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
    places: NDArray[np.float64] = _places(joints, np.array([len(joints)]), frames, motion)[0]
    return places


def _places(
    joints: FloatArray, lengths: NDArray[np.intp], frames: int, motion: float
) -> NDArray[np.float64]:
    """`sample_places` of N clips that stand one after another in `joints`: (N, frames)."""
    last = np.cumsum(lengths) - 1
    first = last - lengths + 1
    wanted = np.linspace(0, 1, frames)
    if not motion:
        return first[:, None] + wanted * (lengths - 1)[:, None]
    step = np.diff(joints, axis=0, prepend=joints[:1])
    moved = _norm(step).mean(axis=1).astype(np.float64)
    moved[first] = 0
    total = np.maximum(np.add.reduceat(moved, first), 1e-9)
    advance = np.repeat((1 - motion) / (lengths - 1), lengths)
    advance += np.repeat(motion / total, lengths) * moved
    # Between one clip's last frame and the next one's first, the clock makes a jump of its own.
    advance[first] = 1
    clock = np.cumsum(advance)
    begun, ended = clock[first][:, None], clock[last][:, None]
    places = np.interp(begun + wanted * (ended - begun), clock, np.arange(len(joints)))
    return np.asarray(np.clip(places, first[:, None], last[:, None]))


def _between(joints: FloatArray, at: NDArray[np.float64], lengths: NDArray[np.intp]) -> FloatArray:
    """The frames (N·frames, J, 3) of clips at places (N, frames), linear between neighbours."""
    before = np.minimum(at.astype(int), np.cumsum(lengths)[:, None] - 2)
    share = (at - before).astype(np.float32).reshape(-1, 1, 1)
    before = before.reshape(-1)
    return np.asarray(joints[before] * (1 - share) + joints[before + 1] * share, np.float32)


def _norm(vectors: FloatArray) -> FloatArray:
    """Lengths of vectors, (..., 3) to (...); numpy's own sums three numbers in a slow way."""
    return np.asarray(np.sqrt(np.einsum("...i,...i->...", vectors, vectors)))
