"""Which threshold suits a support set: false accepts and false rejects over tau, counted.

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


@dataclass(frozen=True, slots=True, eq=False)
class Queries:
    """N clips as `classify` decides them.

    Attributes:
        score: (N,) confidence of the nearest action; 0, which no threshold accepts, where a
            negative is nearer.
        nearest: (N,) number of that action.
        motion: (N,) queries with the same number show the same motion.
    """

    score: NDArray[np.float64]
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
    asked = slice(0, n if len(counts) > 1 else 0)  # one action leaves no other to be taken for
    unknown["actions"] = _decide(apart[asked], confidence[asked], shadow[asked], motion[asked])

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


def _decide(
    distance: FloatArray, confidence: FloatArray, shadow: FloatArray, motion: NDArray[np.intp]
) -> Queries:
    """The nearest action of each query, as `classify` chooses it."""
    nearest = distance.argmin(axis=1)
    rows = np.arange(len(nearest))
    score = np.where(shadow < distance[rows, nearest], 0.0, confidence[rows, nearest])
    return Queries(score.astype(np.float64), nearest, motion)


@dataclass(frozen=True, slots=True)
class Recommendation:
    """A threshold, and whether it was measured.

    Attributes:
        tau: the smallest threshold that holds the wanted rate of false accepts; 0.5 where that
            cannot be told.
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
    """The smallest threshold that holds false accepts at `target_far`.

    It is chosen so that the next unknown motion, if it comes from where these came from, is
    accepted with at most that probability: of n motions the share a / n is accepted, and
    (a + 1) / (n + 1) is at most the wanted rate (split conformal prediction: Vovk, Gammerman,
    Shafer, Algorithmic Learning in a Random World, 2005). So it takes 19 motions for 0.05, none
    of them accepted; choosing by a / n would promise too much, for the threshold is fitted to
    these motions.

    The rate must hold for all unknown motions together and for each kind that has enough of them
    to tell, so that a large cohort does not outvote what the user showed.

    Args:
        trials: from `run_trials`.
        target_far: wanted rate of false accepts, in (0, 1).
        per_action: give each action a threshold of its own, which holds the rate among the
            unknown motions nearest to it, and so for all motions.
    """
    needed = max(1, ceil(1 / target_far - 1 - 1e-9))
    unknown = trials.all_unknown()
    notes = _unmeasured(trials)
    if unknown.motions < needed:
        notes.append(
            f"Too few motions other than the actions to tell: {unknown.motions}, and a false "
            f"accept rate of {target_far:g} needs {needed}. Examples of one action count as one "
            "motion. Keep clips of other motions with `actioncli enroll --negative CLIP...`, or "
            "name some with --negatives."
        )
        return Recommendation(DEFAULT_TAU, False, {}, tuple(notes))
    enough = [part for part in trials.unknown.values() if part.motions >= needed]
    tau = max(_smallest(queries, target_far) for queries in [unknown, *enough])
    if tau >= 1:
        notes.append(
            f"No threshold below 1 holds false accepts at {target_far:g}: motions other than the "
            "actions are taken for one with full confidence. Enrol clips of such with `actioncli "
            "enroll --negative CLIP...`."
        )
        return Recommendation(DEFAULT_TAU, False, {}, tuple(notes))
    for kind in KINDS:
        if 0 < trials.unknown[kind].motions < needed:
            notes.append(
                f"Too few motions of the kind `{kind}` to tell by themselves: "
                f"{trials.unknown[kind].motions} of {needed}."
            )
    low, high = trials.false_accepts(tau).interval
    if high > 2 * target_far:
        notes.append(
            f"{unknown.motions} motions other than the actions are few: the rate of false accepts "
            f"may be anything from {low:.2f} to {high:.2f}."
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
        near = unknown.of(unknown.nearest == action)
        if near.motions >= needed and (smallest := _smallest(near, target_far)) < 1:
            actions[label] = smallest
    if per_action and len(actions) < len(trials.labels):
        notes.append(
            f"{len(trials.labels) - len(actions)} of {len(trials.labels)} actions have too few "
            f"other motions near them for a threshold of their own ({needed} are needed); the "
            "common one holds for them."
        )
    return Recommendation(tau, True, actions, tuple(notes))


def _smallest(queries: Queries, target_far: float) -> float:
    """The smallest threshold that holds the rate on enough queries, rounded up.

    Accepting means score > tau, so it is the largest score that must not be accepted.
    """
    motions = queries.motions
    allowed = (target_far * (motions + 1) - 1) / motions * len(queries)
    accepted = min(floor(allowed + 1e-9), len(queries) - 1)
    bound = float(np.sort(queries.score)[-1 - accepted])
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
