"""Trials of a support set: how it decides about its own examples and about other motions.

Each clip is a query, decided as `Recognizer.classify` would decide it as a whole:

- *known*: an enrolled example against the support set without that example; it needs another
  example of its action.
- *unknown*, which is falsely accepted whenever it is accepted, of three kinds: `actions`, an
  enrolled example against the support set without its whole action; `negatives`, a stored
  negative against the support set and the other negatives, or a clip that was given for this
  purpose; `cohort`, other people's motions that came with the weights.

An unknown clip counts once, with the action nearest to it. Five examples of one action are taken
for another action all together or not at all, so they count as one *motion* in intervals and in
the choice of a threshold; negatives count one by one. Examples of one person and one session make
false rejects look rarer than they are, and the weights were trained on the cohort's motions.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass
from math import nan, sqrt

import numpy as np
from numpy.typing import ArrayLike, NDArray

from actioncli.clips.clip import FloatArray
from actioncli.errors import SupportError
from actioncli.recognition.recognizer import Recognizer

KNOWN, KINDS = "known", ("actions", "negatives", "cohort")
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

    def __str__(self) -> str:
        if not self.of:
            return "none asked"
        low, high = self.interval
        return f"{self.count}/{self.of} {self.rate:4.0%} ({low * 100:.0f}-{high:.0%})"

    def to_json(self) -> dict[str, object]:
        """As plain values."""
        low, high = self.interval
        return {**asdict(self), "rate": self.rate, "low": low, "high": high}


@dataclass(frozen=True, slots=True, eq=False)
class Trials:
    """N queries as a support set of K actions decides them.

    Attributes:
        labels: (K,) names of the actions.
        examples: (K,) how many examples each has.
        kind: (N,) `KNOWN`, or one of `KINDS`.
        score: (N,) confidence of the nearest action; 0, which no threshold accepts, where a
            negative is nearer.
        nearest: (N,) number of that action.
        shown: (N,) number of the action that a known query shows; -1 of unknown queries.
        stored: (N,) whether it is a stored negative. Its score is that without itself, which says
            what to expect of others like it; the support set itself rejects it.
        motion: (N,) unknown queries of equal number show the same motion, as do known ones.
    """

    labels: tuple[str, ...]
    examples: tuple[int, ...]
    kind: NDArray[np.str_]
    score: FloatArray
    nearest: NDArray[np.intp]
    shown: NDArray[np.intp]
    motion: NDArray[np.intp]
    stored: NDArray[np.bool_]

    def motions(self, asked: NDArray[np.bool_]) -> int:
        """How many different motions queries (N,) show."""
        return len(np.unique(self.motion[asked]))

    def accepted(self, tau: ArrayLike) -> NDArray[np.bool_]:
        """(N,), under one threshold or under those of the K actions."""
        taus = np.asarray(tau)
        accepted: NDArray[np.bool_] = self.score > (taus[self.nearest] if taus.ndim else taus)
        return accepted

    def false_accepts(
        self, tau: ArrayLike, kind: str | None = None, action: int | None = None
    ) -> Rate:
        """Unknown queries that are accepted.

        Args:
            tau: one threshold, or one for each of the K actions.
            kind: count those of one kind only.
            action: count those nearest to one action only.
        """
        asked = (self.kind != KNOWN) if kind is None else (self.kind == kind)
        if action is not None:
            asked = asked & (self.nearest == action)
        return self._rate(self.accepted(tau) & ~self.stored, asked)

    def false_rejects(self, tau: ArrayLike, action: int | None = None) -> Rate:
        """Known queries, of one action or of all, that are rejected."""
        asked = (self.kind == KNOWN) if action is None else (self.shown == action)
        return self._rate(~self.accepted(tau), asked)

    def misnamed(self, tau: ArrayLike) -> Rate:
        """Known queries that are accepted as another action than the one they show."""
        return self._rate(self.accepted(tau) & (self.nearest != self.shown), self.kind == KNOWN)

    def _rate(self, counted: NDArray[np.bool_], asked: NDArray[np.bool_]) -> Rate:
        return Rate(int((counted & asked).sum()), int(asked.sum()), self.motions(asked))


def run_trials(
    recognizer: Recognizer,
    support: Mapping[str, FloatArray],
    negatives: FloatArray,
    others: FloatArray,
    progress: Progress = iter,
) -> Trials:
    """Decide about the enrolled examples, the negatives and the cohort.

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
    labels, counts = tuple(support), [len(examples) for examples in support.values()]
    examples = np.concatenate(list(support.values()))
    fresh = [not any(np.array_equal(other, negative) for negative in negatives) for other in others]
    clips = np.concatenate([examples, negatives, others[fresh], recognizer.cohort])
    distance, confidence, away = _compare(recognizer, clips, support, negatives, progress)

    n = len(examples)
    action = np.repeat(np.arange(len(counts)), counts)
    left = np.flatnonzero(np.array(counts)[action] > 1)
    apart = np.arange(n if len(counts) > 1 else 0)  # one action leaves no other to be taken for
    sizes = len(left), len(apart), len(clips) - n - len(recognizer.cohort), len(recognizer.cohort)
    kind = np.repeat([KNOWN, *KINDS], sizes)
    clip = np.concatenate([left, apart, np.arange(n, len(clips))])
    distance, confidence = distance[clip], confidence[clip]
    for row, example in enumerate(progress(left.tolist())):
        own = int(action[example])
        first = sum(counts[:own])
        rest = np.delete(support[labels[own]], example - first, axis=0)
        compared = recognizer.compare(clips[[example]], {labels[own]: rest})
        distance[row, own] = compared.distance[0, 0]
        confidence[row, own] = compared.confidence[0, 0]
    distance[len(left) + apart, action[apart]] = np.inf

    # The nearest action, as `classify` chooses it.
    nearest = distance.argmin(axis=1)
    at = np.arange(len(clip)), nearest
    motion = np.concatenate([action, len(counts) + np.arange(len(clips) - n)])[clip]
    return Trials(
        labels=labels,
        examples=tuple(counts),
        kind=kind,
        score=np.where(away[clip] < distance[at], 0.0, confidence[at]),
        nearest=nearest,
        shown=np.concatenate([action[left], np.full(len(clip) - len(left), -1)]),
        # Known examples are rejected one by one, for being bad ones.
        motion=np.where(kind == KNOWN, clip, motion),
        stored=(clip >= n) & (clip < n + len(negatives)),
    )


def _compare(
    recognizer: Recognizer,
    clips: FloatArray,
    support: Mapping[str, FloatArray],
    negatives: FloatArray,
    progress: Progress,
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Distance and confidence (Q, K), and the distance to the nearest other negative (Q,)."""
    apart = {str(n): negatives[n : n + 1] for n in range(len(negatives))}
    found, away = [], []
    for start in progress(range(0, len(clips), _BATCH)):
        batch = clips[start : start + _BATCH]
        found.append(recognizer.compare(batch, support))
        nearest = np.full(len(batch), np.inf, np.float32)
        if apart:
            same = [[np.array_equal(clip, negative) for negative in negatives] for clip in batch]
            distance = recognizer.compare(batch, apart).distance
            nearest = np.where(same, np.inf, distance).min(axis=1)
        away.append(nearest)
    distances = np.concatenate([each.distance for each in found])
    return distances, np.concatenate([each.confidence for each in found]), np.concatenate(away)
