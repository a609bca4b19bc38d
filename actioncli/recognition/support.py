"""The support set: what is enrolled, read from a store at one moment and embedded once."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from actioncli.clips.clip import Clip, FloatArray
from actioncli.errors import SupportError
from actioncli.files import user_settings
from actioncli.recognition.decision import Decision
from actioncli.recognition.recognizer import Recognizer
from actioncli.recognition.threshold import DEFAULT_TAU, THRESHOLD_SETTING, Threshold
from actioncli.recognition.windows import mean_durations
from actioncli.store.examples import Example
from actioncli.store.store import SupportStore


@dataclass(frozen=True, slots=True, eq=False)
class SupportSet:
    """The enrolled actions and negatives, embedded, with the threshold that decides.

    Attributes:
        recognizer: what embeds and compares.
        actions: embeddings (n, F, E) of each action's examples, by label.
        negatives: embeddings (N, F, E) of what must never be accepted.
        durations: of each action the mean of its examples, seconds: what windows are cut by.
        threshold: what confidence must exceed.
        stored_threshold: the threshold that the store keeps, of whatever weights; None without,
            or where another one was given.
        examples: what the store holds, negatives too; empty without a store.
        recomputed: embeddings (F, E), by example, that the store does not hold for the weights.
    """

    recognizer: Recognizer
    actions: Mapping[str, FloatArray]
    negatives: FloatArray
    durations: Mapping[str, float]
    threshold: Threshold
    stored_threshold: Threshold | None = None
    examples: tuple[Example, ...] = ()
    recomputed: Mapping[int, FloatArray] = field(default_factory=dict)

    @classmethod
    def load(
        cls,
        store: SupportStore | str | Path | None = None,
        recognizer: Recognizer | None = None,
        tau: float | None = None,
    ) -> SupportSet:
        """Read a store, in one transaction; nothing is written.

        What has no embedding for the recogniser's weights is embedded in memory.

        Args:
            store: a store, or its file; the user's own where None.
            recognizer: with the weights that came with the package where None.
            tau: instead of the threshold that the store keeps, which then may be damaged.

        Raises:
            StoreError: the store, or its threshold, cannot be read.
            WeightsError: the weights cannot be read.
        """
        if not isinstance(store, SupportStore):
            store = SupportStore(store)
        recognizer = recognizer or Recognizer()
        checksum = recognizer.weights.checksum
        wanted = (THRESHOLD_SETTING,) if tau is None else ()
        found = store.snapshot(checksum, wanted)
        # Each by itself: an embedding does not depend on which clips came together.
        recomputed = {number: recognizer.embed([clip])[0] for number, clip in found.clips.items()}
        embeddings = {**found.embeddings, **recomputed}
        stored = None
        if THRESHOLD_SETTING in found.settings:
            stored = Threshold.from_text(found.settings[THRESHOLD_SETTING], store.path)
        if stored is not None and stored.weights == checksum:
            threshold = stored
        else:
            if tau is None:
                tau = user_settings().get("tau", DEFAULT_TAU)
            threshold = Threshold(tau, checksum)
        by_label: dict[str, list[int]] = {}
        for example in found.examples:
            by_label.setdefault("" if example.negative else example.label, []).append(example.id)
        # Ten thousand take 350 MB: each goes as soon as its copy stands beside those of its label.
        stacked = {
            label: np.stack([embeddings.pop(number) for number in numbers])
            for label, numbers in by_label.items()
        }
        negatives = stacked.pop("", None)
        return cls(
            recognizer=recognizer,
            actions=stacked,
            negatives=recognizer.embed([]) if negatives is None else negatives,
            durations=mean_durations(
                (each.label, each.seconds) for each in found.examples if not each.negative
            ),
            threshold=threshold,
            stored_threshold=stored,
            examples=found.examples,
            recomputed=recomputed,
        )

    @classmethod
    def from_clips(
        cls,
        actions: Mapping[str, Sequence[Clip]],
        recognizer: Recognizer | None = None,
        tau: float = DEFAULT_TAU,
        negatives: Sequence[Clip] = (),
    ) -> SupportSet:
        """Clips in memory, without a store.

        Args:
            actions: the examples of each action, at least one.

        Raises:
            ClipError: a clip lacks joints that the model reads.
            WeightsError: the weights cannot be read.
        """
        recognizer = recognizer or Recognizer()
        return cls(
            recognizer=recognizer,
            actions={label: recognizer.embed(clips) for label, clips in actions.items()},
            negatives=recognizer.embed(negatives),
            durations=mean_durations(
                (label, clip.duration) for label, clips in actions.items() for clip in clips
            ),
            threshold=Threshold(tau, recognizer.weights.checksum),
        )

    @property
    def foreign_threshold(self) -> Threshold | None:
        """The stored threshold, if it belongs to other weights and so does not count."""
        return None if self.stored_threshold is self.threshold else self.stored_threshold

    def with_tau(self, tau: float) -> SupportSet:
        """The same with another threshold for every action."""
        threshold = Threshold(tau, self.threshold.weights)
        return replace(self, threshold=threshold, stored_threshold=None)

    def require_actions(self) -> None:
        """Refuse to answer where nothing is enrolled.

        Raises:
            SupportError: no action is.
        """
        if not self.actions:
            raise SupportError(
                "the support set is empty; enrol an action first: actioncli enroll LABEL CLIP"
            )

    def classify(self, clip: Clip | FloatArray, whole: bool = False) -> Decision:
        """Name the action that a clip shows, or reject it.

        Args:
            clip: the query, or its embedding (F, E).
            whole: the clip is the action, and none is looked for in a part of it.

        Raises:
            ClipError: the clip lacks joints that the model reads.
            SupportError: no action is enrolled.
        """
        clips = [clip] if isinstance(clip, Clip) else np.asarray(clip)[np.newaxis]
        return self.classify_all(clips, whole)[0]

    def classify_all(
        self,
        clips: Sequence[Clip] | FloatArray,
        whole: bool = False,
        progress: Callable[[int, int], None] | None = None,
    ) -> list[Decision]:
        """`classify` for each of many clips; together they take a fraction of the time.

        Args:
            progress: see `Recognizer.classify_all`.

        Raises:
            ClipError, SupportError: as `classify`.
        """
        self.require_actions()
        durations = () if whole else self.durations.values()
        return self.recognizer.classify_all(
            clips, self.actions, self.threshold, self.negatives, durations, progress
        )
