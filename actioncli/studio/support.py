"""The support set as a page needs it: what the commands do, by the same functions."""

from __future__ import annotations

import threading
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from actioncli.clips.clip import Clip, FloatArray
from actioncli.decision import Decision
from actioncli.enrolment import stored_negatives, used_threshold
from actioncli.errors import UsageError
from actioncli.likeness import doubts
from actioncli.recognizer import Recognizer
from actioncli.report.figure import figure
from actioncli.report.page import playable
from actioncli.store.names import NEGATIVES, check_label
from actioncli.store.store import Enrolled, Example, SupportStore
from actioncli.threshold import Threshold, keep_threshold


@dataclass(frozen=True, slots=True, eq=False)
class Loaded:
    """What is enrolled at one moment, as the recogniser takes it.

    Attributes:
        content: label, kind and checksum of every example.
        support: embeddings (n, F, E) of each action.
        negatives: (N, F, E).
        durations: of the examples of actions, seconds.
        lasting: of each action, the mean of them.
    """

    content: tuple[tuple[str, bool, str], ...]
    support: dict[str, FloatArray]
    negatives: FloatArray
    durations: tuple[float, ...]
    lasting: tuple[float, ...]


class SupportSet:
    """A store and a recogniser. May be used from several threads, beside other processes.

    Attributes:
        store: where examples are kept.
        recognizer: what compares.
    """

    def __init__(self, path: Path | None = None) -> None:
        """Open a store; nothing is created.

        Raises:
            StoreError: it cannot be a store.
            WeightsError: the weights cannot be used.
        """
        self.store = SupportStore(path)
        self.recognizer = Recognizer()
        self._lock = threading.Lock()
        self._loaded: Loaded | None = None
        self._seen = ""

    def version(self) -> str:
        """Changes when the store does, whoever changes it."""
        try:
            status = self.store.path.stat()
        except OSError:
            return "none"
        return f"{status.st_ino:x}-{status.st_mtime_ns:x}-{status.st_size:x}"

    def loaded(self) -> Loaded:
        """What is enrolled now.

        Raises:
            StoreError: the store cannot be read.
        """
        with self._lock:
            version = self.version()
            if self._loaded is None or self._seen != version:
                examples = self.store.examples()
                content = tuple((e.label, e.negative, e.checksum) for e in examples)
                # A threshold that is kept, for instance, changes the store and not what it holds.
                if self._loaded is None or self._loaded.content != content:
                    self._loaded = self._load(examples, content)
                self._seen = version
            return self._loaded

    def _load(
        self, examples: Sequence[Example], content: tuple[tuple[str, bool, str], ...]
    ) -> Loaded:
        checksum, embed = self.recognizer.weights.checksum, self.recognizer.embed
        return Loaded(
            content,
            self.store.embeddings(checksum, embed),
            stored_negatives(self.store, self.recognizer),
            tuple((e.frames - 1) / e.fps for e in examples if not e.negative),
            tuple(a.seconds / a.examples for a in self.store.actions() if not a.negative),
        )

    def threshold(self) -> tuple[Threshold, bool]:
        """The threshold in use, and whether it was kept, by a page or by `calibrate`."""
        threshold, kept = used_threshold(self.store, self.recognizer)
        return threshold, threshold is kept

    def keep_tau(self, tau: float | None) -> None:
        """Use this threshold from now on, here and in the commands; None is the default."""
        checksum = self.recognizer.weights.checksum
        keep_threshold(self.store, None if tau is None else Threshold(tau, checksum))

    def state(self) -> dict[str, Any]:
        """All that is enrolled, in words."""
        version = self.version()
        threshold, kept = self.threshold()
        actions: dict[str, dict[str, Any]] = {}
        for each in self.store.examples():
            action = actions.setdefault(
                each.label, {"label": each.label, "negative": each.negative, "examples": []}
            )
            action["examples"].append(
                {
                    "id": each.id,
                    "source": each.source,
                    "seconds": (each.frames - 1) / each.fps,
                    "added": each.added,
                    "note": each.note,
                }
            )
        return {
            "version": version,
            "store": str(self.store.path),
            "actions": list(actions.values()),
            "tau": threshold.tau,
            "kept": kept,
            "own": len(threshold.actions),
        }

    def figure(self, example: int) -> dict[str, Any]:
        """What a player shows of an example.

        Raises:
            SupportError: there is no such example.
        """
        return playable(figure(self.store.clip(example)))

    def classify(self, clip: Clip, whole: bool) -> Decision | None:
        """What a clip shows; None where nothing is enrolled.

        Args:
            whole: whether the clip is the action, and none is looked for in a part of it.
        """
        loaded = self.loaded()
        if not loaded.support:
            return None
        threshold, _ = self.threshold()
        durations = () if whole else loaded.lasting
        decision = self.recognizer.classify(
            clip, loaded.support, threshold.tau, loaded.negatives, durations
        )
        return threshold.apply(decision)

    def enroll(
        self, label: str, clip: Clip, embedding: FloatArray, negative: bool, note: str = ""
    ) -> tuple[Enrolled, list[str]]:
        """Keep a clip, as an example of an action or as what must never be accepted.

        Args:
            label: of the action; of no account with `negative`.
            embedding: (F, E) of the clip.

        Returns:
            What became of it, and warnings about what it looks like beside all others.

        Raises:
            UsageError: the label is not allowed.
        """
        label = NEGATIVES if negative else check_label(label)
        warnings = [] if negative else self._doubts(label, embedding)
        try:
            enrolled = self.store.enroll(label, clip, note, negative)
        except UsageError as error:
            if not negative:
                raise
            raise UsageError(
                f"`{NEGATIVES}` is the name of an action here; give it another one first."
            ) from error
        return enrolled, warnings if enrolled.added else []

    def _doubts(self, label: str, embedding: FloatArray) -> list[str]:
        loaded = self.loaded()
        if not loaded.support:
            return []
        threshold, _ = self.threshold()
        decision = self.recognizer.classify(
            embedding, loaded.support, threshold.tau, loaded.negatives
        )
        return doubts(decision, label, threshold)
