"""How often the support set would accept what it must not, over tau: `calibrate`, for a slider."""

from __future__ import annotations

import threading
from collections.abc import Iterator, Sequence
from typing import Any

from actioncli.actions import Actions
from actioncli.calibration.threshold import calibrate
from actioncli.recognition.support import SupportSet

# Positions of the slider.
STEPS = 100
# Rate of false accepts that the recommended threshold holds, as in `calibrate`.
TARGET_FAR = 0.05


class _OutdatedError(Exception):
    """The support set has changed, or nobody wants to know any more."""


class Measurement:
    """Measures in the background, once for every state of the support set that is asked about."""

    def __init__(self, actions: Actions) -> None:
        """Nothing is measured until somebody asks."""
        self._actions = actions
        self._lock = threading.Lock()
        self._thread: threading.Thread | None = None
        self._wanted: list[tuple[str, bool, str]] | None = None
        self._found: dict[str, Any] = {}
        self._share = 0.0

    def state(self) -> dict[str, Any]:
        """The figures of the present support set, or how far measuring is; starts it.

        Keys: `state`, which is `nothing` (no action), `measuring` (with `share` done) or
        `measured`, with `rates` for tau = 0, 0.01, ..., 1, `recommended` and `notes`.

        Raises:
            StoreError: the store cannot be read.
        """
        loaded = self._actions.support
        if not loaded.actions:
            return {"state": "nothing"}
        # Another threshold, or embeddings that were written, change nothing that is measured.
        content = [(each.label, each.negative, each.checksum) for each in loaded.examples]
        with self._lock:
            if self._wanted != content:
                self._wanted, self._found, self._share = content, {}, 0.0
                self._thread = threading.Thread(
                    target=self._measure, args=(loaded, content), name="measure", daemon=True
                )
                self._thread.start()
            return self._found or {"state": "measuring", "share": self._share}

    def close(self) -> None:
        """Stop measuring."""
        with self._lock:
            self._wanted = None
            thread = self._thread
        if thread is not None:
            thread.join()

    def _measure(self, loaded: SupportSet, content: list[tuple[str, bool, str]]) -> None:
        recognizer = self._actions.recognizer

        def progress(numbers: Sequence[int]) -> Iterator[int]:
            for done, number in enumerate(numbers):
                with self._lock:
                    if self._wanted is not content:
                        raise _OutdatedError
                    self._share = done / len(numbers)
                yield number

        try:
            found = calibrate(loaded, recognizer.embed([]), TARGET_FAR, progress=progress)
        except _OutdatedError:
            return
        trials = found.trials
        rates = [
            {
                "false_accepts": trials.false_accepts(step / STEPS).to_json(),
                "false_rejects": trials.false_rejects(step / STEPS).to_json(),
                "misnamed": trials.misnamed(step / STEPS).to_json(),
            }
            for step in range(STEPS + 1)
        ]
        with self._lock:
            if self._wanted is content:
                self._found = {
                    "state": "measured",
                    "rates": rates,
                    "recommended": found.tau if found.measured else None,
                    "notes": list(found.notes),
                }
