"""The threshold that decides, and how a store keeps the one that `calibrate` measured."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from actioncli.errors import StoreError

if TYPE_CHECKING:
    from actioncli.recognition.decision import Decision
    from actioncli.store.store import SupportStore

# One setting holds it all, so that it is written and forgotten in one transaction.
THRESHOLD_SETTING = "threshold"


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
        accepted = decision.confidence > tau and not decision.negative_is_nearer
        label = decision.nearest if accepted else None
        return replace(decision, tau=tau, accepted=accepted, label=label)

    def to_text(self) -> str:
        """What a store keeps."""
        return json.dumps({"tau": self.tau, "weights": self.weights, "actions": dict(self.actions)})

    @classmethod
    def from_text(cls, text: str, store: Path) -> Threshold:
        """What a store kept.

        Raises:
            StoreError: it is no threshold; names the store.
        """
        try:
            value: Any = json.loads(text)
            actions = {str(label): _checked(tau) for label, tau in value["actions"].items()}
            return cls(_checked(value["tau"]), str(value["weights"]), actions)
        except (ValueError, TypeError, KeyError, AttributeError, RecursionError) as error:
            raise StoreError(
                f"{store}: the calibrated threshold is damaged; `actioncli calibrate --reset` "
                "forgets it."
            ) from error


def keep_threshold(store: SupportStore, threshold: Threshold | None) -> None:
    """Remember a threshold instead of the last one; None forgets it.

    Raises:
        StoreError: the store cannot be written.
    """
    store.set_setting(THRESHOLD_SETTING, None if threshold is None else threshold.to_text())


def _checked(tau: Any) -> float:
    if not 0 <= float(tau) <= 1:
        raise ValueError
    return float(tau)
