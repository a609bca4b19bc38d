"""What a support set makes of its own examples and of other motions: queries whose answer is known.

Each clip is one query, answered as `Recognizer.classify` would answer it as a whole, for windows
of long clips are made to accept as many unknown queries as whole clips do:

- *known*: an enrolled example against the support set without that example. It needs another
  example of its action, so false rejects cannot be measured where every action has one.
- *unknown*, which whatever is accepted is falsely accepted, of three kinds:
  `actions`, an enrolled example against the support set without its whole action;
  `negatives`, a stored negative against the support set and the other negatives, or a clip that
  was given for this purpose; `cohort`, other people's motions that came with the weights.

An unknown clip counts once, with the action nearest to it, not once for each action: a rate of
false accepts over pairs of clip and action would be smaller than what the user meets.

How many clips there are is not how much they tell: five examples of one action are taken for
another action all together or not at all. So they count as one *motion* where intervals are
computed and where a threshold is recommended. Negatives count one by one; they should be varied.

What the figures cannot tell: examples of one person and one session make false rejects look rarer
than they are for other people and other days. A motion of the cohort may happen to show an
enrolled action, which counts as a false accept, and the weights were trained on the cohort's
motions.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass
from math import nan, sqrt
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from actioncli.clips.clip import FloatArray
from actioncli.errors import SupportError
from actioncli.recognition.recognizer import Recognizer

KINDS = ("actions", "negatives", "cohort")

# Queries compared at once: enough for full speed, few enough for progress to be seen.
_BATCH = 64

_Z95 = 1.959964  # standard normal quantile of a two-sided 95 % interval

Progress = Callable[[Sequence[int]], Iterable[int]]


@dataclass(frozen=True, slots=True)
class Rate:
    """`count` of `of` clips, which show `motions` motions, as a rate with its 95 % interval."""

    count: int
    of: int
    motions: int

    @property
    def rate(self) -> float:
        """NaN where there are no clips."""
        return self.count / self.of if self.of else nan

    @property
    def interval(self) -> tuple[float, float]:
        """Wilson's score interval, which holds for few draws and rates near 0 and 1.

        E. B. Wilson: Probable Inference, the Law of Succession, and Statistical Inference, 1927.
        The draws are the motions. (0, 1) where there are no clips.
        """
        if not self.of:
            return 0.0, 1.0
        n, p, z2 = self.motions, self.rate, _Z95 * _Z95
        middle = (p + z2 / (2 * n)) / (1 + z2 / n)
        half = _Z95 / (1 + z2 / n) * sqrt(p * (1 - p) / n + z2 / (4 * n * n))
        return (
            0.0 if self.count == 0 else max(0.0, middle - half),
            1.0 if self.count == self.of else min(1.0, middle + half),
        )

    def to_json(self) -> dict[str, object]:
        """As plain values."""
        low, high = self.interval
        return {**asdict(self), "rate": self.rate, "low": low, "high": high}


@dataclass(frozen=True, slots=True, eq=False)
class Queries:
    """N clips as `classify` decides them.

    Attributes:
        score: (N,) confidence of the nearest action; 0, which no threshold accepts, where a
            negative is nearer.
        nearest: (N,) number of that action.
        motion: (N,) queries with the same number show the same motion.
    """

    score: FloatArray
    nearest: NDArray[np.intp]
    motion: NDArray[np.intp]

    def __len__(self) -> int:
        return len(self.score)

    @property
    def motions(self) -> int:
        """How many different motions they show."""
        return len(np.unique(self.motion))

    def of(self, chosen: NDArray[np.bool_]) -> Queries:
        """Those for which `chosen` (N,) is true."""
        return Queries(self.score[chosen], self.nearest[chosen], self.motion[chosen])

    def accepted(self, tau: ArrayLike) -> NDArray[np.bool_]:
        """(N,), under one threshold or under those of the K actions."""
        taus = np.asarray(tau)
        accepted: NDArray[np.bool_] = self.score > (taus[self.nearest] if taus.ndim else taus)
        return accepted


@dataclass(frozen=True, slots=True, eq=False)
class Trials:
    """What was asked of a support set of K actions, and what came back.

    Attributes:
        labels: (K,) names of the actions.
        examples: (K,) how many examples each has.
        known: one query for each example that is not the only one of its action.
        shown: (N,) number of the action that each known query shows.
        unknown: the queries that show no enrolled action, by kind.
    """

    labels: tuple[str, ...]
    examples: tuple[int, ...]
    known: Queries
    shown: NDArray[np.intp]
    unknown: Mapping[str, Queries]

    def all_unknown(self) -> Queries:
        """The unknown queries of all kinds."""
        parts = self.unknown.values()
        return Queries(
            np.concatenate([part.score for part in parts]),
            np.concatenate([part.nearest for part in parts]),
            np.concatenate([part.motion for part in parts]),
        )

    def false_accepts(
        self, tau: ArrayLike, kind: str | None = None, action: int | None = None
    ) -> Rate:
        """Unknown queries that are accepted.

        Args:
            tau: one threshold, or one for each of the K actions.
            kind: count those of one kind only.
            action: count those nearest to one action only.
        """
        queries = self.all_unknown() if kind is None else self.unknown[kind]
        if action is not None:
            queries = queries.of(queries.nearest == action)
        return Rate(int(queries.accepted(tau).sum()), len(queries), queries.motions)

    def false_rejects(self, tau: ArrayLike, action: int | None = None) -> Rate:
        """Known queries, of one action or of all, that are rejected."""
        queries = self.known if action is None else self.known.of(self.shown == action)
        return Rate(int((~queries.accepted(tau)).sum()), len(queries), queries.motions)

    def misnamed(self, tau: ArrayLike) -> Rate:
        """Known queries that are accepted as another action than the one they show."""
        wrong = self.known.accepted(tau) & (self.known.nearest != self.shown)
        return Rate(int(wrong.sum()), len(wrong), self.known.motions)


def run_trials(
    recognizer: Recognizer,
    support: Mapping[str, FloatArray],
    negatives: FloatArray,
    others: FloatArray,
    progress: Progress = iter,
) -> Trials:
    """Ask the enrolled examples, the negatives and the cohort of the support set.

    Args:
        recognizer: whose confidences are calibrated; it also brings the cohort.
        support: embeddings (n, F, E) of the examples of each action.
        negatives: (M, F, E), stored ones, which take part in decisions.
        others: (L, F, E), more clips that show no enrolled action; those among them that are
            stored negatives count once.
        progress: wraps the sequences of numbers that are worked off.

    Raises:
        SupportError: no action, or an action without examples.
    """
    if not support:
        raise SupportError("the support set is empty; enrol an action first.")
    counts = [len(examples) for examples in support.values()]
    shown = np.repeat(np.arange(len(counts)), counts)
    examples = np.concatenate(list(support.values()))
    others = others[[not _among(other, negatives) for other in others]]
    queries = np.concatenate([examples, negatives, others, recognizer.cohort])

    distance, confidence, shadow = _compare(recognizer, queries, support, negatives, progress)
    n, m = len(examples), len(examples) + len(negatives) + len(others)
    motion = np.concatenate([shown, len(counts) + np.arange(len(queries) - n)])
    unknown = {
        "negatives": _decide(distance[n:m], confidence[n:m], shadow[n:m], motion[n:m]),
        "cohort": _decide(distance[m:], confidence[m:], shadow[m:], motion[m:]),
    }
    own = (np.arange(n), shown)
    apart = distance[:n].copy()
    apart[own] = np.inf
    asked = slice(n if len(counts) > 1 else 0)  # one action leaves no other to be taken for
    unknown["actions"] = _decide(apart[asked], confidence[asked], shadow[asked], motion[asked])

    left = np.flatnonzero(np.asarray(counts)[shown] > 1)
    rows, sure = distance[:n].copy(), confidence[:n].copy()
    first = np.cumsum([0, *counts])
    for example in progress(left.tolist()):
        action = int(shown[example])
        label = list(support)[action]
        rest = np.delete(support[label], example - first[action], axis=0)
        compared = recognizer.compare(examples[[example]], {label: rest})
        rows[example, action] = compared.distance[0, 0]
        sure[example, action] = compared.confidence[0, 0]
    return Trials(
        labels=tuple(support),
        examples=tuple(counts),
        # Examples are rejected one by one, for being bad ones.
        known=_decide(rows[left], sure[left], shadow[left], np.arange(len(left))),
        shown=shown[left],
        unknown={kind: unknown[kind] for kind in KINDS},
    )


def _compare(
    recognizer: Recognizer,
    queries: FloatArray,
    support: Mapping[str, FloatArray],
    negatives: FloatArray,
    progress: Progress,
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Distance and confidence (Q, K), and the distance to the nearest other negative (Q,)."""
    apart = {str(n): negatives[n : n + 1] for n in range(len(negatives))}
    distances, confidences, shadows = [], [], []
    for start in progress(range(0, len(queries), _BATCH)):
        batch = queries[start : start + _BATCH]
        compared = recognizer.compare(batch, support)
        distances.append(compared.distance)
        confidences.append(compared.confidence)
        shadow: NDArray[Any] = np.full(len(batch), np.inf)
        if apart:
            away = recognizer.compare(batch, apart).distance
            same = [[np.array_equal(query, negative) for negative in negatives] for query in batch]
            shadow = np.where(same, np.inf, away).min(axis=1)
        shadows.append(shadow)
    return np.concatenate(distances), np.concatenate(confidences), np.concatenate(shadows)


def _among(clip: FloatArray, clips: FloatArray) -> bool:
    return any(np.array_equal(clip, other) for other in clips)


def _decide(
    distance: FloatArray, confidence: FloatArray, shadow: FloatArray, motion: NDArray[np.intp]
) -> Queries:
    """The nearest action of each query, as `classify` chooses it."""
    nearest = distance.argmin(axis=1)
    rows = np.arange(len(nearest))
    score = np.where(shadow < distance[rows, nearest], 0.0, confidence[rows, nearest])
    return Queries(score, nearest, motion)
