"""Which actions were taken for which, and the clips with which it happened."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from actioncli.evaluation.result import Answers


@dataclass(frozen=True, slots=True)
class Confusion:
    """Queries that show one action and were accepted as another.

    Attributes:
        collection: where.
        shown: the class that the queries show, enrolled or not.
        taken_for: the enrolled action under whose label they were accepted.
        times: how many queries of all episodes.
        asked: how many queries that show this class there were, whatever was enrolled.
        confidence: of the surest of them.
        query: number of the surest one's clip in the collection.
        example: number of the enrolled clip that it was taken for.
    """

    collection: str
    shown: str
    taken_for: str
    times: int
    asked: int
    confidence: float
    query: int
    example: int


def worst_confusions(
    answers: Mapping[str, Answers],
    labels: Mapping[str, Sequence[str]],
    tau: float,
    limit: int = 10,
) -> list[Confusion]:
    """Pairs of classes in the order of how often they were confused, worst first.

    Args:
        answers: of each collection, with the numbers of clips.
        labels: of each collection's clips.
        tau: accept means score > tau.
        limit: how many pairs are wanted.
    """
    found = []
    for name, given in answers.items():
        shown = [labels[name][clip] for clip in given.query]
        wrong = np.flatnonzero((given.score > tau) & ~given.hit)
        by_pair: dict[tuple[str, str], list[int]] = {}
        for answer in wrong:
            pair = shown[answer], labels[name][given.nearest[answer]]
            by_pair.setdefault(pair, []).append(int(answer))
        for (one, other), pair_answers in by_pair.items():
            surest = max(pair_answers, key=lambda answer: given.score[answer])
            found.append(
                Confusion(
                    collection=name,
                    shown=one,
                    taken_for=other,
                    times=len(pair_answers),
                    asked=shown.count(one),
                    confidence=float(given.score[surest]),
                    query=int(given.query[surest]),
                    example=int(given.nearest[surest]),
                )
            )
    return sorted(found, key=lambda each: each.times / each.asked, reverse=True)[:limit]
