"""The threshold that decides, and how a store keeps the one that `calibrate` measured."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

from actioncli.errors import StoreError

if TYPE_CHECKING:
    from actioncli.store.store import SupportStore

DEFAULT_TAU = 0.5
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


def kept_threshold(store: SupportStore) -> Threshold | None:
    """The threshold that a store keeps, of whatever weights.

    Raises:
        StoreError: the store cannot be read, or its threshold is damaged.
    """
    text = store.setting(THRESHOLD_SETTING)
    return None if text is None else Threshold.from_text(text, store.path)


def keep_threshold(store: SupportStore, threshold: Threshold | None) -> None:
    """Let a store keep a threshold in place of the last one; None forgets it.

    Raises:
        StoreError: the store cannot be written.
    """
    store.set_setting(THRESHOLD_SETTING, None if threshold is None else threshold.to_text())


def _checked(tau: Any) -> float:
    if not 0 <= float(tau) <= 1:
        raise ValueError
    return float(tau)
