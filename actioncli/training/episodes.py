"""Episodes: small open-set tasks drawn from the training classes.

What step `n` of a run with seed `s` draws depends on nothing but (s, n), so a run that is
resumed draws what an uninterrupted one would have drawn.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from actioncli.training.data import Indices, TrainingSet, query_of


@dataclass(frozen=True, slots=True, eq=False)
class Episodes:
    """B episodes of K actions each, as clip numbers.

    Attributes:
        support: (B, K) one clip per action.
        queries: (B, Q).
        targets: (B, Q) the action's place among the K, or -1 for a query of none of them.
    """

    support: Indices
    queries: Indices
    targets: Indices


def draw_episodes(data: TrainingSet, batch: int, ways: int, rng: np.random.Generator) -> Episodes:
    """Draw `batch` episodes: one known query for each way, and as many unknown ones.

    Every other episode takes its actions from one collection, where nothing but the motion
    tells them apart; the others mix collections. Queries come from another performer than the
    support clip's wherever the class has one.
    """
    usable = {c: rows for c, rows in data.members.items() if len(rows) > 1}
    of_source: dict[int, list[int]] = {}
    for c, rows in usable.items():
        of_source.setdefault(int(data.collections[rows[0]]), []).append(c)
    large = [classes for classes in of_source.values() if len(classes) > ways]
    everything = list(usable)
    support = np.empty((batch, ways), np.int64)
    queries = np.empty((batch, 2 * ways), np.int64)
    targets = np.full((batch, 2 * ways), -1, np.int64)
    chances = np.array([len(classes) for classes in large], float)
    for b in range(batch):
        within = large and b % 2 == 0
        pool = large[rng.choice(len(large), p=chances / chances.sum())] if within else everything
        classes = rng.permutation(pool)
        known, others = classes[:ways], classes[ways:]
        for way, c in enumerate(known):
            support[b, way] = rng.choice(usable[int(c)])
            queries[b, way] = query_of(data, usable[int(c)], support[b, way], rng)
            targets[b, way] = way
        for way, c in enumerate(rng.choice(others, ways)):
            queries[b, ways + way] = rng.choice(usable[int(c)])
    return Episodes(support, queries, targets)
