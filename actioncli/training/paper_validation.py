"""Looks at validation classes during training: the same episodes each time, with inference code."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from actioncli.errors import UsageError
from actioncli.evaluation.metrics import auroc, oscr
from actioncli.model.weights import Weights
from actioncli.recognition.recognizer import Recognizer
from actioncli.training.data import TrainingSet
from actioncli.training.episodes import draw_episodes

WAYS = 3
EPISODES = 100


@dataclass(frozen=True, slots=True)
class Figures:
    """Means over all queries of the validation episodes.

    Attributes:
        closed_accuracy: share of known queries whose nearest action is right.
        auroc: of the confidence in the nearest action, known against unknown queries.
        oscr: area under correct classification against false positives.
        score: what decides which weights are best: OSCR, since it asks for both.
    """

    closed_accuracy: float
    auroc: float
    oscr: float
    score: float


class Validation:
    """Fixed one-shot open-set episodes over classes that training never sees."""

    def __init__(self, data: TrainingSet, seed: int) -> None:
        """Draw the episodes, 3-way, half of them within one collection.

        Args:
            data: clips of the validation classes.
            seed: of the episodes.

        Raises:
            UsageError: too few classes.
        """
        usable = sum(len(rows) > 1 for rows in data.members.values())
        if usable <= WAYS:
            raise UsageError(
                f"the collections have too few classes: of those with at least 2 clips {usable} "
                f"can be held out for validation, and it needs more than {WAYS}."
            )
        self.data = data
        drawn = draw_episodes(data, EPISODES, WAYS, np.random.default_rng([seed, 0x7A1]))
        used, at = np.unique(
            np.concatenate([drawn.support.ravel(), drawn.queries.ravel()]), return_inverse=True
        )
        self._clips = [data.clips[row] for row in used]
        self._support = at[: drawn.support.size].reshape(drawn.support.shape)
        self._queries = at[drawn.support.size :].reshape(drawn.queries.shape)
        self._targets = drawn.targets

    def figures(self, weights: Weights) -> Figures:
        """How well these weights do."""
        recognizer = Recognizer(weights)
        embeddings = recognizer.embed(self._clips)
        nearest, confidence = [], []
        for support, queries in zip(self._support, self._queries, strict=True):
            actions = {str(way): embeddings[[clip]] for way, clip in enumerate(support)}
            comparison = recognizer.compare(embeddings[queries], actions)
            chosen = comparison.distance.argmin(axis=1)
            nearest.append(chosen)
            confidence.append(np.take_along_axis(comparison.confidence, chosen[:, None], 1)[:, 0])
        known = self._targets >= 0
        right = (np.stack(nearest) == self._targets)[known]
        score = np.stack(confidence)
        area = oscr(score[known], right, score[~known])
        return Figures(float(right.mean()), auroc(score[known], score[~known]), area, area)
