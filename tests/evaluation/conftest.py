"""A small collection of made-up motions that a plain method can tell apart."""

from __future__ import annotations

import numpy as np
import pytest

from actioncli.clips.clip import Clip
from actioncli.clips.collection import Collection
from actioncli.clips.skeleton import DEFAULT_JOINTS

# A person who stands and faces the sensor, metres.
STANDING = {
    "pelv": (0, 0.95, 2.5), "lhip": (-0.1, 0.93, 2.5), "rhip": (0.1, 0.93, 2.5),
    "lkne": (-0.1, 0.5, 2.5), "rkne": (0.1, 0.5, 2.5), "lank": (-0.1, 0.1, 2.5),
    "rank": (0.1, 0.1, 2.5), "neck": (0, 1.45, 2.5), "head": (0, 1.65, 2.5),
    "lsho": (-0.18, 1.42, 2.5), "rsho": (0.18, 1.42, 2.5), "lelb": (-0.22, 1.15, 2.5),
    "relb": (0.22, 1.15, 2.5), "lwri": (-0.24, 0.9, 2.5), "rwri": (0.24, 0.9, 2.5),
}  # fmt: skip


def motion(action: int, rng: np.random.Generator, tempo: float = 1.0) -> Clip:
    """A clip of an action: which limbs swing, along which axis and how often, is its number."""
    joints = np.tile([STANDING[name] for name in DEFAULT_JOINTS], (40, 1, 1))
    limb = ("rwri", "lwri", "rank", "lank")[action % 4]
    axis, swings = (action // 4) % 3, 1 + action // 12
    time = np.linspace(0, 1, 40) ** tempo
    joints[:, DEFAULT_JOINTS.index(limb), axis] += 0.4 * np.sin(2 * np.pi * swings * time)
    joints *= rng.uniform(0.85, 1.15)
    joints += rng.normal(0, 0.01, joints.shape)
    return Clip(joints, DEFAULT_JOINTS, 20.0, source=f"action {action}")


def collection(
    name: str = "toy", classes: int = 6, people: int = 4, clips: int = 2, seed: int = 0
) -> Collection:
    """`people` performers who show each of `classes` actions `clips` times."""
    rng = np.random.default_rng(seed)
    rows = [(a, p) for a in range(classes) for p in range(people) for _ in range(clips)]
    return Collection(
        clips=tuple(motion(a, rng, tempo=1 + 0.05 * p) for a, p in rows),
        labels=tuple(f"action {a}" for a, _ in rows),
        subjects=tuple(f"person {p}" for _, p in rows),
        name=name,
    )


@pytest.fixture(scope="session")
def toy() -> Collection:
    return collection()
