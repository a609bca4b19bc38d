"""What an open-set recogniser is measured by, exact where scores are tied.

Throughout, a *known* query shows one of the enrolled actions and an *unknown* one does not. A
query's `score` is the confidence of the action nearest to it, `correct` says whether that action
is the one it shows. It is accepted when its score exceeds the threshold tau.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

Floats = NDArray[np.float64]


def closed_set_accuracy(correct: ArrayLike) -> float:
    """Share of the known queries whose nearest action is the right one, nobody rejected.

    Args:
        correct: (N,) bool, of the known queries.
    """
    return float(np.mean(_of_some(correct, "known")))


def fsos_accuracy(
    known_score: ArrayLike, correct: ArrayLike, unknown_score: ArrayLike, tau: float
) -> float:
    """FSOS-ACC (arXiv 2209.04288): share of all queries, known and unknown, answered rightly.

    A known query is answered rightly when it is accepted under its own label, an unknown one
    when it is rejected. Rejecting everything scores the share of unknown queries, so the figure
    says little without that one beside it (`always_reject_accuracy`).

    Args:
        known_score: (N,) scores of the known queries.
        correct: (N,) bool, whether their nearest action is the right one.
        unknown_score: (M,) scores of the unknown queries.
        tau: accept means score > tau.
    """
    known, unknown = np.asarray(known_score), np.asarray(unknown_score)
    right = np.count_nonzero(np.asarray(correct)[known > tau])
    right += np.count_nonzero(unknown <= tau)
    return float(right / (known.size + unknown.size))


def always_reject_accuracy(known: int, unknown: int) -> float:
    """FSOS-ACC of rejecting every one of `known` + `unknown` queries."""
    return unknown / (known + unknown)


def false_accept_rate(unknown_score: ArrayLike, tau: float) -> float:
    """Share of the unknown queries (M,) that are accepted, whatever the label."""
    return float(np.mean(_of_some(unknown_score, "unknown") > tau))


def false_reject_rate(known_score: ArrayLike, tau: float) -> float:
    """Share of the known queries (N,) that are rejected."""
    return float(np.mean(_of_some(known_score, "known") <= tau))


def auroc(known_score: ArrayLike, unknown_score: ArrayLike) -> float:
    """Probability that a known query outscores an unknown one, ties counting one half.

    This is the area under the ROC curve (Mann-Whitney), without sampling thresholds.
    """
    return float(np.mean(_share_outscored(known_score, unknown_score)))


def oscr(known_score: ArrayLike, correct: ArrayLike, unknown_score: ArrayLike) -> float:
    """Area under the open-set classification rate curve (arXiv 1811.04110), in [0, 1].

    The curve is, over all thresholds, the share of known queries that are accepted under the
    right label against the share of unknown queries that are accepted. It ends at the closed-set
    accuracy, which bounds the area; a score that tells nothing gets half of it. Tied scores are
    passed together (trapezoid). The area equals the mean over pairs of a known and an unknown
    query of [correct and the known one scores higher], which is how it is computed.
    """
    return float(np.mean(_share_outscored(known_score, unknown_score) * np.asarray(correct)))


def fpr_at_tpr(known_score: ArrayLike, unknown_score: ArrayLike, tpr: float = 0.95) -> float:
    """Share of unknown queries accepted at the strictest threshold that accepts `tpr` of the known.

    The threshold stands at a score that occurs, and equal scores are accepted with it.
    """
    known = np.sort(_of_some(known_score, "known"))
    unknown = _of_some(unknown_score, "unknown")
    # So many known queries must pass; a hair less before rounding up, because the product may be a
    # hair above a whole number in binary.
    needed = max(1, int(np.ceil(known.size * tpr - 1e-9)))
    return float(np.mean(unknown >= known[-needed]))


@dataclass(frozen=True, slots=True, eq=False)
class Reliability:
    """How often queries of a given confidence are right, in equal bins over [0, 1].

    Attributes:
        count: (B,) queries per bin; may be fractional after `pooled`.
        confidence: (B,) summed confidence per bin.
        hits: (B,) queries per bin whose nearest action is the one they show.
    """

    count: Floats
    confidence: Floats
    hits: Floats

    @property
    def ece(self) -> float:
        """Expected calibration error: mean over queries of their bin's |hit rate - confidence|."""
        return float(np.sum(np.abs(self.hits - self.confidence)) / np.sum(self.count))


def reliability(score: ArrayLike, hit: ArrayLike, bins: int = 10) -> Reliability:
    """Sort queries into equal confidence bins; an edge belongs to the upper bin, 1 to the last.

    Args:
        score: (N,) confidence in [0, 1] that the query shows its nearest action.
        hit: (N,) bool, whether it does; False for every unknown query.
        bins: their number B.
    """
    scores = _of_some(score, "scored")
    column = np.minimum((scores * bins).astype(np.intp), bins - 1)
    summands = (np.ones_like(scores), scores, np.asarray(hit))
    table = np.array([np.bincount(column, values, bins) for values in summands])
    return Reliability(*table)


def pooled(parts: list[Reliability]) -> Reliability:
    """One table of several, each with the same weight whatever its number of queries."""
    tables = np.array([(part.count, part.confidence, part.hits) for part in parts])
    return Reliability(*np.sum(tables / tables[:, :1].sum(axis=2, keepdims=True), axis=0))


def _share_outscored(known_score: ArrayLike, unknown_score: ArrayLike) -> Floats:
    """(N,) for each known query the share of unknown ones below it, ties counting one half."""
    known = _of_some(known_score, "known")
    unknown = np.sort(_of_some(unknown_score, "unknown"))
    below = np.searchsorted(unknown, known)
    not_above = np.searchsorted(unknown, known, side="right")
    return (below + not_above) / (2.0 * unknown.size)


def _of_some(values: ArrayLike, what: str) -> Floats:
    array = np.asarray(values, dtype=np.float64)
    if array.size == 0:
        raise ValueError(f"no {what} queries to measure")
    return array
