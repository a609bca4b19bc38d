"""Curves over all thresholds, and histograms, of the answers of one or several collections."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from actioncli.evaluation.metrics import Floats
from actioncli.evaluation.result import Answers


@dataclass(frozen=True, slots=True, eq=False)
class Pool:
    """N answers in which each collection has the same weight, however many queries it asked.

    Attributes:
        score: (N,) confidence of the nearest action.
        hit: (N,) whether the query shows it.
        known: (N,) whether the query shows any enrolled action.
        weight: (N,), summing to 1.
    """

    score: Floats
    hit: NDArray[np.bool_]
    known: NDArray[np.bool_]
    weight: Floats

    @classmethod
    def of(cls, parts: Sequence[Answers]) -> Pool:
        """Put the answers of collections together."""
        return cls(
            score=np.concatenate([part.score for part in parts]).astype(np.float64),
            hit=np.concatenate([part.hit for part in parts]),
            known=np.concatenate([part.known for part in parts]),
            weight=np.concatenate(
                [np.full(len(part.score), 1 / (len(parts) * len(part.score))) for part in parts]
            ),
        )


@dataclass(frozen=True, slots=True, eq=False)
class Curves:
    """What each threshold would do, strictest first, beginning where nothing is accepted.

    Attributes:
        tau: (M,) queries that score at least this are accepted.
        false_accepts: (M,) share of the unknown queries that are.
        accepted: (M,) share of the known ones that are, under whatever label: ROC.
        named: (M,) share of the known ones that are accepted under the right label: OSCR.
    """

    tau: Floats
    false_accepts: Floats
    accepted: Floats
    named: Floats


def curves(pool: Pool, points: int = 300) -> Curves:
    """ROC and OSCR, at `points` thresholds at most; queries of equal score are passed together."""
    order = np.argsort(-pool.score, kind="stable")
    score, weight = pool.score[order], pool.weight[order]
    known = pool.known[order]
    last_of_equals = np.flatnonzero(np.append(score[1:] != score[:-1], True))

    def share(of: NDArray[np.bool_], total: NDArray[np.bool_]) -> Floats:
        passed = np.cumsum(weight * of)[last_of_equals] / max(float(weight[total].sum()), 1e-12)
        return np.concatenate([[0.0], passed])

    found = (
        np.concatenate([[np.inf], score[last_of_equals]]),
        share(~known, ~known),
        share(known, known),
        share(known & pool.hit[order], known),
    )
    kept = _evenly(found[1] + found[2], points)
    return Curves(*(values[kept] for values in found))


def histogram(pool: Pool, bins: int = 20) -> tuple[Floats, Floats, Floats]:
    """Edges (B + 1,) and the share of known, and of unknown queries in each bin (B,)."""
    edges = np.linspace(0, 1, bins + 1)
    shares = []
    for chosen in (pool.known, ~pool.known):
        counted, _ = np.histogram(pool.score[chosen], edges, weights=pool.weight[chosen])
        shares.append(counted / max(float(counted.sum()), 1e-12))
    return edges, shares[0], shares[1]


def _evenly(travelled: Floats, points: int) -> NDArray[np.intp]:
    """Indices of points that lie about equally far apart on a curve of this length so far."""
    if len(travelled) <= points:
        return np.arange(len(travelled))
    wanted = np.linspace(0, travelled[-1], points)
    return np.unique(np.searchsorted(travelled, wanted).clip(0, len(travelled) - 1))
