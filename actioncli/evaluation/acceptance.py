"""Which actions are taken for which: a support set of one class against queries of all."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from actioncli.evaluation.episodes import Protocol
from actioncli.evaluation.protocol import compare_episode
from actioncli.evaluation.scorer import Scorer
from actioncli.evaluation.splits import Splits
from actioncli.evaluation.task import Progress, Steps, Task, possible

if TYPE_CHECKING:
    from actioncli.clips.collection import Collection


@dataclass(frozen=True, slots=True, eq=False)
class Acceptance:
    """The second table of arXiv 2209.04288.

    Attributes:
        collection: its name.
        classes: the C classes of rows and columns.
        accepted: (C, C), queries of class j that a support set of class i alone accepts.
        asked: (C, C), queries of class j that were put to one.
    """

    collection: str
    classes: tuple[str, ...]
    accepted: NDArray[np.int64]
    asked: NDArray[np.int64]

    @property
    def rate(self) -> NDArray[np.float64]:
        """(C, C) share accepted; NaN where nothing was asked. A perfect one is the identity."""
        with np.errstate(invalid="ignore"):
            return self.accepted / self.asked

    def as_json(self) -> dict[str, Any]:
        """`collection`, `classes`, and row by row `rate` (null where unasked) and `asked`."""
        return {
            "collection": self.collection,
            "classes": list(self.classes),
            "rate": [[None if np.isnan(r) else float(r) for r in row] for row in self.rate],
            "asked": self.asked.tolist(),
        }


def acceptance(
    scorer: Scorer,
    collections: Sequence[Collection],
    *,
    shots: int = 1,
    episodes: int = 100,
    protocol: Protocol = Protocol.CROSS_PERSON,
    tau: float = 0.5,
    seed: int = 0,
    splits: Splits | None = None,
    progress: Progress | None = None,
) -> list[Acceptance]:
    """Enrol each class alone, in episodes, and ask it queries of every class.

    The arguments are those of `evaluate`; collections that cannot be measured are absent.

    Raises:
        ClipError: not one collection can be measured.
        UsageError: the splits do not fit the collections.
    """
    tasks, _ = possible(
        collections, lambda collection: Task.of(collection, splits, protocol, shots, seed)
    )
    step = Steps(progress, sum(len(task.clips) + episodes for task in tasks))
    found = []
    for task in tasks:
        embedded = task.embed(scorer, step)
        table = Table(task.name, task.classes)
        for number in range(episodes):
            episode = task.sampler.one_against_all(number)
            _, confidence = compare_episode(scorer, embedded, episode)
            shown = [episode.labels[target] for target in episode.target]
            table.add(episode.labels, shown, confidence > tau)
            step(f"{task.name}: acceptance")
        found.append(table.acceptance())
    return found


class Table:
    """Counts accepted queries."""

    def __init__(self, collection: str, classes: Sequence[str]) -> None:
        """Start with none."""
        self._collection = collection
        self._classes = tuple(classes)
        self._accepted = np.zeros((len(classes), len(classes)), np.int64)
        self._asked = np.zeros_like(self._accepted)

    def add(
        self, enrolled: Sequence[str], shown: Sequence[str], accepted: NDArray[np.bool_]
    ) -> None:
        """Count queries.

        Args:
            enrolled: K classes, each a support set of its own.
            shown: (Q,) class that each query shows.
            accepted: (Q, K) whether the support set accepts the query.
        """
        rows = [self._classes.index(label) for label in enrolled]
        columns = [self._classes.index(label) for label in shown]
        np.add.at(self._accepted, np.ix_(rows, columns), accepted.T)
        np.add.at(self._asked, np.ix_(rows, columns), 1)

    def acceptance(self) -> Acceptance:
        """What was counted."""
        return Acceptance(self._collection, self._classes, self._accepted, self._asked)
