"""Tasks of the default recipe: many actions at once, recorded ones and ones that nobody recorded.

What keeps a few-shot model from generalising is how few classes there are to learn from. So
classes are made: a class seen in the mirror or backwards is another class, and so are the arms
of one class on the body of another, put together by the same rule for every performer.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor

from actioncli.clips.prepare import Preparation
from actioncli.training.data import TrainingSet
from actioncli.training.motions import (
    LEFT_ARM,
    LEFT_LEG,
    RIGHT_ARM,
    RIGHT_LEG,
    bone_lengths,
    bones_of,
    directions,
    mirrored,
)

# What one class may lend another.
_LIMBS = (
    LEFT_ARM,
    RIGHT_ARM,
    LEFT_ARM + RIGHT_ARM,
    LEFT_LEG + RIGHT_LEG,
    LEFT_LEG,
    RIGHT_LEG,
    LEFT_LEG + RIGHT_LEG + bones_of("lhip", "rhip"),
    LEFT_ARM + LEFT_LEG,
)
_COMPOSED, _MIRRORED, _REVERSED = 0.3, 0.5, 0.1
# How often limbs are lent between actions of the same task, which makes them hard to tell apart.
_HARD = 0.7
# Examples of a task: one enrols, one asks.
EXAMPLES = 2


@dataclass(frozen=True, slots=True)
class Way:
    """How the clips of one action of a task are made: a class, and what happens to it."""

    base: int
    lender: int | None
    limbs: int
    lender_mirrored: bool
    mirrored: bool
    reversed: bool


class TaskSource:
    """Draws tasks from a training set."""

    def __init__(self, data: TrainingSet, preparation: Preparation, made_classes: bool) -> None:
        """Prepare all clips once.

        Classes count by the root of how many their collection has, so that a large collection
        does not drown the others; those whose classes one person performs once lend variety and
        count a third. Without `made_classes` ways are recorded classes, and tasks of few classes
        have few ways.
        """
        self._bones = directions(list(data.clips), preparation)
        self._lengths = bone_lengths(list(data.clips), preparation)
        self._made = made_classes
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

    def draw(self, ways: int, rng: np.random.Generator) -> tuple[list[Way], Tensor, Tensor]:
        """A task.

        Half of the tasks take their classes from one collection, if one has several.

        Returns:
            The ways and their clips, bone directions (2, ways, 64, 14, 3): the first of a way
            enrols it, the second asks, performed by someone else where the class has others.
            Their bones' lengths (2, ways, 14), those of the clips that lent no limbs.
        """
        labels = list(self._weight)
        if rng.random() < 0.5 and self._sources:
            sources = list(self._sources)
            chances = np.array(list(self._sources.values()))
            labels = self._of_source[int(rng.choice(sources, p=chances / chances.sum()))]
        chances = np.array([self._weight[label] for label in labels])
        order = rng.choice(labels, len(labels), replace=False, p=chances / chances.sum()).tolist()
        chosen: list[Way] = []
        taken: list[int] = []
        lending = self._made and len(order) > 1
        while len(chosen) < ways:
            flags = rng.random(3) < (_MIRRORED, _REVERSED, 0.3)
            mirror, backwards, lender_mirrored = (bool(flag and self._made) for flag in flags)
            if len(taken) < len(order) and (not lending or rng.random() >= _COMPOSED):
                base = order[len(taken)]
                taken.append(base)
                chosen.append(Way(base, None, 0, False, mirror, backwards))
            elif not lending:
                break
            else:
                near = taken if len(taken) > 1 and rng.random() < _HARD else order
                base, lender = rng.choice(near, 2, replace=False).tolist()
                limbs = int(rng.integers(len(_LIMBS)))
                chosen.append(Way(base, lender, limbs, lender_mirrored, mirror, backwards))
        performed = [self._perform(way, rng) for way in chosen]
        bones, lengths = (torch.stack(parts, dim=1) for parts in zip(*performed, strict=True))
        return chosen, bones, lengths

    def _perform(self, way: Way, rng: np.random.Generator) -> tuple[Tensor, Tensor]:
        clips = self._clips(way.base, rng)
        bones = self._bones[clips]
        if way.lender is not None:
            lent = self._bones[self._clips(way.lender, rng)]
            lent = mirrored(lent) if way.lender_mirrored else lent
            bones = bones.clone()
            bones[:, :, _LIMBS[way.limbs]] = lent[:, :, _LIMBS[way.limbs]]
        if way.mirrored:
            bones = mirrored(bones)
        return bones.flip(1) if way.reversed else bones, self._lengths[clips]

    def _clips(self, label: int, rng: np.random.Generator) -> list[int]:
        """Clips of different performers, if there are any."""
        people = self._people[label]
        order = rng.permutation(len(people))
        return [int(rng.choice(people[order[k % len(people)]])) for k in range(EXAMPLES)]


def alike(ways: list[Way], bones: Tensor) -> Tensor:
    """Pairs of different ways that are practically the same motion, and so teach nothing.

    A query's distance to another way, on plain poses, is compared with that to its own: below
    0.35 of it the two are the same, below 0.7 if they were made of the same class.

    Args:
        ways: W of them.
        bones: (2, W, 64, 14, 3).

    Returns:
        (W, W) bool, query by support.
    """
    poses = bones[:, :, 2::4].flatten(2)
    apart = torch.cdist(poses[1], poses[0])
    parts = [{way.base, way.lender} - {None} for way in ways]
    related = torch.tensor([[bool(a & b) for b in parts] for a in parts])
    limit = torch.where(related, 0.7, 0.35) * apart.diagonal()[:, None]
    same = apart < limit
    return same & ~torch.eye(len(ways), dtype=torch.bool)
