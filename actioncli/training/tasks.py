"""Tasks for the part transformer: many actions at once, and negatives made of each."""

from __future__ import annotations

import re
from dataclasses import dataclass

import numpy as np
import torch
from torch import Generator, Tensor

from actioncli.clips.parts import prepare_parts
from actioncli.clips.prepare import Preparation
from actioncli.training.augment import Batch, mirrored
from actioncli.training.data import TrainingSet
from actioncli.training.negatives import SHARES, apart, backwards, negatives

# Of two performances of one action, how much nearer than these a negative may not be to the
# recording that it was made of: nearer, the change left the motion as it was.
CHANGED = 0.4
# Two actions of a task that are nearer than this share of what performances of one action are
# apart are taken for one motion.
_ALIKE = 0.4


@dataclass(frozen=True, slots=True)
class Task:
    """W actions.

    Attributes:
        supports, queries: W clips each, of different performers where there are several.
        same: (W, W) pairs of ways that are one motion and teach nothing.
        negatives: W clips made of `supports` or `queries`.
        changed: (W,) which of the negatives are another motion.
    """

    supports: Batch
    queries: Batch
    same: Tensor
    negatives: Batch
    changed: Tensor


class Tasks:
    """Draws tasks from a training set.

    Attributes:
        clips: all of them, prepared.
        typical: how far performances of one action are apart, the median over classes.
    """

    def __init__(self, data: TrainingSet, preparation: Preparation, device: str = "cpu") -> None:
        """Prepare all clips once.

        Classes count by the root of how many their collection has, so that a large collection
        does not drown the others; collections in which most are performed once count a third.
        """
        prepared = prepare_parts(data.clips, preparation)
        self.clips = Batch(*(torch.from_numpy(part).to(device) for part in prepared))
        self._people: dict[int, list[np.ndarray]] = {}
        self._motion: dict[int, str] = {}
        self._weight: dict[int, float] = {}
        of_source: dict[int, list[int]] = {}
        for label, rows in data.members.items():
            people = data.subjects[rows]
            self._people[label] = [rows[people == person] for person in np.unique(people)]
            self._motion[label] = _words(data.classes[label])
            of_source.setdefault(int(data.collections[rows[0]]), []).append(label)
        self._of_source = list(of_source.values())
        shares = []
        for labels in self._of_source:
            several = sum(len(data.members[label]) for label in labels) > 2 * len(labels)
            share = 1.0 if several else 0.35
            shares.append(share * len(labels) ** 0.5 if len(labels) > 4 else 0.0)
            self._weight |= dict.fromkeys(labels, share / len(labels) ** 0.5)
        self._sources = np.array(shares) / max(sum(shares), 1e-9)
        self.typical = self._median_apart(data)

    def _median_apart(self, data: TrainingSet) -> Tensor:
        """How far performances of one action are apart, the median over classes."""
        rng = np.random.default_rng(0)
        pairs = [rng.choice(rows, 2, replace=False) for rows in data.members.values()
                 if len(rows) > 1]  # fmt: skip
        one, other = np.array(pairs).T
        return apart(self.clips.rows(one), self.clips.rows(other)).median()

    def draw(self, ways: int, rng: np.random.Generator, chance: Generator) -> Task:
        """A task of W ways, fewer where there are fewer classes.

        Half of the tasks take their classes from one collection. Half are seen in the mirror and
        one in eight backwards, which makes actions that nobody recorded.
        """
        labels = [label for of_source in self._of_source for label in of_source]
        if rng.random() < 0.5 and self._sources.sum() > 0:
            labels = self._of_source[int(rng.choice(len(self._sources), p=self._sources))]
        chances = np.array([self._weight[label] for label in labels])
        order = rng.choice(labels, len(labels), replace=False, p=chances / chances.sum())
        # One motion has one name in a task: `walk` of two collections is not two actions.
        chosen = list({self._motion[label]: label for label in order[::-1].tolist()}.values())
        chosen = [label for label in order.tolist() if label in set(chosen)][:ways]
        supports, queries = np.array([self._pair(label, rng) for label in chosen]).T
        pair = [self.clips.rows(supports), self.clips.rows(queries)]
        if rng.random() < 0.5:
            pair = [mirrored(clips) for clips in pair]
        if rng.random() < 0.125:
            pair = [backwards(clips) for clips in pair]
        return self._task(pair[0], pair[1], chance)

    def _task(self, supports: Batch, queries: Batch, chance: Generator) -> Task:
        w, device = len(supports.bones), supports.bones.device
        flat = [
            torch.cat([clips.bones[:, 1::4].flatten(1), 0.6 * clips.hands[:, 1::4].flatten(1)], 1)
            for clips in (queries, supports)
        ]
        between = torch.cdist(flat[0], flat[1])
        own = between.diagonal()
        typical = own[own > 0].median() if bool((own > 0).any()) else between.median()
        same = between < _ALIKE * torch.where(own > 0, own, typical)[:, None]
        same = (same | same.T) & ~torch.eye(w, dtype=torch.bool, device=device)
        shares = torch.tensor(SHARES, device=device)
        kind = torch.multinomial(shares, w, replacement=True, generator=chance)
        of_query = torch.rand(w, generator=chance, device=device) < 0.5
        source = Batch(
            *(
                torch.where(of_query.reshape(-1, *[1] * (q.ndim - 1)), q, s)
                for q, s in zip(queries, supports, strict=True)
            )
        )
        made = negatives(source, kind, chance)
        # Of another's performance the negative must also be farther than that performance was.
        far = apart(made, source) > CHANGED * self.typical
        far &= apart(made, supports) > apart(queries, supports)
        return Task(supports, queries, same, made, far)

    def _pair(self, label: int, rng: np.random.Generator) -> list[int]:
        """Clips of different performers; one recording twice now and then, or if there is one."""
        people = self._people[label]
        if rng.random() < 0.15:
            row = int(rng.choice(people[rng.integers(len(people))]))
            return [row, row]
        if len(people) > 1:
            first, second = rng.permutation(len(people))[:2]
            return [int(rng.choice(people[first])), int(rng.choice(people[second]))]
        rows = people[0]
        return [int(row) for row in rng.choice(rows, 2, replace=len(rows) < 2)]


def _words(name: str) -> str:
    """What a class is called, without collection and number of the recording or of a window:
    `a/002_01_walk#3` is `walk`."""
    return re.sub(r"^[\d_]+(?=[^\d_#])|#\d+$", "", name.rpartition("/")[2].lower())
