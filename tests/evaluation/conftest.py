"""A small collection of made-up motions that a plain method can tell apart."""

import numpy as np
import pytest
from clips.bodies import STANCE

from actioncli.clips.clip import Clip
from actioncli.clips.collection import Collection
from actioncli.clips.skeleton import DEFAULT_JOINTS


def motion(action: int, rng: np.random.Generator, tempo: float = 1.0) -> Clip:
    """A clip of an action: which limbs swing, along which axis and how often, is its number."""
    joints = np.tile([STANCE[name] for name in DEFAULT_JOINTS], (40, 1, 1))
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
