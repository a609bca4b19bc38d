"""Calibration: which threshold suits a support set, by the false accepts and rejects of trials."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from math import ceil, floor
from typing import Any

import numpy as np
from numpy.typing import NDArray

from actioncli.calibration.trials import KINDS, KNOWN, Progress, Rate, Trials, run_trials
from actioncli.clips.clip import FloatArray
from actioncli.recognition.support import SupportSet
from actioncli.recognition.threshold import DEFAULT_TAU

# Thresholds of the table; its resolution is that of what people would choose by hand.
TAUS = tuple(step / 20 for step in range(1, 20))
# Recommended thresholds are rounded up to this many steps: no more digits than can be measured.
_STEPS = 1000
# An interval that is wider than this is worth a sentence.
_VAGUE = 0.3


@dataclass(frozen=True, slots=True, eq=False)
class Calibration:
    """A threshold, whether it was measured, and the trials behind it.

    Attributes:
        trials: on which it was measured.
        target_far: the wanted rate of false accepts.
        tau: the smallest threshold that holds this rate; 0.5 where that cannot be measured.
        measured: whether it could be measured.
        actions: thresholds of the actions with enough unknown clips nearest to them; empty
            unless they were asked for.
        notes: what the figures cannot tell, and why; sentences.
    """

    trials: Trials
    target_far: float
    tau: float = DEFAULT_TAU
    measured: bool = False
    actions: Mapping[str, float] = field(default_factory=dict)
    notes: tuple[str, ...] = ()

    def figures(self) -> dict[str, list[dict[str, Any]]]:
        """Rates over tau (`table`), and of each kind of `unknown` clips and all `actions`, each
        action at its own threshold."""
        trials = self.trials
        taus = [self.actions.get(label, self.tau) for label in trials.labels]
        return {
            "table": [
                {
                    "tau": tau,
                    "false_accepts": trials.false_accepts(tau),
                    "false_rejects": trials.false_rejects(tau),
                    "misnamed": trials.misnamed(tau),
                }
                for tau in sorted({*TAUS, self.tau})
            ],
            "unknown": [
                {"kind": kind, "false_accepts": trials.false_accepts(taus, kind)} for kind in KINDS
            ],
            "actions": [
                {
                    "label": label,
                    "examples": trials.examples[action],
                    "tau": taus[action],
                    "false_accepts": trials.false_accepts(taus, action=action),
                    "false_rejects": trials.false_rejects(taus, action),
                }
                for action, label in enumerate(trials.labels)
            ],
        }

    def to_json(self) -> dict[str, Any]:
        """As plain values."""

        def plain(row: dict[str, Any]) -> dict[str, Any]:
            return {k: v.to_json() if isinstance(v, Rate) else v for k, v in row.items()}

        figures = {name: [plain(row) for row in rows] for name, rows in self.figures().items()}
        decided = {"tau": self.tau, "measured": self.measured, "target_far": self.target_far}
        return {**decided, **figures, "notes": list(self.notes)}


def calibrate(
    support: SupportSet,
    others: FloatArray,
    target_far: float,
    per_action: bool = False,
    progress: Progress = iter,
) -> Calibration:
    """Measure which threshold suits a support set; nothing is kept.

    Args:
        support: what is enrolled.
        others, progress: as in `run_trials`.
        target_far, per_action: as in `recommend`.

    Raises:
        SupportError: no action is enrolled.
    """
    support.require_actions()
    trials = run_trials(support.recognizer, support.actions, support.negatives, others, progress)
    found = recommend(trials, target_far, per_action)
    if support.foreign_threshold is None:
        return found
    last = support.foreign_threshold.tau
    note = f"The kept threshold, {last:g}, was measured with other weights."
    return replace(found, notes=(*found.notes, note))


def recommend(trials: Trials, target_far: float, per_action: bool = False) -> Calibration:
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
    unknown = trials.kind != KNOWN
    motions = trials.motions(unknown)
    notes = []
    alone, count = trials.examples.count(1), len(trials.examples)
    if alone == count:
        notes.append(
            "False rejects cannot be told: every action has one example, and it takes another to "
            "ask. Enrol a second one of each."
        )
    elif alone:
        notes.append(
            f"{alone} of {count} actions have one example: false rejects of these cannot be told."
        )
    if motions < needed:
        notes.append(
            f"Too few motions other than the actions to tell: {motions}, and a false "
            f"accept rate of {target_far:g} needs {needed}. Examples of one action count as one "
            "motion. Keep clips of other motions with `actioncli enroll --negative CLIP...`, or "
            "name some with --negatives."
        )
        return Calibration(trials, target_far, notes=tuple(notes))
    of_kind = {kind: trials.motions(trials.kind == kind) for kind in KINDS}
    enough = [trials.kind == kind for kind in KINDS if of_kind[kind] >= needed]
    tau = max(_smallest(trials, asked, target_far) for asked in [unknown, *enough])
    if tau >= 1:
        notes.append(
            f"No threshold below 1 holds false accepts at {target_far:g}: motions other than the "
            "actions are taken for one with full confidence. Enrol clips of such with `actioncli "
            "enroll --negative CLIP...`."
        )
        return Calibration(trials, target_far, notes=tuple(notes))
    notes += [
        f"Too few motions of the kind `{kind}` to tell by themselves: {number} of {needed}."
        for kind, number in of_kind.items()
        if 0 < number < needed
    ]
    accepts, rejects = trials.false_accepts(tau), trials.false_rejects(tau)
    (_, most), (low, high) = accepts.interval, rejects.interval
    for few, what, rate, kind in (
        (most > 2 * target_far, f"{motions} motions other than the actions", accepts, "accepts"),
        (
            rejects.of and high - low > _VAGUE,
            f"{rejects.of} examples that have others of their action",
            rejects,
            "rejects",
        ),
    ):
        if few:
            low, high = rate.interval
            notes.append(
                f"{what} are few: the rate of false {kind} may be anything from {low:.2f} to "
                f"{high:.2f}."
            )
    if 2 * rejects.count > rejects.of:
        notes.append(
            f"This threshold rejects {rejects.count} of {rejects.of} of your own examples. What "
            "is taken for an action without being one is better enrolled with `actioncli enroll "
            "--negative CLIP...` than kept out by a threshold."
        )
    near = [unknown & (trials.nearest == action) for action in range(count if per_action else 0)]
    taus = {
        label: _smallest(trials, asked, target_far)
        for label, asked in zip(trials.labels, near, strict=False)
        if trials.motions(asked) >= needed
    }
    actions = {label: smallest for label, smallest in taus.items() if smallest < 1}
    if per_action and len(actions) < count:
        notes.append(
            f"{count - len(actions)} of {count} actions have too few "
            f"other motions near them for a threshold of their own ({needed} are needed); the "
            "common one holds for them."
        )
    return Calibration(trials, target_far, tau, True, actions, tuple(notes))


def _smallest(trials: Trials, asked: NDArray[np.bool_], target_far: float) -> float:
    """The smallest threshold that holds the rate on enough queries (N,), rounded up.

    Accepting means score > tau, so it is the largest score that must not be accepted.
    """
    motions, scores = trials.motions(asked), np.sort(trials.score[asked])
    allowed = (target_far * (motions + 1) - 1) / motions * len(scores)
    accepted = min(floor(allowed + 1e-9), len(scores) - 1)
    bound = float(scores[-1 - accepted])
    step = ceil(bound * _STEPS)
    # The product may have been rounded down to a whole number.
    return (step if step / _STEPS >= bound else step + 1) / _STEPS
