"""Tasks of the default recipe: many actions at once."""

from __future__ import annotations

import numpy as np
import torch
from torch import Tensor

from actioncli.clips.prepare import Preparation
from actioncli.training.data import TrainingSet
from actioncli.training.motions import bone_lengths, directions

# Examples of a task: one enrols, one asks.
EXAMPLES = 2


class TaskSource:
    """Draws tasks from a training set."""

    def __init__(self, data: TrainingSet, preparation: Preparation) -> None:
        """Prepare all clips once.

        Classes count by the root of how many their collection has, so that a large collection
        does not drown the others; those whose classes one person performs once lend variety and
        count a third.
        """
        self._bones = directions(list(data.clips), preparation)
        self._lengths = bone_lengths(list(data.clips), preparation)
        self._people: dict[int, list[np.ndarray]] = {}
        weight: dict[int, float] = {}
        self._of_source: dict[int, list[int]] = {}
        for label, rows in data.members.items():
            people = data.subjects[rows]
            self._people[label] = [rows[people == person] for person in np.unique(people)]
            self._of_source.setdefault(int(data.collections[rows[0]]), []).append(label)
        self._sources: dict[int, float] = {}
        for source, labels in self._of_source.items():
            several = np.mean([len(self._people[label]) > 1 for label in labels]) > 0.5
            share = 1.0 if several else 0.35
            if len(labels) > 1:  # one class alone makes no task
                self._sources[source] = share * len(labels) ** 0.5
            weight |= dict.fromkeys(labels, share / len(labels) ** 0.5)
        self._weight = weight

    def draw(self, ways: int, rng: np.random.Generator) -> tuple[Tensor, Tensor]:
        """A task of W ways, fewer where there are fewer classes.

        Half of the tasks take their classes from one collection, if one has several.

        Returns:
            Clips, bone directions (2, W, 64, 14, 3): the first of a way enrols it, the second
            asks, performed by someone else where the class has others. Their bones' lengths
            (2, W, 14).
        """
        labels = list(self._weight)
        if rng.random() < 0.5 and self._sources:
            sources = list(self._sources)
            chances = np.array(list(self._sources.values()))
            labels = self._of_source[int(rng.choice(sources, p=chances / chances.sum()))]
        chances = np.array([self._weight[label] for label in labels])
        ways = min(ways, len(labels))
        chosen = rng.choice(labels, ways, replace=False, p=chances / chances.sum()).tolist()
        clips = np.array([self._clips(label, rng) for label in chosen]).T
        return self._bones[clips], self._lengths[clips]

    def _clips(self, label: int, rng: np.random.Generator) -> list[int]:
        """Clips of different performers, if there are any."""
        people = self._people[label]
        order = rng.permutation(len(people))
        return [int(rng.choice(people[order[k % len(people)]])) for k in range(EXAMPLES)]


def alike(bones: Tensor) -> Tensor:
    """Pairs of different ways that are practically the same motion, and so teach nothing: on plain
    poses a query's distance to the other way is below 0.35 of that to its own.

    Args:
        bones: (2, W, 64, 14, 3).

    Returns:
        (W, W) bool, query by support.
    """
    poses = bones[:, :, 2::4].flatten(2)
    apart = torch.cdist(poses[1], poses[0])
    same = apart < 0.35 * apart.diagonal()[:, None]
    return same & ~torch.eye(len(same), dtype=torch.bool)
