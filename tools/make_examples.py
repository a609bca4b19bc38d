"""Make the clips in `examples/`: synthetic performers, as people save the output of MeTRAbs.

    python tools/make_examples.py [FOLDER]

Needs numpy only. The same seed gives the same bytes, so what is committed can be checked.
"""

from __future__ import annotations

import sys
import zlib
from collections.abc import Callable
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

import numpy as np
from puppet import JOINT_NAMES, Arm, Body, Floats, Motion, joint_positions, rotation

SEED = 7
IDLE = 0.35  # seconds of standing before and after


@dataclass(frozen=True)
class Performer:
    """Who moves, how, and where the camera stands."""

    body: Body
    tempo: float = 1.0  # above 1 is quicker
    reach: float = 1.0  # above 1 is a larger movement
    heading: float = 0.0  # degrees to the performer's left of facing the camera
    fps: float = 30.0
    distance: float = 3.0
    camera_height: float = 1.3
    camera_pitch: float = 0.0  # degrees, down


PERFORMERS = {
    "ada": Performer(Body(1.66, hips=1.05), heading=4, distance=2.9),
    "ben": Performer(
        Body(1.87, legs=1.02, arms=1.03, shoulders=1.1),
        tempo=0.85, reach=0.95, heading=-28, fps=25, distance=3.6, camera_pitch=4,
    ),
    "cleo": Performer(
        Body(1.24, legs=0.96, arms=0.96, head=1.2),
        tempo=1.15, reach=1.06, heading=14, distance=2.6, camera_height=1.0, camera_pitch=3,
    ),
    "dev": Performer(
        Body(1.74, legs=0.98, shoulders=1.05),
        tempo=1.05, reach=1.0, heading=35, fps=24, distance=3.2, camera_height=1.5, camera_pitch=6,
    ),
}  # fmt: skip


def ease(time: Floats, *keys: tuple[float, float]) -> Floats:
    """A curve through (seconds, value) keys that comes to rest at each of them.

    Between two keys it is the minimum-jerk profile 10 s^3 - 15 s^4 + 6 s^5 (Flash and Hogan,
    1985), the shape of people's own reaching movements.
    """
    curve = np.full(time.shape, keys[0][1], dtype=float)
    for (start, before), (end, after) in pairwise(keys):
        s = np.clip((time - start) / (end - start), 0, 1)
        curve += (after - before) * (10 * s**3 - 15 * s**4 + 6 * s**5)
    return curve


def hop(time: Floats, start: float, end: float) -> Floats:
    """The parabola of a flight: 0 at both ends, 1 in the middle."""
    s = np.clip((time - start) / (end - start), 0, 1)
    return 4 * s * (1 - s)


class Stage:
    """The clock of one performance: action time (before tempo) and the motion it fills."""

    def __init__(self, performer: Performer, length: float) -> None:
        frames = round((length / performer.tempo + 2 * IDLE) * performer.fps)
        self.performer = performer
        self.stature = performer.body.stature
        self.reach = performer.reach
        self.seconds = np.arange(frames) / performer.fps
        self.time = (self.seconds - IDLE) * performer.tempo
        self.motion = Motion(frames)

    def ease(self, *keys: tuple[float, float]) -> Floats:
        return ease(self.time, *keys)


def wave(performer: Performer, side: str) -> Stage:
    """The forearm up beside the head, three swings to and fro."""
    stage = Stage(performer, 3.5)
    arm, other = stage.motion.arms[side], -1.0 if side == "l" else 1.0
    up = stage.ease((0, 0), (0.75, 1), (2.75, 1), (3.5, 0))
    late = stage.ease((0.08, 0), (0.7, 1), (2.8, 1), (3.45, 0))
    swing = stage.ease((0.6, 0), (0.95, 1), (2.5, 1), (2.9, 0)) * np.sin(
        2 * np.pi * 1.5 * (stage.time - 0.7)
    )
    arm.lift += up * (83 + 8 * stage.reach) + 5 * swing
    arm.plane += up * 10
    arm.elbow += late * 78 - 27 * stage.reach * swing
    arm.roll += -18 * up
    stage.motion.lean += other * 2.5 * up - other * 1.0 * swing
    stage.motion.pelvis[:, 0] += other * 0.006 * stage.stature * up
    stage.motion.gaze += -other * 4 * up
    return stage


def squat(performer: Performer, _: str) -> Stage:
    """Down and up once, arms forward for balance."""
    stage = Stage(performer, 2.9)
    motion = stage.motion
    motion.stance, motion.toes_out = 0.085, 18
    down = stage.ease((0.05, 0), (1.25, 1), (1.5, 1), (2.7, 0))
    motion.pelvis[:, 1] -= 0.225 * stage.reach * stage.stature * down
    motion.pelvis[:, 2] -= 0.075 * stage.stature * down
    motion.tilt += 24 * down
    motion.bend += 20 * down
    motion.nod -= 22 * down
    arms = stage.ease((0, 0), (0.95, 1), (1.6, 1), (2.75, 0))
    for arm in motion.arms.values():
        # Forward of the bent trunk, so that the arms stay about level.
        arm.lift += arms * 112
        arm.plane -= arms * 50
        arm.elbow += arms * 2
    return stage


