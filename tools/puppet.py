"""A puppet: a body of fixed bone lengths, and the joint positions that joint angles give it.

Body axes: x to the performer's left, y up, z forward; the origin is on the ground between the
feet. Lengths are metres, angles degrees, and every angle is an array over T frames. Legs are
solved backwards from where the ankles stand (two-bone inverse kinematics), so feet that should
stay on the ground do; everything else is forward kinematics from the pelvis.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]

SIDES = {"l": 1.0, "r": -1.0}

# MeTRAbs' `smpl+head_30`: the joints of SMPL, then six points of the head.
_NAMES = (
    "pelv lhip rhip spi1 lkne rkne spi2 lank rank spi3 ltoe rtoe neck lcla rcla head "
    "lsho rsho lelb relb lwri rwri lhan rhan htop lear leye nose rear reye"
)
JOINT_NAMES = tuple(_NAMES.split())


@dataclass(frozen=True)
class Body:
    """Stature in metres, and how much longer or wider than average the parts are.

    Segment lengths as fractions of stature follow Drillis and Contini (1966), the table that
    biomechanics textbooks print: hip 0.530, knee 0.285 and ankle 0.039 above the ground, upper
    arm 0.186, forearm 0.146, shoulder 0.818, eyes 0.936.
    """

    stature: float
    legs: float = 1.0
    arms: float = 1.0
    shoulders: float = 1.0
    hips: float = 1.0
    head: float = 1.0

    @property
    def thigh(self) -> float:
        return 0.245 * self.legs * self.stature

    @property
    def shank(self) -> float:
        return 0.246 * self.legs * self.stature

    @property
    def ankle_height(self) -> float:
        return 0.039 * self.stature

    @property
    def hip_drop(self) -> float:
        """How far the hips lie below the pelvis joint."""
        return 0.030 * self.stature

    @property
    def hip_width(self) -> float:
        """From the middle to one hip."""
        return 0.050 * self.hips * self.stature

    @property
    def pelvis_height(self) -> float:
        """Height of the pelvis joint in relaxed standing, knees not quite straight."""
        return self.ankle_height + 0.996 * (self.thigh + self.shank) + self.hip_drop

    def offset(self, x: float, y: float, z: float = 0.0) -> Floats:
        """A vector in fractions of stature, as metres."""
        return self.stature * np.array([x, y, z])


@dataclass
class Arm:
    """One arm's angles over time.

    `lift`: 0 hangs, 90 is level, 180 overhead; `plane`: 0 lifts it forward, 90 sideways,
    negative across the body; `elbow`: 0 is straight; `roll`: about the upper arm's own axis,
    so that with the arm level and sideways and the elbow at 90, 0 points the forearm up and
    -90 forward.
    """

    lift: Floats
    plane: Floats
    elbow: Floats
    roll: Floats


@dataclass
class Leg:
    """Where one foot stands, or how the leg swings when it does not.

    `foot`: (T, 3) offset in metres from relaxed standing; `pitch`: toes up for positive angles;
    `free`: 0 where the foot stands, 1 where the leg follows `flexion` (hip, forward) and
    `knee` (0 is straight).
    """

    foot: Floats
    pitch: Floats
    free: Floats
    flexion: Floats
    knee: Floats


@dataclass
class Motion:
    """All that moves, over T frames. `bend` is forward, `lean` to the left, `turn` to the left."""

    frames: int
    pelvis: Floats = field(init=False)  # (T, 3) offset in metres from relaxed standing
    tilt: Floats = field(init=False)  # pelvis, forward
    hips_turn: Floats = field(init=False)
    bend: Floats = field(init=False)  # spine, all of it
    lean: Floats = field(init=False)
    turn: Floats = field(init=False)
    nod: Floats = field(init=False)  # neck and head, forward
    gaze: Floats = field(init=False)  # neck and head, to the left
    stance: float = 0.058  # half the distance of the feet, as a fraction of stature
    toes_out: float = 10.0
    arms: dict[str, Arm] = field(init=False)
    legs: dict[str, Leg] = field(init=False)

    def __post_init__(self) -> None:
        frames = self.frames
        self.pelvis = np.zeros((frames, 3))
        for name in ("tilt", "hips_turn", "bend", "lean", "turn", "nod", "gaze"):
            setattr(self, name, np.zeros(frames))
        still = np.zeros(frames)
        self.arms = {s: Arm(still + 9, still + 62, still + 14, still.copy()) for s in SIDES}
        self.legs = {
            s: Leg(np.zeros((frames, 3)), *(np.zeros(frames) for _ in range(4))) for s in SIDES
        }


def rotation(axis: str, degrees: Floats | float) -> Floats:
    """Right-handed rotations about a body axis: (..., 3, 3)."""
    angle = np.radians(np.asarray(degrees, dtype=float))
    cos, sin, one, zero = np.cos(angle), np.sin(angle), np.ones(angle.shape), np.zeros(angle.shape)
    rows = {
        "x": [[one, zero, zero], [zero, cos, -sin], [zero, sin, cos]],
        "y": [[cos, zero, sin], [zero, one, zero], [-sin, zero, cos]],
        "z": [[cos, -sin, zero], [sin, cos, zero], [zero, zero, one]],
    }[axis]
    return np.stack([np.stack(row, axis=-1) for row in rows], axis=-2)


def joint_positions(body: Body, motion: Motion) -> Floats:
    """(T, 30, 3) metres in body axes, columns as in `JOINT_NAMES`."""
    at: dict[str, Floats] = {}
    standing = np.array([0.0, body.pelvis_height, 0.0])
    at["pelv"] = standing + motion.pelvis
    hips = rotation("y", motion.hips_turn) @ rotation("x", motion.tilt)
    chest = _trunk(body, motion, hips, at)
    for side in SIDES:
        _arm(body, motion.arms[side], side, chest, at)
        _leg(body, motion, side, hips, at)
    return np.stack([at[name] for name in JOINT_NAMES], axis=1)


def _trunk(body: Body, motion: Motion, hips: Floats, at: dict[str, Floats]) -> Floats:
    """Spine, neck and head; gives the orientation of the chest."""
    third = (
        rotation("y", motion.turn / 3)
        @ rotation("x", motion.bend / 3)
        @ rotation("z", -motion.lean / 3)
    )
    lengths = {"spi1": 0.062, "spi2": 0.078, "spi3": 0.032}
    frame, below = hips, "pelv"
    for joint, length in lengths.items():
        at[joint] = at[below] + frame @ body.offset(0, length)
        frame, below = frame @ third, joint
    at["neck"] = at["spi3"] + frame @ body.offset(0, 0.120)
    half = rotation("y", motion.gaze / 2) @ rotation("x", motion.nod / 2)
    neck = frame @ half
    at["head"] = at["neck"] + neck @ body.offset(0, 0.048, 0.010)
    skull = neck @ half
    points = {"htop": (0.0, 0.100, -0.005), "nose": (0.0, 0.018, 0.062)}
    for side, sign in SIDES.items():
        points[f"{side}eye"] = (sign * 0.018, 0.036, 0.050)
        points[f"{side}ear"] = (sign * 0.042, 0.022, -0.002)
    for joint, point in points.items():
        at[joint] = at["head"] + skull @ (body.head * body.offset(*point))
    return frame


def _arm(body: Body, arm: Arm, side: str, chest: Floats, at: dict[str, Floats]) -> None:
    sign = SIDES[side]
    at[f"{side}cla"] = at["spi3"] + chest @ body.offset(sign * 0.042, 0.068, 0.004)
    # The shoulder blade takes its share of every lift of the arm.
    shrug = rotation("z", sign * 0.14 * np.maximum(arm.lift - 30, 0))
    at[f"{side}sho"] = at[f"{side}cla"] + chest @ shrug @ body.offset(
        sign * 0.064 * body.shoulders, 0.016, -0.004
    )
    upper = (
        chest
        @ rotation("y", sign * arm.plane)
        @ rotation("x", -arm.lift)
        @ rotation("y", sign * (arm.roll - arm.plane * _hanging(arm.lift)))
    )
    lower = upper @ rotation("x", -arm.elbow)
    at[f"{side}elb"] = at[f"{side}sho"] + upper @ (body.arms * body.offset(0, -0.186))
    at[f"{side}wri"] = at[f"{side}elb"] + lower @ (body.arms * body.offset(0, -0.146))
    at[f"{side}han"] = at[f"{side}wri"] + lower @ (body.arms * body.offset(0, -0.048))


def _hanging(lift: Floats) -> Floats:
    """1 for a hanging arm, 0 from 60 degrees on: a hanging arm bends forward in any plane."""
    return np.asarray(np.clip(1 - lift / 60, 0, 1))


def _leg(body: Body, motion: Motion, side: str, hips: Floats, at: dict[str, Floats]) -> None:
    sign, leg = SIDES[side], motion.legs[side]
    hip = at["pelv"] + hips @ np.array([sign * body.hip_width, -body.hip_drop, 0.0])
    stands = np.array([sign * motion.stance * body.stature, body.ankle_height, 0.0]) + leg.foot
    thigh = hips @ rotation("x", -leg.flexion) @ np.array([0.0, -body.thigh, 0.0])
    shank = hips @ rotation("x", leg.knee - leg.flexion) @ np.array([0.0, -body.shank, 0.0])
    free = leg.free[:, None]
    target = (1 - free) * stands + free * (hip + thigh + shank)
    sideways = hips @ rotation("y", sign * motion.toes_out) @ np.array([1.0, 0.0, 0.0])
    knee, ankle = two_bones(hip, target, sideways, body.thigh, body.shank)
    # A swinging foot stays about square to the shank.
    pitch = (1 - leg.free) * leg.pitch + leg.free * (leg.flexion - leg.knee + leg.pitch)
    foot = rotation("y", sign * motion.toes_out) @ rotation("x", -pitch)
    at[f"{side}hip"], at[f"{side}kne"], at[f"{side}ank"] = hip, knee, ankle
    at[f"{side}toe"] = ankle + foot @ body.offset(0, -0.030, 0.072)


def two_bones(
    root: Floats, target: Floats, sideways: Floats, first: float, second: float
) -> tuple[Floats, Floats]:
    """Middle joint and end of two bones that reach from `root` for `target`, all (T, 3).

    The middle joint bends towards the front, which is square to `sideways` and to the line from
    root to target. A target out of reach is reached for, at 99.9 % of the limb.
    """
    line = target - root
    far = np.linalg.norm(line, axis=1, keepdims=True)
    along = line / far
    far = np.minimum(far, 0.999 * (first + second))
    front = np.cross(along, sideways)
    front /= np.linalg.norm(front, axis=1, keepdims=True)
    near = (first**2 - second**2 + far**2) / (2 * far)
    middle = root + near * along + np.sqrt(first**2 - near**2) * front
    return middle, root + far * along
