"""Curves, histograms and confusions from the answers to queries."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from actioncli.evaluation import metrics
from actioncli.evaluation.confusions import worst_confusions
from actioncli.evaluation.curves import Pool, curves, histogram
from actioncli.evaluation.result import Answers


def answers(seed: int, n: int = 60, steps: int = 8) -> Answers:
    rng = np.random.default_rng(seed)
    known = np.arange(n) < n // 2
    score = (rng.integers(0, steps, n) / steps).astype(np.float32)
    hit = known & (rng.random(n) < 0.7)
    clips = rng.integers(0, 9, (2, n))
    return Answers(score, hit, known, clips[0], clips[1])


@given(st.integers(0, 10**6), st.integers(1, 40))
def test_areas_are_auroc_and_oscr(seed: int, steps: int) -> None:
    part = answers(seed, steps=steps)
    drawn = curves(Pool.of([part]), points=10**6)
    known, unknown = part.score[part.known], part.score[~part.known]
    area = np.trapezoid(drawn.accepted, drawn.false_accepts)
    assert area == pytest.approx(metrics.auroc(known, unknown))
    area = np.trapezoid(drawn.named, drawn.false_accepts)
    assert area == pytest.approx(metrics.oscr(known, part.hit[part.known], unknown))
    assert drawn.accepted[-1] == pytest.approx(1)
    assert (np.diff(drawn.false_accepts) >= 0).all()


def test_few_points_follow_the_curve() -> None:
    pool = Pool.of([answers(1, n=4000, steps=10**6)])
    few, all_ = curves(pool, 100), curves(pool, 10**6)
    assert len(few.tau) <= 100
    assert few.accepted[0] == few.false_accepts[0] == 0
    assert few.accepted[-1] == pytest.approx(1)
    at = np.interp(few.false_accepts, all_.false_accepts, all_.accepted)
    np.testing.assert_allclose(at, few.accepted, atol=0.02)


def test_collections_weigh_the_same_whatever_they_ask() -> None:
    one, two = answers(1, n=20), answers(2, n=400)
    pool = Pool.of([one, two])
    assert pool.weight[:20].sum() == pytest.approx(0.5)
    edges, known, unknown = histogram(pool, bins=4)
    assert edges.tolist() == [0, 0.25, 0.5, 0.75, 1]
    assert known.sum() == pytest.approx(1)
    assert unknown.sum() == pytest.approx(1)


def test_confusions_are_the_accepted_wrong_ones_worst_first() -> None:
    labels = {"c": ["a", "a", "b", "c"]}
    # a (clips 0, 1) taken for b twice of four times; c for b once of two; c for a is rejected.
    found = Answers(
        score=np.array([0.9, 0.8, 0.9, 0.2, 0.7, 0.4], np.float32),
        hit=np.array([False, False, True, True, False, False]),
        known=np.array([True, True, True, True, False, False]),
        query=np.array([0, 1, 0, 1, 3, 3]),
        nearest=np.array([2, 2, 1, 0, 2, 0]),
    )
    first, second = worst_confusions({"c": found}, labels, tau=0.5)
    assert (first.shown, first.taken_for, first.times, first.asked) == ("a", "b", 2, 4)
    assert (first.query, first.example) == (0, 2)
    assert first.confidence == pytest.approx(0.9)
    assert (second.shown, second.times, second.asked) == ("c", 1, 2)
    assert worst_confusions({"c": found}, labels, tau=0.5, limit=1) == [first]
