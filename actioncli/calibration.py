"""Which threshold suits a support set: false accepts and false rejects over tau, counted.

Each clip is one query, answered as `Recognizer.classify` would answer it:

- *known*: an enrolled example against the support set without that example. It needs another
  example of its action, so false rejects cannot be measured where every action has one.
- *unknown*, which whatever is accepted is falsely accepted, of three kinds:
  `actions`, an enrolled example against the support set without its whole action;
  `negatives`, a stored negative against the support set and the other negatives, or a clip that
  was given for this purpose; `cohort`, other people's motions that came with the weights.

An unknown clip counts once, with the action nearest to it, not once for each action: a rate of
false accepts over pairs of clip and action would be smaller than what the user meets.

What the figures cannot tell: the intervals take clips for independent draws, while those of one
person and one session are alike, so they are too narrow rather than too wide. Examples of one
recording session make false rejects look rarer than they are for other people and other days. A
motion of the cohort may happen to show an enrolled action, which counts as a false accept, and
the weights were trained on the cohort's motions.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from math import ceil, floor, nan, sqrt

import numpy as np
from numpy.typing import ArrayLike, NDArray

from actioncli.clips.clip import FloatArray
from actioncli.errors import SupportError
from actioncli.recognizer import DEFAULT_TAU, Recognizer

KINDS = ("actions", "negatives", "cohort")

# Thresholds of the table; its resolution is that of what people would choose by hand.
TAUS = tuple(step / 20 for step in range(1, 20))

# Recommended thresholds are rounded up to this many steps: no more digits than can be measured.
_STEPS = 1000

# Queries compared at once: enough for full speed, few enough for progress to be seen.
_BATCH = 64

# An interval that is wider than this is worth a sentence.
_VAGUE = 0.3

_Z95 = 1.959964  # standard normal quantile of a two-sided 95 % interval

Progress = Callable[[Sequence[int]], Iterable[int]]


@dataclass(frozen=True, slots=True)
class Rate:
    """`count` of `of` clips, as a rate with its 95 % interval."""

    count: int
    of: int

    @property
    def rate(self) -> float:
        """NaN where there are no clips."""
        return self.count / self.of if self.of else nan

    @property
    def interval(self) -> tuple[float, float]:
        """Wilson's score interval, which holds for few clips and rates near 0 and 1.

        E. B. Wilson: Probable Inference, the Law of Succession, and Statistical Inference, 1927.
        (0, 1) where there are no clips.
        """
        if not self.of:
            return 0.0, 1.0
        n, p, z2 = self.of, self.rate, _Z95 * _Z95
        middle = (p + z2 / (2 * n)) / (1 + z2 / n)
        half = _Z95 / (1 + z2 / n) * sqrt(p * (1 - p) / n + z2 / (4 * n * n))
        return (
            0.0 if self.count == 0 else max(0.0, middle - half),
            1.0 if self.count == n else min(1.0, middle + half),
        )


@dataclass(frozen=True, slots=True, eq=False)
class Queries:
    """N clips as `classify` decides them.

    Attributes:
        score: (N,) confidence of the nearest action; 0, which no threshold accepts, where a
            negative is nearer.
        nearest: (N,) number of that action.
    """

    score: NDArray[np.float64]
    nearest: NDArray[np.intp]

    def __len__(self) -> int:
        return len(self.score)

    def accepted(self, tau: ArrayLike) -> NDArray[np.bool_]:
        """(N,), under one threshold or under those of the K actions."""
        taus = np.asarray(tau, np.float64)
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
        asked = slice(None) if action is None else queries.nearest == action
        accepted = queries.accepted(tau)[asked]
        return Rate(int(accepted.sum()), len(accepted))

    def false_rejects(self, tau: ArrayLike, action: int | None = None) -> Rate:
        """Known queries, of one action or of all, that are rejected."""
        asked = slice(None) if action is None else self.shown == action
        accepted = self.known.accepted(tau)[asked]
        return Rate(int((~accepted).sum()), len(accepted))

    def misnamed(self, tau: ArrayLike) -> Rate:
        """Known queries that are accepted as another action than the one they show."""
        wrong = self.known.accepted(tau) & (self.known.nearest != self.shown)
        return Rate(int(wrong.sum()), len(wrong))


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
    unknown = {
        "negatives": _decide(distance[n:m], confidence[n:m], shadow[n:m]),
        "cohort": _decide(distance[m:], confidence[m:], shadow[m:]),
    }
    own = (np.arange(n), shown)
    apart = distance[:n].copy()
    apart[own] = np.inf
    asked = slice(0, n if len(counts) > 1 else 0)  # one action leaves no other to be taken for
    unknown["actions"] = _decide(apart[asked], confidence[:n][asked], shadow[:n][asked])

    left = np.flatnonzero(np.asarray(counts)[shown] > 1)
    rows, sure = distance[:n].copy(), confidence[:n].copy()
    first = np.cumsum([0, *counts])
    for example in progress(left.tolist()):
        action = int(shown[example])
        label = list(support)[action]
        rest = np.delete(support[label], example - first[action], axis=0)
        compared = recognizer.compare(examples[example : example + 1], {label: rest})
        rows[example, action] = compared.distance[0, 0]
        sure[example, action] = compared.confidence[0, 0]
    return Trials(
        labels=tuple(support),
        examples=tuple(counts),
        known=_decide(rows[left], sure[left], shadow[left]),
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
    rows = []
    for start in progress(range(0, len(queries), _BATCH)):
        batch = queries[start : start + _BATCH]
        compared = recognizer.compare(batch, support)
        shadow = np.full(len(batch), np.inf, np.float32)
        if apart:
            distance = recognizer.compare(batch, apart).distance
            same = [[np.array_equal(query, negative) for negative in negatives] for query in batch]
            shadow = np.where(same, np.float32(np.inf), distance).min(axis=1)
        rows.append((compared.distance, compared.confidence, shadow))
    distances, confidences, shadows = zip(*rows, strict=True)
    return np.concatenate(distances), np.concatenate(confidences), np.concatenate(shadows)


def _among(clip: FloatArray, clips: FloatArray) -> bool:
    return any(np.array_equal(clip, other) for other in clips)


def _decide(distance: FloatArray, confidence: FloatArray, shadow: FloatArray) -> Queries:
    """The nearest action of each query, as `classify` chooses it."""
    nearest = distance.argmin(axis=1)
    rows = np.arange(len(nearest))
    score = np.where(shadow < distance[rows, nearest], 0.0, confidence[rows, nearest])
    return Queries(score.astype(np.float64), nearest)


@dataclass(frozen=True, slots=True)
class Recommendation:
    """A threshold, and whether it was measured.

    Attributes:
        tau: the smallest threshold with at most the wanted rate of false accepts; 0.5 where
            that cannot be told.
        measured: whether it could be told.
        actions: thresholds of the actions with enough unknown clips nearest to them; empty
            unless they were asked for.
        notes: what the figures cannot tell, and why; sentences.
    """

    tau: float
    measured: bool
    actions: Mapping[str, float]
    notes: tuple[str, ...]


def recommend(trials: Trials, target_far: float, per_action: bool = False) -> Recommendation:
    """The smallest threshold with at most `target_far` false accepts.

    The rate must hold for all unknown clips together and for each kind that has enough of them
    to tell, so that a large cohort does not outvote what the user showed. Enough means that a
    single false accept does not exceed the wanted rate: 20 clips for 0.05.

    Args:
        trials: from `run_trials`.
        target_far: wanted rate of false accepts, in (0, 1).
        per_action: give each action a threshold of its own. Among the unknown clips nearest to
            it at most `target_far` are accepted, so this holds for all clips too.
    """
    needed = ceil(1 / target_far - 1e-9)
    unknown = trials.all_unknown()
    notes = _unmeasured(trials)
    if len(unknown) < needed:
        notes.append(
            f"Too few clips that show none of the actions to tell: {len(unknown)}, and a false "
            f"accept rate of {target_far:g} needs {needed}. Keep some with `actioncli enroll "
            "--negative CLIP...`, or name some with --negatives."
        )
        return Recommendation(DEFAULT_TAU, False, {}, tuple(notes))
    enough = [part.score for part in trials.unknown.values() if len(part) >= needed]
    tau = max(_smallest(score, target_far) for score in [unknown.score, *enough])
    if tau >= 1:
        notes.append(
            f"No threshold below 1 keeps false accepts at {target_far:g}: clips that show none "
            "of the actions are taken for one with full confidence. Enrol such clips with "
            "`actioncli enroll --negative CLIP...`."
        )
        return Recommendation(DEFAULT_TAU, False, {}, tuple(notes))
    for kind in KINDS:
        if 0 < len(trials.unknown[kind]) < needed:
            notes.append(
                f"Too few clips of the kind `{kind}` to tell by themselves: "
                f"{trials.false_accepts(tau, kind).of} of {needed}."
            )
    low, high = trials.false_accepts(tau).interval
    if high > 2 * target_far:
        notes.append(
            f"{len(unknown)} clips that show none of the actions are few: the rate of false "
            f"accepts may be anything from {low:.2f} to {high:.2f}."
        )
    rejects = trials.false_rejects(tau)
    low, high = rejects.interval
    if len(trials.known) and high - low > _VAGUE:
        notes.append(
            f"{len(trials.known)} examples that have others of their action are few: the rate "
            f"of false rejects may be anything from {low:.2f} to {high:.2f}."
        )
    if 2 * rejects.count > rejects.of:
        notes.append(
            f"This threshold rejects {rejects.count} of {rejects.of} of your own examples. What "
            "is taken for an action without being one is better enrolled with `actioncli enroll "
            "--negative CLIP...` than kept out by a threshold."
        )
    actions = {}
    for action, label in enumerate(trials.labels if per_action else ()):
        score = unknown.score[unknown.nearest == action]
        if len(score) >= needed and (smallest := _smallest(score, target_far)) < 1:
            actions[label] = smallest
    if per_action and len(actions) < len(trials.labels):
        notes.append(
            f"{len(trials.labels) - len(actions)} of {len(trials.labels)} actions have too few "
            f"unknown clips near them for a threshold of their own ({needed} are needed); the "
            "common one holds for them."
        )
    return Recommendation(tau, True, actions, tuple(notes))


def _smallest(score: NDArray[np.float64], target_far: float) -> float:
    """The smallest threshold that accepts at most a share of the scores, rounded up.

    Accepting means score > tau, so it is the largest score that must not be accepted.
    """
    allowed = floor(target_far * len(score) + 1e-9)
    bound = float(np.sort(score)[len(score) - 1 - allowed])
    step = ceil(bound * _STEPS)
    # The product may have been rounded down to a whole number.
    return (step if step / _STEPS >= bound else step + 1) / _STEPS


def _unmeasured(trials: Trials) -> list[str]:
    """What the known queries cannot tell."""
    alone = sum(count == 1 for count in trials.examples)
    if not alone:
        return []
    which = f"{alone} of {len(trials.examples)} actions have"
    if alone == len(trials.examples):
        return [
            "False rejects cannot be told: every action has one example, and it takes another to "
            "ask. Enrol a second one of each."
        ]
    return [f"{which} one example: false rejects of these cannot be told."]
