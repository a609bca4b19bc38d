"""The face of the library: clips in, decisions out.

One clip's way: `prepare` → `trx_os.embed` → `compare` with each enrolled action → `decide`.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from actioncli.clips.clip import Clip, FloatArray
from actioncli.clips.prepare import prepare
from actioncli.errors import SupportError
from actioncli.model import compare
from actioncli.model.weights import Weights, read_weights

DEFAULT_TAU = 0.5


@dataclass(frozen=True, slots=True, eq=False)
class Comparison:
    """Q queries against K enrolled actions.

    Attributes:
        labels: (K,) names of the actions.
        distance: (Q, K) float32, smaller is more alike: T(Q, S) of the paper, or with the
            default recipe the odds against query and action being the same,
            1 / confidence - 1.
        confidence: (Q, K) float32 in [0, 1], that query q shows action k, whatever else is
            enrolled.
        probability: (Q, K) float32, among the enrolled actions alone: softmax of -T, or with
            the default recipe the odds divided by their sum; rows sum to 1.
    """

    labels: NDArray[np.str_]
    distance: FloatArray
    confidence: FloatArray
    probability: FloatArray


@dataclass(frozen=True, slots=True)
class Ranked:
    """One enrolled action as seen from a query; the fields are those of `Comparison`."""

    label: str
    distance: float
    probability: float
    confidence: float


@dataclass(frozen=True, slots=True)
class Decision:
    """What a clip shows.

    Attributes:
        label: the recognised action, or None where the clip is rejected.
        accepted: confidence > tau, and no negative is nearer than the nearest action.
        confidence: that the clip shows the nearest action, in [0, 1].
        tau: the threshold that was used.
        nearest: the nearest enrolled action, accepted or not.
        ranking: all enrolled actions, nearest first.
        notes: what reading the clip decided on the way, and whether a negative is nearest.
        nearest_negative: distance to the nearest negative; None where there are none.
    """

    label: str | None
    accepted: bool
    confidence: float
    tau: float
    nearest: str
    ranking: tuple[Ranked, ...]
    notes: tuple[str, ...] = ()
    nearest_negative: float | None = None

    @property
    def shadowed(self) -> bool:
        """Whether a negative is nearer than the nearest action, which rejects at any tau."""
        return (
            self.nearest_negative is not None and self.nearest_negative < self.ranking[0].distance
        )


class Recognizer:
    """One-shot open-set recognition with trained weights."""

    name = "trx-os"

    def __init__(self, weights: Weights | str | Path | None = None) -> None:
        """Take weights, or read them; without a path those that came with the package.

        Raises:
            WeightsError: the weights cannot be read.
        """
        self.weights = weights if isinstance(weights, Weights) else read_weights(weights)

    @property
    def cohort(self) -> FloatArray:
        """Other people's motions that came with the weights: embeddings (C, F, E), C may be 0."""
        cohort = self.weights.tensors.get("cohort")
        return self.embed([]) if cohort is None else cohort

    def embed(self, clips: Sequence[Clip]) -> FloatArray:
        """What comparison needs of each clip.

        Returns:
            (N, F, E) float32.

        Raises:
            ClipError: a clip lacks joints that the model reads.
        """
        config = self.weights.config
        frames = [prepare(clip, config.preparation) for clip in clips]
        joints = (config.preparation.frames, len(config.preparation.joints), 3)
        prepared = np.stack(frames) if frames else np.empty((0, *joints), np.float32)
        return compare.embed(self.weights.tensors, config, prepared)

    def compare(
        self,
        queries: Sequence[Clip] | FloatArray,
        support: Mapping[str, Sequence[Clip] | FloatArray],
    ) -> Comparison:
        """Compare queries with every enrolled action.

        Args:
            queries: Q clips, or their embeddings (Q, F, E).
            support: the examples of each action, clips or embeddings (n, F, E).

        Raises:
            SupportError: no action, or an action without examples.
        """
        if not support:
            raise SupportError("the support set is empty; enrol an action first.")
        query = self._embedded(queries)
        examples = [self._embedded(clips) for clips in support.values()]
        for label, embedding in zip(support, examples, strict=True):
            if not len(embedding):
                raise SupportError(f"the action {label!r} has no examples.")
        config = self.weights.config
        distance, logit = compare.scores(self.weights.tensors, config, query, examples)
        return Comparison(
            labels=np.array(list(support), dtype=np.str_),
            distance=distance,
            confidence=compare.sigmoid(logit),
            probability=compare.softmax(logit if config.warp_width else -distance),
        )

    def classify(
        self,
        clip: Clip | FloatArray,
        support: Mapping[str, Sequence[Clip] | FloatArray],
        tau: float = DEFAULT_TAU,
        negatives: Sequence[Clip] | FloatArray | None = None,
    ) -> Decision:
        """Find the nearest enrolled action and accept or reject it.

        Args:
            clip: the query, or its embedding (F, E).
            support: as in `compare`.
            tau: accept where the confidence is above it.
            negatives: what must never be accepted, N clips or embeddings (N, F, E), each an
                action of its own: a query that is nearer to one of them than to every enrolled
                action is rejected, whatever its confidence.

        Raises:
            SupportError: no action, or an action without examples.
        """
        query = self._embedded([clip]) if isinstance(clip, Clip) else clip[None]
        comparison = self.compare(query, support)
        order = np.argsort(comparison.distance[0], kind="stable")
        ranking = tuple(
            Ranked(
                str(comparison.labels[k]),
                float(comparison.distance[0, k]),
                float(comparison.probability[0, k]),
                float(comparison.confidence[0, k]),
            )
            for k in order
        )
        nearest = ranking[0]
        notes = clip.notes if isinstance(clip, Clip) else ()
        negative = None
        if negatives is not None and len(negatives):
            each = self._embedded(negatives)
            apart = self.compare(query, {str(n): each[n : n + 1] for n in range(len(each))})
            negative = float(apart.distance.min())
        shadowed = negative is not None and negative < nearest.distance
        if shadowed:
            notes += (
                f"nearer to a negative (distance {negative:.2f}) than to {nearest.label!r} "
                f"({nearest.distance:.2f})",
            )
        accepted = nearest.confidence > tau and not shadowed
        return Decision(
            label=nearest.label if accepted else None,
            accepted=accepted,
            confidence=nearest.confidence,
            tau=tau,
            nearest=nearest.label,
            ranking=ranking,
            notes=notes,
            nearest_negative=negative,
        )

    def _embedded(self, clips: Sequence[Clip] | FloatArray) -> FloatArray:
        return clips if isinstance(clips, np.ndarray) else self.embed(clips)
