"""What is enrolled, as decisions take it: embeddings, negatives and threshold of a store."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from actioncli.clips.clip import FloatArray
from actioncli.errors import SupportError
from actioncli.recognizer import DEFAULT_TAU, Recognizer
from actioncli.store.store import SupportStore
from actioncli.threshold import Threshold, kept_threshold


@dataclass(frozen=True, slots=True, eq=False)
class Enrolment:
    """All that a store says about a query.

    Attributes:
        support: embeddings (n, F, E) of each action's examples.
        negatives: embeddings (N, F, E) of what must never be accepted.
        threshold: what confidence must exceed.
        kept: the threshold that the store keeps, of whatever weights; None without, or where
            another one was given.
        durations: seconds, the mean of each action's examples.
    """

    support: dict[str, FloatArray]
    negatives: FloatArray
    threshold: Threshold
    kept: Threshold | None
    durations: list[float]

    @property
    def foreign(self) -> Threshold | None:
        """The kept threshold, if it belongs to other weights and so does not count."""
        return None if self.kept is self.threshold else self.kept


def read_enrolment(
    store: SupportStore, recognizer: Recognizer, tau: float | None = None
) -> Enrolment:
    """Read a store; what is not embedded yet is embedded.

    Args:
        tau: instead of the threshold that the store keeps, which then may be damaged.

    Raises:
        SupportError: nothing is enrolled.
        StoreError: the store cannot be read.
    """
    support = store.embeddings(recognizer.weights.checksum, recognizer.embed)
    if not support:
        raise SupportError(
            "the support set is empty; enrol an action first: actioncli enroll LABEL CLIP"
        )
    negatives = stored_negatives(store, recognizer)
    if tau is None:
        threshold, kept = used_threshold(store, recognizer)
    else:
        threshold, kept = Threshold(tau, recognizer.weights.checksum), None
    actions = [action for action in store.actions() if not action.negative]
    durations = [action.seconds / action.examples for action in actions]
    return Enrolment(support, negatives, threshold, kept, durations)


def stored_negatives(store: SupportStore, recognizer: Recognizer) -> FloatArray:
    """Embeddings (N, F, E) of the clips that must never be accepted.

    Raises:
        StoreError: the store cannot be read.
    """
    kept = store.embeddings(recognizer.weights.checksum, recognizer.embed, negative=True)
    return np.concatenate([recognizer.embed([]), *kept.values()])


def used_threshold(
    store: SupportStore, recognizer: Recognizer
) -> tuple[Threshold, Threshold | None]:
    """The threshold that is kept, if it was measured with the recogniser's weights, else the
    default; and what is kept, if anything is.

    Raises:
        StoreError: the store cannot be read, or its threshold is damaged.
    """
    checksum = recognizer.weights.checksum
    kept = kept_threshold(store)
    if kept is not None and kept.weights == checksum:
        return kept, kept
    return Threshold(DEFAULT_TAU, checksum), kept
