"""What an evaluation found, for tables and as JSON."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from actioncli.evaluation import metrics
from actioncli.evaluation.metrics import Floats, Reliability

# Key in the JSON output, and heading in tables.
METRICS: Mapping[str, str] = {
    "fsos_accuracy": "FSOS-ACC",
    "always_reject_fsos_accuracy": "always reject",
    "closed_set_accuracy": "closed set",
    "auroc": "AUROC",
    "oscr": "OSCR",
    "fpr_at_95_tpr": "FPR at 95 %",
    "false_accept_rate": "false accepts",
    "false_reject_rate": "false rejects",
}

# A mean over collections counts those with room for two enrolled and two unknown classes.
CLASSES_FOR_MEAN = 4


@dataclass(frozen=True, slots=True)
class Summary:
    """Mean and standard deviation of a metric over episodes."""

    mean: float
    std: float


@dataclass(frozen=True, slots=True, eq=False)
class Result:
    """One number of ways on one collection, or on the mean of several.

    Attributes:
        collection: its name, or "mean".
        ways: K that was asked for.
        ways_used: K of the episodes; smaller where the collection has too few classes. 0 for a
            mean over collections that differ in it.
        classes: how many classes episodes drew from; 0 for a mean.
        queries: mean number of queries in an episode.
        values: (episodes,) for each of `METRICS`.
        reliability: of all queries of all episodes.
        collections: those behind a mean, otherwise empty.
    """

    collection: str
    ways: int
    ways_used: int
    classes: int
    queries: float
    values: Mapping[str, Floats]
    reliability: Reliability
    collections: tuple[str, ...] = ()

    def __getitem__(self, metric: str) -> Summary:
        values = self.values[metric]
        return Summary(float(values.mean()), float(values.std()))

    def to_json(self) -> dict[str, Any]:
        """See `Evaluation.to_json`."""
        table = self.reliability
        filled = np.flatnonzero(table.count)
        found: dict[str, Any] = {
            "collection": self.collection,
            "ways": self.ways,
            "ways_used": self.ways_used,
            "classes": self.classes,
            "queries_per_episode": self.queries,
            "metrics": {name: {"mean": self[name].mean, "std": self[name].std} for name in METRICS},
            "expected_calibration_error": table.ece,
            "reliability": [
                {
                    "share": float(table.count[b] / table.count.sum()),
                    "confidence": float(table.confidence[b] / table.count[b]),
                    "accuracy": float(table.hits[b] / table.count[b]),
                }
                for b in filled
            ],
        }
        if self.collections:
            found["collections"] = list(self.collections)
        return found


def mean_result(results: Iterable[Result]) -> Result | None:
    """Mean over the collections that have enough classes, each with the same weight.

    Episode by episode, so that the standard deviation is that of the mean over collections.

    Args:
        results: of one number of ways and equally many episodes.

    Returns:
        None where no collection has `CLASSES_FOR_MEAN` classes.
    """
    counted = [result for result in results if result.classes >= CLASSES_FOR_MEAN]
    if not counted:
        return None
    used = {result.ways_used for result in counted}
    return Result(
        collection="mean",
        ways=counted[0].ways,
        ways_used=used.pop() if len(used) == 1 else 0,
        classes=0,
        queries=float(np.mean([result.queries for result in counted])),
        values={m: np.mean([result.values[m] for result in counted], axis=0) for m in METRICS},
        reliability=metrics.pooled([result.reliability for result in counted]),
        collections=tuple(result.collection for result in counted),
    )


@dataclass(frozen=True, slots=True)
class Skipped:
    """A collection, or some clips of it, that could not be measured, and why."""

    collection: str
    reason: str


@dataclass(frozen=True, slots=True, eq=False)
class Evaluation:
    """Everything one run measured.

    Attributes:
        scorer: what was measured.
        protocol: who asked the queries.
        shots: support clips per class.
        episodes: per collection and number of ways.
        tau: accept means confidence > tau.
        seed: of the episodes.
        results: by collection, then by ways, in the order asked.
        means: over collections, one for each number of ways.
        skipped: what was left out.
    """

    scorer: str
    protocol: str
    shots: int
    episodes: int
    tau: float
    seed: int
    results: tuple[Result, ...]
    means: tuple[Result, ...]
    skipped: tuple[Skipped, ...]

    def to_json(self) -> dict[str, Any]:
        """Plain values under stable keys.

        `scorer`, `protocol`, `shots`, `episodes`, `tau`, `seed` say what was run. `results` and
        `means` are lists of objects with `collection`, `ways` (asked for), `ways_used` (0 in a
        mean of different ones), `classes`, `queries_per_episode`, `metrics` (the keys of
        `METRICS`, each with `mean` and `std` over episodes), `expected_calibration_error` and
        `reliability` (a list over non-empty confidence bins of `share` of the queries, mean
        `confidence`, and `accuracy`: how often the query shows its nearest action). A mean also
        lists its `collections`. `skipped` lists objects with `collection` and `reason`.
        """
        return {
            "scorer": self.scorer,
            "protocol": self.protocol,
            "shots": self.shots,
            "episodes": self.episodes,
            "tau": self.tau,
            "seed": self.seed,
            "results": [result.to_json() for result in self.results],
            "means": [mean.to_json() for mean in self.means],
            "skipped": [{"collection": s.collection, "reason": s.reason} for s in self.skipped],
        }
