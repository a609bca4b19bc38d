"""Looks at validation classes while a model trains, and what its confidence means."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from actioncli.clips.clip import FloatArray
from actioncli.errors import UsageError
from actioncli.evaluation.metrics import auroc, oscr
from actioncli.model import parts
from actioncli.model.config import Config, PartsConfig
from actioncli.model.weights import Weights
from actioncli.recognition.recognizer import Recognizer
from actioncli.training.data import Indices, TrainingSet, query_of

EPISODES = 240
MOST_WAYS = 4
# Clips that are compared with one another to find out what a confidence means, and how many of
# each class at most.
_PAIRED, _OF_CLASS = 256, 6
# Share of clips of something else that a confidence of 0.5 takes for a given action.
WRONG_AT_HALF = 0.01


class Validation:
    """Fixed one-shot open-set episodes over classes that training never sees, asked by the code
    of inference."""

    def __init__(self, data: TrainingSet, config: Config, seed: int) -> None:
        """Draw the episodes.

        Two of three take their classes from one collection, up to `MOST_WAYS` of them, and as many
        queries of none as there are classes left; queries are of other performers where they are.

        Raises:
            UsageError: too few classes.
        """
        self._config, self._data = config, data
        # As long as nothing is fitted, a confidence is the sigmoid of the logit as it is.
        shapes = parts.fitted_shapes(config) if isinstance(config, PartsConfig) else {}
        self._unfitted = {name: np.ones(shape, np.float32) for name, shape in shapes.items()}
        self._unfitted["confidence.shift"] = np.zeros(1, np.float32)
        rng = np.random.default_rng([seed, 0x7A1])
        usable = [label for label, rows in data.members.items() if len(rows) > 1]
        of_source: dict[int, list[int]] = {}
        for label in usable:
            of_source.setdefault(int(data.collections[data.members[label][0]]), []).append(label)
        several = [labels for labels in of_source.values() if len(labels) > 1]
        if len(usable) < 2 or not several:
            raise UsageError("too few classes can be held out for validation.")
        chances = np.array([len(labels) for labels in several]) / sum(map(len, several))
        drawn: list[tuple[Indices, Indices, Indices]] = []
        for episode in range(EPISODES):
            pool = several[int(rng.choice(len(several), p=chances))] if episode % 3 else usable
            order = rng.permutation(pool)
            ways = min(MOST_WAYS, len(pool) - 1)
            support = [int(rng.choice(data.members[label])) for label in order[:ways].tolist()]
            asked = [
                query_of(data, data.members[label], np.int64(row), rng)
                for label, row in zip(order.tolist(), support, strict=False)
            ]
            others = order[ways : 2 * ways].tolist()
            asked += [np.int64(rng.choice(data.members[label])) for label in others]
            targets = np.where(np.arange(len(asked)) < ways, np.arange(len(asked)), -1)
            drawn.append((np.array(support), np.array(asked), targets))
        self._paired = np.concatenate(
            [rng.permutation(data.members[label])[:_OF_CLASS] for label in usable]
        )
        self._paired = rng.permutation(self._paired)[:_PAIRED]
        used = np.unique(np.concatenate([np.concatenate(each[:2]) for each in drawn]))
        self._clips = [data.clips[row] for row in used]
        self._episodes = [
            (np.searchsorted(used, support), np.searchsorted(used, asked), targets)
            for support, asked, targets in drawn
        ]

    def _recognizer(self, tensors: Mapping[str, FloatArray]) -> Recognizer:
        return Recognizer(Weights(self._config, {**self._unfitted, **tensors}, {}, "", Path()))

    def _compared(
        self, tensors: Mapping[str, FloatArray]
    ) -> list[tuple[FloatArray, FloatArray, Indices]]:
        """Of each episode distance and confidence (queries, ways), and the targets (queries,)."""
        recognizer = self._recognizer(tensors)
        embedded = recognizer.embed(self._clips)
        found = []
        for support, asked, targets in self._episodes:
            actions = {str(way): embedded[[clip]] for way, clip in enumerate(support)}
            compared = recognizer.compare(embedded[asked], actions)
            found.append((compared.distance, compared.confidence, targets))
        return found

    def figures(self, tensors: Mapping[str, FloatArray]) -> dict[str, float]:
        """Closed accuracy, AUROC and OSCR over all queries; the score is OSCR, since it asks for
        both."""
        nearest, surest, answers = [], [], []
        for distance, confidence, targets in self._compared(tensors):
            nearest.append(distance.argmin(axis=1))
            surest.append(np.take_along_axis(confidence, nearest[-1][:, None], axis=1)[:, 0])
            answers.append(targets)
        target, score = np.concatenate(answers), np.concatenate(surest)
        enrolled = target >= 0
        right = (np.concatenate(nearest) == target)[enrolled]
        area = oscr(score[enrolled], right, score[~enrolled])
        return {
            "closed_accuracy": float(right.mean()),
            "auroc": auroc(score[enrolled], score[~enrolled]),
            "oscr": area,
            "score": area,
        }

    def confidence(self, tensors: Mapping[str, FloatArray]) -> dict[str, NDArray[Any]]:
        """The map from logit to confidence, sigmoid(scale · logit + shift): over pairs of clips of
        all classes the scale of the logistic regression, right and wrong pairs of equal weight, and
        the shift that puts `WRONG_AT_HALF` of the wrong ones above 0.5.

        Args:
            tensors: what training learned, without such a map.
        """
        recognizer = self._recognizer(tensors)
        embedded = recognizer.embed([self._data.clips[row] for row in self._paired])
        each = {str(place): embedded[[place]] for place in range(len(embedded))}
        # The model is symmetric, so each pair is asked once.
        of = np.triu_indices(len(embedded), k=1)
        logits = -np.log(recognizer.compare(embedded, each).distance[of])
        label = self._data.labels[self._paired]
        own = label[of[0]] == label[of[1]]
        bound = np.quantile(logits[~own], 1 - WRONG_AT_HALF)
        weight = np.where(own, 0.5 / own.sum(), 0.5 / (~own).sum())
        signs = np.where(own, -1, 1)
        scale = min(
            (float(weight @ np.logaddexp(0, signs * scale * (logits - middle))), scale)
            for scale in np.geomspace(0.1, 5, 30).tolist()
            for middle in np.quantile(logits, np.linspace(0.3, 0.99, 30)).tolist()
        )[1]
        return {
            "confidence.scale": np.array([scale], np.float32),
            "confidence.shift": np.array([-scale * bound], np.float32),
        }
