"""Looks at validation classes while the parts model trains, and the meaning of its confidence."""

from __future__ import annotations

import numpy as np

from actioncli.clips.clip import FloatArray
from actioncli.clips.parts import prepare_parts
from actioncli.errors import UsageError
from actioncli.evaluation.metrics import auroc, oscr
from actioncli.model import parts, parts_tokens
from actioncli.model.arrays import Params
from actioncli.model.parts_config import PartsConfig
from actioncli.training.data import Indices, TrainingSet

EPISODES = 240
MOST_WAYS = 4
# Share of clips of something else that a confidence of 0.5 takes for a given action.
WRONG_AT_HALF = 0.01


class PartsValidation:
    """Fixed one-shot open-set episodes over classes that training never sees."""

    def __init__(self, data: TrainingSet, config: PartsConfig, seed: int) -> None:
        """Prepare the clips and draw the episodes.

        Two of three take their classes from one collection, up to `MOST_WAYS` of them, and as many
        queries of none as there are classes left; queries are of other performers where they are.
        """
        self.data, self._config = data, config
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
            queries = [_query(data, data.members[label], np.int64(row), rng)
                       for label, row in zip(order.tolist(), support, strict=False)]  # fmt: skip
            others = order[ways : 2 * ways].tolist()
            queries += [np.int64(rng.choice(data.members[label])) for label in others]
            targets = np.where(np.arange(len(queries)) < ways, np.arange(len(queries)), -1)
            drawn.append((np.array(support), np.array(queries), targets))
        used = np.unique(np.concatenate([np.concatenate(each[:2]) for each in drawn]))
        self._episodes = [
            (np.searchsorted(used, support), np.searchsorted(used, queries), targets)
            for support, queries, targets in drawn
        ]
        self._tokens = parts_tokens.tokens(
            config, *prepare_parts([data.clips[row] for row in used], config.preparation)
        )

    def _logits(self, params: Params) -> list[tuple[FloatArray, Indices]]:
        """Of each episode the logits (queries, ways), and the targets (queries,)."""
        embedded = parts.embed(params, self._config, self._tokens)

        def rows(of: Indices) -> parts.Embedded:
            return parts.Embedded(*(x[:, of] for x in embedded))

        return [
            (parts.logits(params, self._config, rows(queries), rows(support)), targets)
            for support, queries, targets in self._episodes
        ]

    def figures(self, params: Params) -> dict[str, float]:
        """Closed accuracy, AUROC and OSCR over all queries; the score is OSCR."""
        found = self._logits(params)
        best = np.concatenate([logits.max(axis=1) for logits, _ in found])
        nearest = np.concatenate([logits.argmax(axis=1) for logits, _ in found])
        targets = np.concatenate([targets for _, targets in found])
        known = targets >= 0
        right = (nearest == targets)[known]
        area = oscr(best[known], right, best[~known])
        return {
            "closed_accuracy": float(right.mean()),
            "auroc": auroc(best[known], best[~known]),
            "oscr": area,
            "score": area,
        }

    def confidence(self, params: Params) -> dict[str, FloatArray]:
        """The map from logit to confidence, sigmoid(scale · logit + shift): the scale of the
        logistic regression on pairs, right and wrong ones of equal weight, and the shift that puts
        `WRONG_AT_HALF` of the wrong ones above 0.5."""
        found = self._logits(params)
        logits = np.concatenate([each.ravel() for each, _ in found])
        own = np.concatenate(
            [(targets[:, None] == np.arange(each.shape[1])).ravel() for each, targets in found]
        )
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


def _query(
    data: TrainingSet, rows: Indices, support: np.int64, rng: np.random.Generator
) -> np.int64:
    others = rows[data.subjects[rows] != data.subjects[support]]
    return np.int64(rng.choice(others if len(others) else rows[rows != support]))
