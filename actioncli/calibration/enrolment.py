"""The way into a support set: clips are kept as examples, and compared with what is there.

The warnings are how people notice a bad clip, or two actions that the skeleton cannot tell apart.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from actioncli.calibration.automatic import settle
from actioncli.clips.active import repetition_notes
from actioncli.clips.checks import require_usable
from actioncli.clips.clip import Clip, FloatArray
from actioncli.clips.edit import mirrored
from actioncli.clips.view import view_notes
from actioncli.errors import StoreError, UsageError
from actioncli.recognition.decision import Decision, compared
from actioncli.recognition.recognizer import Recognizer
from actioncli.recognition.support import SupportSet
from actioncli.recognition.threshold import DEFAULT_TAU, Threshold
from actioncli.store.names import NEGATIVES, check_label
from actioncli.store.store import SupportStore

# Of a threshold: less confident likenesses are not worth a warning.
_NOT_FAR = 0.5


@dataclass(frozen=True, slots=True)
class Enrolled:
    """What became of a clip.

    Attributes:
        example: its number in the store.
        label: as it is stored.
        added: False where the same clip was there already.
        warnings: what speaks against the example, sentences without a full stop.
        threshold: what became of the threshold, of the last clip that was added; see `automatic`.
    """

    example: int
    label: str
    added: bool
    warnings: tuple[str, ...] = ()
    threshold: str = ""

    @property
    def told(self) -> tuple[str, ...]:
        """All that is to be said."""
        return (*self.warnings, self.threshold) if self.threshold else self.warnings

    def to_json(self) -> dict[str, object]:
        """As plain values, without the label."""
        return {"example": self.example, "added": self.added, "warnings": list(self.warnings)}


class Examined(NamedTuple):
    """A clip that can be enrolled, and its embedding (F, E), empty without a recogniser."""

    clip: Clip
    embedding: FloatArray


def examined(recognizer: Recognizer | None, clip: Clip, negative: bool = False) -> Examined:
    """Look whether a clip can be enrolled.

    Raises:
        ClipError: it lacks joints that the model reads; or, as an example of an action, it shows
            none (see `checks.findings`), or little but what was not seen.
    """
    if not negative:
        require_usable(clip)
    if recognizer is None:
        return Examined(clip, np.empty((0, 0), np.float32))
    # Each by itself: an embedding does not depend on which clips came together.
    return Examined(clip, recognizer.embed([clip])[0])


def enrol(
    store: SupportStore,
    recognizer: Recognizer | None,
    label: str,
    clips: Sequence[Clip | Examined],
    note: str = "",
    negative: bool = False,
    either_side: bool = False,
    keep_tau: bool = False,
) -> list[Enrolled]:
    """Keep clips as examples of an action, all of them or none, with their embeddings.

    Examples that have no embedding for the recogniser's weights get one on this occasion.

    Args:
        recognizer: None keeps the clips without comparing them.
        label: name of the action; of no account with `negative`.
        note: kept with the examples.
        negative: the clips show what must never be accepted.
        either_side: the action counts with left and right exchanged, too: the mirror image of each
            clip becomes an example beside it.
        keep_tau: leave the threshold as it is.

    Returns:
        What became of each clip, mirror images last, with warnings about what it looks like beside
        all others. Where the store's content cannot be compared with, that is the only warning.

    Raises:
        UsageError: the label is not allowed.
        ClipError: as `examined`, or a clip is too large to keep.
        StoreError: the store cannot be written.
    """
    label = NEGATIVES if negative else check_label(label)
    found = [
        one if isinstance(one, Examined) else examined(recognizer, one, negative) for one in clips
    ]
    given = len(found)
    if either_side:
        found += [examined(recognizer, mirrored(clip), negative=True) for clip, _ in found]
    checksum, embeddings = "", list[FloatArray]()
    warnings: list[tuple[str, ...]] = [()] * len(found)
    support: SupportSet | None = None
    if recognizer is not None:
        checksum = recognizer.weights.checksum
        embeddings = [embedding for _, embedding in found]
        try:
            support = SupportSet.load(store, recognizer)
        except StoreError as error:
            # A damaged example, for instance, is no reason to refuse a new one.
            warnings = [(f"not compared with the others: {error}",)] * len(found)
    if support is not None and not negative:
        # What is unlike its own mirror image is no bad example.
        own = [*support.actions.get(label, ()), *embeddings[:given]]
        warnings[:given] = [
            tuple(_warnings(support, label, own, embedding)) for embedding in embeddings[:given]
        ]
    warnings = [
        about + view_notes(clip) + repetition_notes(clip)
        for about, (clip, _) in zip(warnings, found, strict=True)
    ]
    try:
        missing = support.recomputed if support is not None else None
        labelled = [(label, clip) for clip, _ in found]
        kept = store.enroll_all(labelled, note, negative, embeddings, checksum, missing)
    except UsageError as error:
        if not negative:
            raise
        raise UsageError(
            f"`{NEGATIVES}` is the name of an action here; give it another one first: "
            f"actioncli rename {NEGATIVES} NEW"
        ) from error
    enrolled = [
        Enrolled(one.example, one.label, one.added, about if one.added else ())
        for one, about in zip(kept, warnings, strict=True)
    ]
    added = [at for at, one in enumerate(kept) if one.added]
    if recognizer is not None and added and not keep_tau:
        last = enrolled[added[-1]]
        enrolled[added[-1]] = replace(last, threshold=settle(store, recognizer))
    return enrolled


def embed_missing(store: SupportStore, recognizer: Recognizer) -> int:
    """Keep an embedding of each example that has none for the recogniser's weights; how many.

    Raises:
        ClipError: an example lacks joints that the model reads.
        StoreError: the store cannot be read or written, or an example is damaged.
    """
    # A given tau leaves a stored threshold unread: it is not needed, and may be damaged.
    support = SupportSet.load(store, recognizer, tau=DEFAULT_TAU)
    if support.recomputed:
        store.keep_embeddings(recognizer.weights.checksum, support.recomputed)
    return len(support.recomputed)


def _warnings(
    support: SupportSet, label: str, own: Sequence[FloatArray], clip: FloatArray
) -> list[str]:
    """What speaks against an embedded clip beside all others, of which `own` are of its action."""
    rest = [other for other in own if not np.array_equal(other, clip)]
    actions = {name: examples for name, examples in support.actions.items() if name != label}
    if rest:
        actions[label] = np.stack(rest)
    if not actions:
        return []
    threshold = support.threshold
    decision = support.recognizer.classify(clip, actions, threshold, support.negatives)
    return enrolment_warnings(decision, label, threshold)


def enrolment_warnings(decision: Decision, label: str, threshold: Threshold) -> list[str]:
    """What speaks against an example of `label`, in sentences without a full stop.

    Args:
        decision: on the example, with the support set that lacks it.
        label: the action that it should show; it is not ranked where this is its only example.
        threshold: what confidence must exceed.
    """
    nearest = decision.ranking[0]
    confidence = {ranked.label: ranked.confidence for ranked in decision.ranking}
    own = confidence.pop(label, None)
    found = []

    def beside(other: str) -> str:
        return f"`{other}`: {compared(confidence[other], threshold.of(other))}"

    if own is not None and own <= threshold.of(label):
        about = compared(own, threshold.of(label))
        found.append(f"unlike the other examples of `{label}`: {about}")
    if own is not None and decision.negative_is_nearer:
        found.append("closest to a negative")
    if own is not None and nearest.label != label:
        # What lies far below the threshold is like nothing.
        if nearest.confidence > threshold.of(nearest.label) * _NOT_FAR:
            found.append(f"closest to {beside(nearest.label)}")
        return found
    like = max(confidence, key=lambda other: confidence[other], default=label)
    if like != label and confidence[like] > threshold.of(like):
        found.append(f"{'closest to' if own is None else 'also like'} {beside(like)}")
    return found
