"""Measure a scorer on episodes of collections."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from actioncli.clips.clip import FloatArray
from actioncli.errors import ClipError, UsageError
from actioncli.evaluation import metrics
from actioncli.evaluation.episodes import Indices, Protocol, possible_ways
from actioncli.evaluation.result import METRICS, Evaluation, Result, mean_result
from actioncli.evaluation.splits import Splits
from actioncli.evaluation.task import Progress, Scorer, Steps, Task, possible

if TYPE_CHECKING:
    from actioncli.clips.collection import Collection


def evaluate(
    scorer: Scorer,
    collections: Sequence[Collection],
    *,
    ways: Sequence[int] = (5,),
    shots: int = 1,
    episodes: int = 100,
    protocol: Protocol = Protocol.CROSS_PERSON,
    tau: float = 0.5,
    seed: int = 0,
    splits: Splits | None = None,
    progress: Progress | None = None,
) -> Evaluation:
    """Run episodes on the benchmark classes of collections.

    Args:
        scorer: what is measured; it embeds each clip once.
        collections: with different names.
        ways: numbers K of enrolled classes; a collection with fewer than K + 2 classes uses all
            but two.
        shots: support clips per class.
        episodes: per collection and number of ways.
        protocol: who enrols and who asks.
        tau: accept means confidence > tau.
        seed: of the episodes, which do not depend on the scorer.
        splits: names the benchmark classes; without it all classes are drawn from.
        progress: told about every step.

    Raises:
        ClipError: not one collection can be measured; the message has the reasons.
        UsageError: the splits do not fit the collections, or a number below 1.
    """
    if min([shots, episodes, *ways]) < 1:
        raise UsageError("ways, shots and episodes must be at least 1.")

    def ways_of(collection: Collection) -> tuple[Task, dict[int, int]]:
        task = Task.of(collection, splits, protocol, shots, seed)
        used = {asked: possible_ways(asked, len(task.classes)) for asked in ways}
        if min(used.values()) < 1:
            raise ClipError(
                f"{task.name}: {len(task.classes)} classes leave none to enrol beside two unknown."
            )
        for k in set(used.values()):
            task.sampler.episode(k, 0)  # raises where the collection is too thin
        return task, used

    tasks, skipped = possible(collections, ways_of)
    step = Steps(
        progress,
        sum(len(task.clips) + episodes * len(set(used.values())) for task, used in tasks),
    )
    results: list[Result] = []
    for task, used in tasks:
        embedded = task.embed(scorer, step)
        ran = {k: _run(scorer, task, embedded, k, episodes, tau, step) for k in set(used.values())}
        # several numbers of ways may come down to the same one
        results += [replace(ran[k], ways=asked) for asked, k in used.items()]
    means = [mean_result(r for r in results if r.ways == asked) for asked in dict.fromkeys(ways)]
    return Evaluation(
        scorer=scorer.name,
        protocol=str(protocol),
        shots=shots,
        episodes=episodes,
        tau=tau,
        seed=seed,
        results=tuple(results),
        means=tuple(mean for mean in means if mean is not None),
        skipped=tuple(skipped),
    )


class EpisodeScores:
    """Gathers the scores of one episode after the other."""

    def __init__(self) -> None:
        """Start with none."""
        self._values: list[dict[str, float]] = []
        self._scores: list[FloatArray] = []
        self._hits: list[NDArray[np.bool_]] = []

    def add(
        self, distance: FloatArray, confidence: FloatArray, target: Indices, tau: float
    ) -> None:
        """Measure an episode.

        Args:
            distance: (Q, K) to each enrolled action; the smallest decides, the first of equals.
            confidence: (Q, K) that the query shows the action.
            target: (Q,) index of the action it shows, -1 for none of them.
            tau: accept means confidence > tau.
        """
        nearest = distance.argmin(axis=1)
        score = confidence[np.arange(len(nearest)), nearest]
        hit = nearest == target
        enrolled = target >= 0
        right, inside, outside = hit[enrolled], score[enrolled], score[~enrolled]
        self._values.append(
            {
                "fsos_accuracy": metrics.fsos_accuracy(inside, right, outside, tau),
                "always_reject_fsos_accuracy": metrics.always_reject_accuracy(
                    len(inside), len(outside)
                ),
                "closed_set_accuracy": metrics.closed_set_accuracy(right),
                "auroc": metrics.auroc(inside, outside),
                "oscr": metrics.oscr(inside, right, outside),
                "fpr_at_95_tpr": metrics.fpr_at_tpr(inside, outside),
                "false_accept_rate": metrics.false_accept_rate(outside, tau),
                "false_reject_rate": metrics.false_reject_rate(inside, tau),
            }
        )
        self._scores.append(score)
        self._hits.append(hit)

    def result(self, collection: str, ways: int, classes: int) -> Result:
        """What all episodes together say."""
        score, hit = np.concatenate(self._scores), np.concatenate(self._hits)
        return Result(
            collection=collection,
            ways=ways,
            ways_used=ways,
            classes=classes,
            queries=len(score) / len(self._values),
            values={name: np.array([v[name] for v in self._values]) for name in METRICS},
            reliability=metrics.reliability(score, hit),
        )


def _run(
    scorer: Scorer,
    task: Task,
    embedded: NDArray[Any],
    ways: int,
    episodes: int,
    tau: float,
    step: Steps,
) -> Result:
    scores = EpisodeScores()
    for number in range(episodes):
        episode = task.sampler.episode(ways, number)
        support = {
            label: embedded[clips]
            for label, clips in zip(episode.labels, episode.support, strict=True)
        }
        compared = scorer.compare(embedded[episode.queries], support)
        scores.add(compared.distance, compared.confidence, episode.target, tau)
        step(f"{task.name}: {ways}-way")
    return scores.result(task.name, ways, len(task.classes))
