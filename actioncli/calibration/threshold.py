"""Which threshold suits a support set, from the false accepts and rejects that `trials` counts."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from math import ceil, floor

import numpy as np

from actioncli.calibration.trials import KINDS, Queries, Trials
from actioncli.recognition.threshold import DEFAULT_TAU

# Thresholds of the table; its resolution is that of what people would choose by hand.
TAUS = tuple(step / 20 for step in range(1, 20))

# Recommended thresholds are rounded up to this many steps: no more digits than can be measured.
_STEPS = 1000

# An interval that is wider than this is worth a sentence.
_VAGUE = 0.3


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
