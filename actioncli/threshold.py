"""The threshold that `calibrate` measured, remembered beside the examples it was measured on."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any

from actioncli.errors import StoreError

if TYPE_CHECKING:
    from actioncli.decision import Decision
    from actioncli.store.store import SupportStore

# One setting holds it all, so that it is written and forgotten in one transaction.
_SETTING = "threshold"


@dataclass(frozen=True, slots=True)
class Threshold:
    """What confidence must exceed.

    Attributes:
        tau: for every action that has none of its own.
        weights: checksum of the weights whose confidences it was measured on; it says nothing
            about those of others.
        actions: thresholds of single actions, by label.
    """

    tau: float
    weights: str
    actions: Mapping[str, float] = field(default_factory=dict)

    def of(self, label: str) -> float:
        """The threshold of an action."""
        return self.actions.get(label, self.tau)

    def apply(self, decision: Decision) -> Decision:
        """The decision under the threshold of its nearest action."""
        tau = self.of(decision.nearest)
        accepted = decision.confidence > tau and not decision.shadowed
        label = decision.nearest if accepted else None
        return replace(decision, tau=tau, accepted=accepted, label=label)


def keep_threshold(store: SupportStore, threshold: Threshold | None) -> None:
    """Remember a threshold instead of the last one; None forgets it.

    Raises:
        StoreError: the store cannot be written.
    """
    if threshold is not None:
        store.set_setting(
            _SETTING,
            json.dumps(
                {
                    "tau": threshold.tau,
                    "weights": threshold.weights,
                    "actions": dict(threshold.actions),
                }
            ),
        )
    else:
        store.set_setting(_SETTING, None)


def kept_threshold(store: SupportStore) -> Threshold | None:
    """The threshold that was remembered, if there is one.

    Raises:
        StoreError: the store cannot be read, or holds no threshold in that place.
    """
    text = store.setting(_SETTING)
    if text is None:
        return None
    try:
        value: Any = json.loads(text)
        actions = {str(label): _checked(tau) for label, tau in value["actions"].items()}
        return Threshold(_checked(value["tau"]), str(value["weights"]), actions)
    except (ValueError, TypeError, KeyError, AttributeError, RecursionError) as error:
        raise StoreError(
            f"{store.path}: the calibrated threshold is damaged; `actioncli calibrate --reset` "
            "forgets it."
        ) from error


def _checked(tau: Any) -> float:
    if not 0 <= float(tau) <= 1:
        raise ValueError
    return float(tau)