def jumping_jack(performer: Performer, _: str) -> Stage:
    """Three jumps, feet apart with the arms overhead and back."""
    period, flight, jumps = 1.06, 0.36, 3
    stage = Stage(performer, jumps * period)
    motion = stage.motion
    apart, overhead, air, give = (np.zeros(motion.frames) for _ in range(4))
    for jump in range(jumps):
        for toward, start in ((1.0, jump * period), (-1.0, (jump + 0.5) * period)):
            takeoff, landing = start + 0.12, start + 0.12 + flight
            apart += toward * stage.ease((takeoff, 0), (landing, 1))
            overhead += toward * stage.ease((takeoff - 0.06, 0), (landing + 0.05, 1))
            air += hop(stage.time, takeoff, landing)
            give += stage.ease((start, 0), (takeoff - 0.03, 0.8), (takeoff + 0.09, 0))
            give += stage.ease((landing - 0.03, 0), (landing + 0.07, 1), (landing + 0.2, 0))
    motion.pelvis[:, 1] += stage.stature * (0.035 * air - 0.022 * give - 0.022 * apart)
    motion.bend += 5 * give
    motion.tilt += 4 * give
    for side, leg in motion.legs.items():
        sign = 1.0 if side == "l" else -1.0
        leg.foot[:, 0] += sign * 0.115 * stage.reach * stage.stature * apart
        leg.foot[:, 1] += 0.040 * stage.stature * air
        leg.pitch -= 22 * air
    for arm in motion.arms.values():
        arm.lift += overhead * min(150 * stage.reach, 158)
        arm.plane += overhead * 24
        arm.elbow += overhead * 12
    return stage


def kick(performer: Performer, side: str) -> Stage:
    """A forward kick: the leg back, out, knee in, down."""
    stage = Stage(performer, 2.1)
    motion, leg = stage.motion, stage.motion.legs[side]
    sign = 1.0 if side == "l" else -1.0
    across = "r" if side == "l" else "l"
    leg.free += stage.ease((0.15, 0), (0.5, 1), (1.55, 1), (1.95, 0))
    leg.flexion += stage.ease((0.15, 0), (0.6, -14), (0.98, 68 * stage.reach), (1.35, 42), (1.9, 0))
    leg.knee += stage.ease((0.1, 6), (0.62, 48), (0.98, 12), (1.35, 62), (1.9, 6))
    leg.pitch -= stage.ease((0.6, 0), (0.95, 18), (1.4, 0))
    weight = stage.ease((0, 0), (0.45, 1), (1.65, 1), (2.1, 0))
    out = stage.ease((0.55, 0), (0.98, 1), (1.5, 0))
    motion.pelvis[:, 0] -= sign * 0.047 * stage.stature * weight
    motion.pelvis[:, 1] -= 0.010 * stage.stature * weight
    motion.lean -= sign * 2 * weight
    motion.tilt -= 7 * out
    motion.bend -= 5 * out
    motion.hips_turn -= sign * 10 * out
    motion.nod += 10 * out
    for name, forward in ((across, 1.0), (side, -0.6)):
        arm: Arm = motion.arms[name]
        arm.lift += 12 * weight + 20 * abs(forward) * out
        arm.plane += -50 * forward * out
        arm.elbow += 16 * weight
    return stage


def bow(performer: Performer, _: str) -> Stage:
    """Forward from the hips and up again, arms at the sides."""
    stage = Stage(performer, 2.9)
    motion = stage.motion
    down = stage.ease((0.05, 0), (1.15, 1), (1.7, 1), (2.8, 0))
    motion.pelvis[:, 2] -= 0.055 * stage.stature * down
    motion.pelvis[:, 1] -= 0.008 * stage.stature * down
    motion.tilt += 30 * stage.reach * down
    motion.bend += 34 * stage.reach * down
    motion.nod += 16 * down
    for arm in motion.arms.values():
        arm.lift += 30 * down
        arm.plane -= 44 * down
    return stage


def punch(performer: Performer, side: str) -> Stage:
    """From a guard of both fists, one fist out and back, twice."""
    stage = Stage(performer, 2.6)
    motion = stage.motion
    sign = 1.0 if side == "l" else -1.0
    across = "r" if side == "l" else "l"
    motion.legs[across].foot[:, 2] += 0.08 * stage.stature
    motion.legs[side].foot[:, 2] -= 0.06 * stage.stature
    motion.pelvis[:, 1] -= 0.012 * stage.stature
    guard = stage.ease((0, 0), (0.5, 1), (2.1, 1), (2.6, 0))
    out = stage.ease((0.6, 0), (0.86, 1), (1.2, 0)) + stage.ease((1.3, 0), (1.56, 1), (1.95, 0))
    for arm in motion.arms.values():
        arm.lift += 18 * guard
        arm.plane -= 42 * guard
        arm.elbow += 112 * guard
    arm = motion.arms[side]
    arm.lift += 60 * out
    arm.plane -= 22 * out
    arm.elbow -= 112 * stage.reach * out * 0.97
    motion.turn -= sign * 24 * stage.reach * out
    motion.hips_turn -= sign * 10 * out
    motion.pelvis[:, 2] += 0.03 * stage.stature * out
    motion.gaze += sign * 18 * out
    return stage


