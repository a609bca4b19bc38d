"""The way into a support set: clips are kept as examples, and compared with what is there.

The warnings are how people notice a bad clip, or two actions that the skeleton cannot tell apart.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from actioncli.clips.clip import Clip, FloatArray
from actioncli.errors import StoreError, UsageError
from actioncli.recognition.decision import Decision
from actioncli.recognition.recognizer import Recognizer
from actioncli.recognition.support import SupportSet
from actioncli.recognition.threshold import Threshold
from actioncli.store.names import NEGATIVES, check_label
from actioncli.store.store import SupportStore


@dataclass(frozen=True, slots=True)
class Enrolled:
    """What became of a clip.

    Attributes:
        example: its number in the store.
        label: as it is stored.
        added: False where the same clip was there already.
        warnings: what speaks against the example, sentences without a full stop.
    """

    example: int
    label: str
    added: bool
    warnings: tuple[str, ...] = ()

    def to_json(self) -> dict[str, object]:
        """As plain values, without the label."""
        return {"example": self.example, "added": self.added, "warnings": list(self.warnings)}


def enrol(
    store: SupportStore,
    recognizer: Recognizer | None,
    label: str,
    clips: Sequence[Clip],
    note: str = "",
    negative: bool = False,
) -> list[Enrolled]:
    """Keep clips as examples of an action, all of them or none, with their embeddings.

    Examples that have no embedding for the recogniser's weights get one on this occasion.

    Args:
        recognizer: None keeps the clips without comparing them.
        label: name of the action; of no account with `negative`.
        note: kept with the examples.
        negative: the clips show what must never be accepted.

    Returns:
        What became of each clip, with warnings about what it looks like beside all others. Where
        the store's content cannot be compared with, that is the only warning.

    Raises:
        UsageError: the label is not allowed.
        ClipError: a clip lacks joints that the model reads, or is too large to keep.
        StoreError: the store cannot be written.
    """
    label = NEGATIVES if negative else check_label(label)
    embeddings: list[FloatArray] = []
    warnings: list[tuple[str, ...]] = [()] * len(clips)
    support: SupportSet | None = None
    checksum = ""
    if recognizer is not None:
        checksum = recognizer.weights.checksum
        # Each by itself: an embedding does not depend on which clips came together.
        embeddings = [recognizer.embed([clip])[0] for clip in clips]
        try:
            support = SupportSet.load(store, recognizer)
        except StoreError as error:
            # A damaged example, for instance, is no reason to refuse a new one.
            warnings = [(f"not compared with the others: {error}",)] * len(clips)
        else:
            if not negative:
                warnings = _warnings_of_all(support, label, embeddings)
    try:
        kept = store.enroll_all(
            [(label, clip) for clip in clips], note, negative, embeddings, checksum
        )
    except UsageError as error:
        if not negative:
            raise
        raise UsageError(
            f"`{NEGATIVES}` is the name of an action here; give it another one first: "
            f"actioncli rename {NEGATIVES} NEW"
        ) from error
    if support is not None and support.recomputed:
        store.keep_embeddings(checksum, support.recomputed)
    return [
        Enrolled(one.example, one.label, one.added, about if one.added else ())
        for one, about in zip(kept, warnings, strict=True)
    ]


def _warnings_of_all(
    support: SupportSet, label: str, embeddings: Sequence[FloatArray]
) -> list[tuple[str, ...]]:
    """For each new clip, what it looks like beside all others, new ones included."""
    actions = dict(support.actions)
    own = [*actions.pop(label, ()), *embeddings]
    found = []
    for clip in embeddings:
        rest = [other for other in own if not np.array_equal(other, clip)]
        beside = {**actions, label: np.stack(rest)} if rest else actions
        if beside:
            decision = support.recognizer.classify(
                clip, beside, support.threshold.tau, support.negatives
            )
            found.append(tuple(enrolment_warnings(decision, label, support.threshold)))
        else:
            found.append(())
    return found


def enrolment_warnings(decision: Decision, label: str, threshold: Threshold) -> list[str]:
    """What speaks against an example of `label`.

    Args:
        decision: on the example, with the support set that lacks it.
        label: the action that it should show; it is not ranked where this is its only example.
        threshold: what confidence must exceed.

    Returns:
        Sentences without a full stop; none where all is well.
    """
    own = next((ranked for ranked in decision.ranking if ranked.label == label), None)
    found = []
    if own is not None and own.confidence <= threshold.of(label):
        found.append(f"unlike the other examples of `{label}`, {own.confidence:.2f}")
    if own is not None and decision.negative_is_nearer:
        found.append("closest to a negative")
    nearest = decision.ranking[0]
    if own is not None and nearest.label != label:
        found.append(f"closest to `{nearest.label}`, {nearest.confidence:.2f}")
        return found
    others = [ranked for ranked in decision.ranking if ranked.label != label]
    like = max(others, key=lambda ranked: ranked.confidence, default=None)
    if like is not None and like.confidence > threshold.of(like.label):
        close = "closest to" if own is None else "also like"
        found.append(f"{close} `{like.label}`, {like.confidence:.2f}")
    return found
