"""The threshold that enrolment chooses by itself, where what is enrolled asks for one.

At the usual 0.5 about one in a hundred of other people's motions is taken for a given action, but
of the same person's similar motions many more. So whenever clips are added, the support set is put
to the trials of `calibrate`: from the second example of an action on, and before that where another
action or a negative is taken for an action, or clearly too many of the motions that came with the
weights are, the threshold is raised. Never so far that it would reject an example that its own
action's others recognise, but for one in ten; never below 0.5; and what the user set stays.

Over eight collections, five actions of one person and 0.5 against what is chosen: with two examples
each 155 and 93 of 583 clips of the person's other actions are accepted, and 253 and 248 of 273 of
the right ones; with three 188 and 75 of 585, and 128 and 128 of 132. Of other people's right ones
399 and 365 of 518, and 400 and 345 of 513.
"""

from __future__ import annotations

from math import ceil, floor

import numpy as np

from actioncli.calibration.threshold import recommend
from actioncli.calibration.trials import KNOWN, Trials, run_trials
from actioncli.errors import StoreError
from actioncli.recognition.recognizer import Recognizer
from actioncli.recognition.support import SupportSet
from actioncli.recognition.threshold import DEFAULT_TAU, Threshold, keep_threshold
from actioncli.store.store import SupportStore

TARGET_FAR = 0.05
# With more examples the trials take longer than anybody waits for an enrolment.
MOST_EXAMPLES = 60
# Where nothing tells what the right ones reach, and of those that tell how many may be odd.
_MOST_TAU, _ODD = 0.9, 0.1
# A threshold so little beside the present one is not worth a word.
_LITTLE = 0.02
_RECORD = "record more examples, or keep clips of other motions with `actioncli enroll --negative`"


def settle(store: SupportStore, recognizer: Recognizer) -> str:
    """Choose and keep the threshold that suits what a store holds; what was done in a sentence
    without a full stop, empty where nothing was.

    Raises:
        StoreError: the threshold cannot be kept.
    """
    try:
        support = SupportSet.load(store, recognizer)
    except StoreError:
        return ""  # who enrols was told
    kept, checksum = support.stored_threshold, recognizer.weights.checksum
    own = kept is not None and not kept.automatic
    if not support.actions or (own and kept is not support.threshold):
        return ""
    if len(support.examples) > MOST_EXAMPLES:
        if own:
            return ""
        return (
            f"tau stays {support.threshold.tau:g}: with more than {MOST_EXAMPLES} examples, "
            "`actioncli calibrate` chooses it"
        )
    trials = run_trials(recognizer, support.actions, support.negatives, recognizer.embed([]))
    tau, why = suited(trials)
    if own:
        now = trials.false_accepts([support.threshold.of(label) for label in trials.labels])
        if tau <= support.threshold.tau + _LITTLE or not now.count:
            return ""
        return (
            f"tau stays {support.threshold.tau:g}, as you set it: {now.count} of {now.of} motions "
            "that are none of the actions are accepted; `actioncli calibrate` measures another"
        )
    if abs(tau - (DEFAULT_TAU if kept is None else kept.tau)) < _LITTLE:
        return why if tau == DEFAULT_TAU else ""
    if tau == DEFAULT_TAU:
        keep_threshold(store, None)
        return f"tau is {tau:g} again{'; ' * bool(why)}{why}"
    keep_threshold(store, Threshold(tau, checksum, automatic=True))
    return f"tau is {tau:g} from now on: {why}"


def suited(trials: Trials) -> tuple[float, str]:
    """The threshold that suits a support set, `DEFAULT_TAU` or above, and why: a clause, empty
    where nothing speaks against the usual one."""
    usual = trials.false_accepts(DEFAULT_TAU)
    said = f"at {DEFAULT_TAU:g}, {usual.count} of {usual.of} motions that are none are accepted"
    taken = trials.accepted(DEFAULT_TAU)
    shown = [kind for kind in ("actions", "negatives") if (taken & (trials.kind == kind)).any()]
    others = trials.false_accepts(DEFAULT_TAU, "cohort")
    repeated = max(trials.examples) > 1
    if not (repeated or shown or others.interval[0] > TARGET_FAR):
        return DEFAULT_TAU, ""
    found = recommend(trials, TARGET_FAR)
    right = (trials.kind == KNOWN) & (trials.nearest == trials.shown) & taken
    sure = np.sort(trials.score[right])
    most = _MOST_TAU
    if len(sure):
        # Just below it, so that it is accepted.
        most = min(most, (ceil(float(sure[floor(_ODD * len(sure))]) * 1000 - 0.01) - 1) / 1000)
    if not found.measured and not (shown and trials.score.max() >= 1):
        if not shown:
            return DEFAULT_TAU, ""
        return DEFAULT_TAU, f"{said}, and a better one cannot be told from so little: {_RECORD}"
    wanted = found.tau if found.measured else 1.0
    tau = max(DEFAULT_TAU, min(wanted, most))
    left = trials.false_accepts(tau).count
    if tau == DEFAULT_TAU:
        if wanted <= DEFAULT_TAU or not usual.count:
            return tau, ""
        return tau, f"{said}, but a higher one would reject your own examples: {_RECORD}"
    if wanted > tau:
        said = f"{said}, still {left} are: {_RECORD}"
    elif not repeated:
        said += ", and a second example of each would tell whether it rejects too much"
    return tau, said