# Action, performer, what moves, on which side.
CLIPS: tuple[tuple[str, str, Callable[[Performer, str], Stage], str], ...] = (
    ("wave_right", "ada", wave, "r"),
    ("wave_right", "ben", wave, "r"),
    ("wave_right", "cleo", wave, "r"),
    ("wave_left", "ada", wave, "l"),
    ("wave_left", "dev", wave, "l"),
    ("squat", "ada", squat, ""),
    ("squat", "ben", squat, ""),
    ("squat", "cleo", squat, ""),
    ("jumping_jack", "ada", jumping_jack, ""),
    ("jumping_jack", "ben", jumping_jack, ""),
    ("jumping_jack", "dev", jumping_jack, ""),
    ("kick_right", "ada", kick, "r"),
    ("kick_right", "cleo", kick, "r"),
    ("bow", "ben", bow, ""),
    ("punch_right", "dev", punch, "r"),
)


def fidget(stage: Stage, random: np.random.Generator) -> None:
    """What a person does all the while: sway, breathe, hold the arms a little differently."""
    motion, seconds = stage.motion, stage.seconds

    def drift(size: float, slowest: float = 0.25, fastest: float = 0.9) -> Floats:
        rates = random.uniform(slowest, fastest, 3)
        phases = random.uniform(0, 2 * np.pi, 3)
        waves = np.sin(2 * np.pi * rates * seconds[:, None] + phases)
        return np.asarray(size * waves.mean(axis=1) * np.sqrt(3))

    motion.pelvis[:, 0] += 0.003 * stage.stature * drift(1)
    motion.pelvis[:, 2] += 0.003 * stage.stature * drift(1)
    for angle, size in (("lean", 0.8), ("bend", 0.8), ("turn", 1.0), ("nod", 1.5), ("gaze", 2.5)):
        setattr(motion, angle, getattr(motion, angle) + drift(size))
    for arm in motion.arms.values():
        arm.lift += random.uniform(-2, 3) + drift(1.2)
        arm.plane += random.uniform(-8, 8)
        arm.elbow += random.uniform(-5, 8) + drift(1.5)


def to_camera(joints: Floats, performer: Performer) -> Floats:
    """Body axes in metres to camera axes (x right, y down, z away) in millimetres."""
    turned = joints @ rotation("y", performer.heading).T
    # Facing the camera, the performer's left is at the right of the picture.
    level = turned * [1, -1, -1] + [0, performer.camera_height, performer.distance]
    return np.asarray(1000 * level @ rotation("x", performer.camera_pitch).T)


def measured(joints: Floats, random: np.random.Generator) -> Floats:
    """What a pose estimator would make of it: 4 mm of jitter that lingers for some frames."""
    keep = 0.75
    jitter = random.normal(0, 4.0, joints.shape)
    for frame in range(1, len(jitter)):
        jitter[frame] = keep * jitter[frame - 1] + np.sqrt(1 - keep**2) * jitter[frame]
    # Whole bodies err together, and mostly in depth.
    jitter[..., 2] += 6 * np.sin(2 * np.pi * 0.4 * np.arange(len(jitter)) / 30 + 1)[:, None]
    return joints + jitter


def make(action: str, name: str, perform: Callable[[Performer, str], Stage], side: str) -> Floats:
    """One clip: (T, 30, 3) millimetres in camera axes, to a tenth of a millimetre."""
    random = np.random.default_rng([SEED, zlib.crc32(f"{action}/{name}".encode())])
    stage = perform(PERFORMERS[name], side)
    fidget(stage, random)
    joints = joint_positions(stage.performer.body, stage.motion)
    return np.round(measured(to_camera(joints, stage.performer), random), 1)


def main(folder: Path) -> None:
    for action, name, perform, side in CLIPS:
        path = folder / action / f"{name}.npz"
        path.parent.mkdir(parents=True, exist_ok=True)
        poses = make(action, name, perform, side)
        # Not compressed: the bytes then do not depend on the version of a compressor.
        np.savez(
            path,
            poses3d=poses.astype(np.float32),
            joint_names=np.array(JOINT_NAMES),
            fps=np.float32(PERFORMERS[name].fps),
        )
        seconds = len(poses) / PERFORMERS[name].fps
        print(f"{path}  {len(poses)} frames, {seconds:.1f} s, {path.stat().st_size / 1000:.0f} kB")


if __name__ == "__main__":
    main(Path(sys.argv[1]) if len(sys.argv) > 1 else Path(__file__).parent.parent / "examples")
