"""A small world of actions: each class swings its own joints, each performer in his own way."""

from __future__ import annotations

import numpy as np
import pytest
import torch

from actioncli.clips.clip import Clip
from actioncli.clips.skeleton import DEFAULT_JOINTS
from actioncli.training.data import TrainingSet

# Tests run side by side: threads of small products would only wait for one another.
torch.set_num_threads(1)

REST = np.array(
    [
        (0, 1, 0), (-0.1, 1, 0), (0.1, 1, 0), (-0.1, 0.5, 0), (0.1, 0.5, 0),
        (-0.1, 0.1, 0), (0.1, 0.1, 0), (0, 1.5, 0), (0, 1.7, 0), (-0.2, 1.5, 0),
        (0.2, 1.5, 0), (-0.25, 1.2, 0), (0.25, 1.2, 0), (-0.25, 0.95, 0), (0.25, 0.95, 0),
    ]
)  # fmt: skip


def perform(action: int, performer: int, rng: np.random.Generator) -> Clip:
    """One performance of 30 to 50 frames."""
    of_action = np.random.default_rng(action)
    swing = of_action.normal(0, 0.15, (3, 15, 3))
    size = 0.9 + 0.05 * performer
    time = np.linspace(0, 1, int(rng.integers(30, 51)))[:, None, None]
    moved = sum(swing[k] * np.sin(np.pi * (k + 1) * time) for k in range(3))
    return Clip(size * (REST + moved) + rng.normal(0, 0.005, (len(time), 15, 3)), DEFAULT_JOINTS)


def small_world(collections: int = 2, classes: int = 8, people: int = 3) -> TrainingSet:
    rng = np.random.default_rng(0)
    rows = [
        (c * classes + a, c * people + p, c)
        for c in range(collections)
        for a in range(classes)
        for p in range(people)
        for _ in range(2)
    ]
    labels, subjects, sources = (np.array(column, np.int64) for column in zip(*rows, strict=True))
    clips = tuple(perform(a, p, rng) for a, p, _ in rows)
    names = tuple(f"world{c}/{a}" for c in range(collections) for a in range(classes))
    return TrainingSet(clips, labels, subjects, sources, names)


@pytest.fixture(scope="session")
def world() -> TrainingSet:
    return small_world()
