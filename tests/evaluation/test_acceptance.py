"""The matrix of which support set accepts which queries."""

from __future__ import annotations

import json

import numpy as np

from actioncli.clips.collection import Collection
from actioncli.clips.prepare import Preparation
from actioncli.evaluation.acceptance import Table, acceptance
from actioncli.evaluation.baselines import AlwaysReject, Dtw


def test_dtw_accepts_its_own_action_most(toy: Collection) -> None:
    scorer = Dtw(Preparation(size="torso", heading=True))
    probe = scorer.embed(toy.clips)
    same = scorer.compare(probe[:8], {"same": probe[:8]}).confidence
    (table,) = acceptance(scorer, [toy], episodes=5, tau=float(np.median(same)) - 0.06)
    assert table.classes == tuple(sorted(set(toy.labels)))
    assert table.rate.shape == (6, 6)
    own, others = table.rate.diagonal(), table.rate[~np.eye(6, dtype=bool)]
    assert own.mean() > others.mean() + 0.2
    assert (table.asked > 0).all()


def test_always_reject_accepts_nothing(toy: Collection) -> None:
    (table,) = acceptance(AlwaysReject(), [toy], episodes=2)
    assert not table.accepted.any()
    parsed = json.loads(json.dumps(table.as_json()))
    assert set(parsed) == {"collection", "classes", "rate", "asked"}
    assert parsed["rate"][0] == [0.0] * 6


def test_counts_go_to_the_row_enrolled_and_the_column_shown() -> None:
    table = Table("t", ["a", "b", "c"])
    accepted = np.array([[True, False], [True, True], [False, False]])
    table.add(["a", "c"], ["b", "b", "a"], accepted)
    found = table.acceptance()
    assert found.accepted.tolist() == [[0, 2, 0], [0, 0, 0], [0, 1, 0]]
    assert found.asked.tolist() == [[1, 2, 0], [0, 0, 0], [1, 2, 0]]
    assert found.as_json()["rate"][2] == [0.0, 0.5, None]
