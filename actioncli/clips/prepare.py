"""Preparation: from a clip of any layout and length to the few frames that the model compares."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import groupby
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from actioncli.clips.clip import Clip, FloatArray
from actioncli.clips.skeleton import (
    DEFAULT_JOINTS,
    centred,
    lengths_of,
    select_joints,
    standard_body,
    torso_length,
    turn_to_front,
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
        recorded = np.concatenate([clip.filled() for clip in group])
        parts.append(select_joints(recorded, given, names, group[0].source))
    lengths = np.array([len(clip) for clip in clips])
    joints = centred(np.concatenate(parts), names)
    if preparation.heading:
        joints = turn_to_front(joints, names, lengths)
    if preparation.size == "torso":
        parts = np.split(joints, np.cumsum(lengths)[:-1])
        joints = np.concatenate([part / torso_length(part, names) for part in parts])
    if preparation.size == "standard":
        joints = standard_body(joints, names)
    return np.asarray(joints, np.float32), lengths


def sample(joints: FloatArray, frames: int, motion: float = 0.0) -> FloatArray:
    """(T, J, 3) to `frames` frames (frames, J, 3) from first to last at `sample_places`."""
    return frames_at(joints, sample_places(joints, frames, motion))


def frames_at(joints: FloatArray, places: NDArray[np.float64]) -> FloatArray:
    """The frames (F, J, 3) of one clip (T, J, 3) at places (F,), linear between neighbours."""
    return _between(joints, places[None], np.array([len(joints)]))


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
    moved = lengths_of(step).mean(axis=1).astype(np.float64)
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
