"""The support set as a page needs it: what the commands do, by the same functions."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from actioncli.actions import Actions
from actioncli.recognition.recognizer import Recognizer
from actioncli.report.figure import figure
from actioncli.report.page import playable
from actioncli.store.store import SupportStore


class SharedSupport(Actions):
    """A store and a recogniser. May be used from several threads, beside other processes."""

    def __init__(self, path: Path | None = None) -> None:
        """Open a store; nothing is created.

        Raises:
            StoreError: it cannot be a store.
            WeightsError: the weights cannot be used.
        """
        super().__init__(SupportStore(path), Recognizer())

    def state(self) -> dict[str, Any]:
        """All that is enrolled, in words."""
        version, support = self.version, self.support
        actions: dict[str, dict[str, Any]] = {}
        for each in support.examples:
            action = actions.setdefault(
                each.label, {"label": each.label, "negative": each.negative, "examples": []}
            )
            action["examples"].append(each.to_json())
        return {
            "version": version,
            "store": str(self.store.path),
            "actions": list(actions.values()),
            "tau": support.threshold.tau,
            "kept": support.stored_threshold is support.threshold,
            "automatic": support.threshold.automatic,
            "own": len(support.threshold.actions),
        }

    def figure(self, example: int) -> dict[str, Any]:
        """What a player shows of an example.

        Raises:
            SupportError: there is no such example.
        """
        return playable(figure(self.store.clip(example)))
