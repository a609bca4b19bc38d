"""The threshold that decides, and how a store keeps the one that `calibrate` measured."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from actioncli.errors import StoreError
from actioncli.store.names import check_label

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
        automatic: whether enrolment chose it, and may choose another; else the user did.
    """

    tau: float
    weights: str
    actions: Mapping[str, float] = field(default_factory=dict)
    automatic: bool = False

    def of(self, label: str) -> float:
        """The threshold of an action."""
        return self.actions.get(label, self.tau)

    def renamed(self, old: str, new: str) -> Threshold:
        """The same where the action `old` is called `new`."""
        actions = {label: tau for label, tau in self.actions.items() if label not in {old, new}}
        if old in self.actions:
            actions[new] = self.actions[old]
        return self if old == new else replace(self, actions=actions)

    def to_text(self) -> str:
        """What a store keeps."""
        chosen = {"automatic": True} if self.automatic else {}
        kept = {"tau": self.tau, "weights": self.weights, "actions": dict(self.actions)}
        return json.dumps(kept | chosen)

    @classmethod
    def from_text(cls, text: str, store: Path) -> Threshold:
        """What a store kept.

        Raises:
            StoreError: it is no threshold; names the store.
        """
        try:
            value: Any = json.loads(text)
            actions = {str(label): _checked(tau) for label, tau in value["actions"].items()}
            tau, chosen = _checked(value["tau"]), value.get("automatic") is True
            return cls(tau, str(value["weights"]), actions, chosen)
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


def rename_action(store: SupportStore, old: str, new: str) -> int:
    """Give an action another name, and its own threshold with it; how many examples it has.

    A threshold that an earlier action of the new name had goes; one that is damaged stays so.

    Raises:
        SupportError: the action is not enrolled.
        UsageError: the new name is not allowed, or is enrolled already.
        StoreError: the store cannot be written.
    """
    new, old = check_label(new), check_label(old)

    def renamed(text: str) -> str:
        try:
            return Threshold.from_text(text, store.path).renamed(old, new).to_text()
        except StoreError:
            return text

    return store.rename(old, new, {THRESHOLD_SETTING: renamed})


def _checked(tau: Any) -> float:
    if not 0 <= float(tau) <= 1:
        raise ValueError
    return float(tau)
