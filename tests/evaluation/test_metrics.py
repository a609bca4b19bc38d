"""Metrics against their definitions, by brute force and by their invariances."""

import itertools
from collections.abc import Callable

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from actioncli.evaluation import metrics

# Few distinct values make ties common, which is where shortcuts go wrong.
scores = st.integers(1, 12).flatmap(
    lambda n: hnp.arrays(np.float64, n, elements=st.sampled_from([0.0, 0.25, 0.3, 0.5, 0.9, 1.0]))
)


@st.composite
def answers(draw: st.DrawFn) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    known = draw(scores)
    correct = draw(hnp.arrays(np.bool_, known.size))
    return known, correct, draw(scores)


def curve_area(known: np.ndarray, correct: np.ndarray, unknown: np.ndarray) -> float:
    """Area under (accepted and right, unknown accepted) through every distinct threshold."""
    points = [(0.0, 0.0)] + [
        (float(np.mean(unknown >= threshold)), float(np.mean(correct & (known >= threshold))))
        for threshold in sorted({*known, *unknown}, reverse=True)
    ]
    return sum((b[0] - a[0]) * (a[1] + b[1]) / 2 for a, b in itertools.pairwise(points))


@given(answers())
def test_oscr_is_the_area_under_its_curve(case: tuple[np.ndarray, ...]) -> None:
    assert metrics.oscr(*case) == pytest.approx(curve_area(*case))


@given(answers())
def test_auroc_is_the_area_under_the_roc(case: tuple[np.ndarray, ...]) -> None:
    known, _, unknown = case
    expected = curve_area(known, np.ones(known.size, bool), unknown)
    assert metrics.auroc(known, unknown) == pytest.approx(expected)


@given(answers())
def test_no_scorer_exceeds_its_closed_set_accuracy(case: tuple[np.ndarray, ...]) -> None:
    known, correct, unknown = case
    closed = metrics.closed_set_accuracy(correct)
    assert 0 <= metrics.oscr(known, correct, unknown) <= closed
    # and the bound is reached by a scorer that puts all known queries above all unknown ones
    assert metrics.oscr(known + 2, correct, unknown) == pytest.approx(closed)


@given(answers(), st.sampled_from([0.0, 0.3, 0.7]))
def test_constant_score_gets_half_the_closed_set_accuracy(
    case: tuple[np.ndarray, ...], score: float
) -> None:
    known, correct, unknown = case
    area = metrics.oscr(np.full(known.size, score), correct, np.full(unknown.size, score))
    assert area == pytest.approx(metrics.closed_set_accuracy(correct) / 2)


@given(answers())
def test_monotone_maps_of_the_score_change_nothing(case: tuple[np.ndarray, ...]) -> None:
    known, correct, unknown = case

    def bent(score: np.ndarray) -> np.ndarray:
        return np.exp(3 * score) - 7

    assert metrics.auroc(bent(known), bent(unknown)) == metrics.auroc(known, unknown)
    assert metrics.fpr_at_tpr(bent(known), bent(unknown)) == metrics.fpr_at_tpr(known, unknown)
    assert metrics.oscr(bent(known), correct, bent(unknown)) == metrics.oscr(
        known, correct, unknown
    )


@given(answers(), st.sampled_from([0.5, 0.8, 0.95, 1.0]))
def test_fpr_at_tpr_is_the_best_admissible_threshold(
    case: tuple[np.ndarray, ...], tpr: float
) -> None:
    known, _, unknown = case
    admissible = [t for t in {*known, *unknown} if np.mean(known >= t) >= tpr - 1e-12]
    expected = min(float(np.mean(unknown >= t)) for t in admissible)
    assert metrics.fpr_at_tpr(known, unknown, tpr) == pytest.approx(expected)


def test_fpr_at_95_percent_lets_one_known_query_in_twenty_go() -> None:
    known = np.arange(1, 21) / 20
    assert metrics.fpr_at_tpr(known, [0.05, 0.06, 0.2]) == pytest.approx(1 / 3)
    assert metrics.fpr_at_tpr(np.arange(40), [1.5, 2, 2.5]) == pytest.approx(2 / 3)
    # 100 * 0.07 is a hair above 7 in binary.
    assert metrics.fpr_at_tpr(np.arange(100), [92.5, 93, 94], tpr=0.07) == pytest.approx(2 / 3)


def test_fpr_where_no_known_query_must_pass_is_that_of_the_surest() -> None:
    assert metrics.fpr_at_tpr([0.2, 0.3, 0.4], [0.35, 0.4, 0.5, 0.1], tpr=0) == 0.5


@given(answers(), st.sampled_from([0.0, 0.25, 0.4, 0.5, 1.0]))
def test_fsos_accuracy_counts_right_answers(case: tuple[np.ndarray, ...], tau: float) -> None:
    known, correct, unknown = case
    right = sum(bool(s > tau and c) for s, c in zip(known, correct, strict=True))
    right += sum(bool(s <= tau) for s in unknown)
    total = known.size + unknown.size
    assert metrics.fsos_accuracy(known, correct, unknown, tau) == pytest.approx(right / total)


@given(answers())
def test_rejecting_all_scores_the_share_of_unknown_queries(case: tuple[np.ndarray, ...]) -> None:
    known, correct, unknown = case
    expected = metrics.always_reject_accuracy(known.size, unknown.size)
    assert metrics.fsos_accuracy(known * 0, correct, unknown * 0, tau=0.0) == expected


def test_false_rates_accept_strictly_above_tau() -> None:
    assert metrics.false_accept_rate([0.4, 0.5, 0.6, 0.7], 0.5) == 0.5
    assert metrics.false_reject_rate([0.4, 0.5, 0.6, 0.7], 0.5) == 0.5


@given(answers())
def test_calibration_error_is_a_mean_over_bins(case: tuple[np.ndarray, ...]) -> None:
    score, hit, _ = case
    expected = 0.0
    for low in range(10):
        inside = (score >= low / 10) & ((score < (low + 1) / 10) | (low == 9))
        if inside.any():
            expected += inside.mean() * abs(hit[inside].mean() - score[inside].mean())
    table = metrics.reliability(score, hit)
    assert table.ece == pytest.approx(expected)
    assert 0 <= table.ece <= 1
    assert table.count.sum() == score.size


def test_calibration_error_of_calibrated_and_of_overconfident_scores() -> None:
    hit = np.arange(1000) % 4 != 0
    assert metrics.reliability(np.full(1000, 0.75), hit).ece == pytest.approx(0)
    assert metrics.reliability(np.ones(1000), hit).ece == pytest.approx(0.25)


def test_confidences_are_sorted_into_equal_bins() -> None:
    table = metrics.reliability([0.0, 0.25, 0.8, 1.0], [False, True, True, True], bins=4)
    assert table.count.tolist() == [1, 1, 0, 2]
    assert table.confidence.tolist() == [0, 0.25, 0, 1.8]
    assert table.hits.tolist() == [0, 1, 0, 2]
    assert metrics.reliability([0.05], [True]).count.tolist() == [1] + [0] * 9


def test_single_precision_moves_no_score_over_the_edge_of_its_bin() -> None:
    # 0.7 in float32 is a hair below 0.7, though ten times it rounds to 7.
    score = np.float32([0.7])
    assert float(score[0]) < 0.7
    assert metrics.reliability(score, [True]).count.tolist() == [0] * 6 + [1] + [0] * 3


def test_pooling_weighs_tables_alike() -> None:
    exact = metrics.reliability([1.0] * 100, [True] * 100)
    wrong = metrics.reliability([0.75, 0.25], [False, True], bins=10)
    both = metrics.pooled([exact, wrong])
    assert both.count.tolist() == [0, 0, 0.5, 0, 0, 0, 0, 0.5, 0, 1]
    assert both.confidence.tolist() == [0, 0, 0.125, 0, 0, 0, 0, 0.375, 0, 1]
    assert both.hits.tolist() == [0, 0, 0.5, 0, 0, 0, 0, 0, 0, 1]
    assert both.ece == pytest.approx((0.375 + 0.375) / 2)


@pytest.mark.parametrize(
    ("measure", "what"),
    [
        (lambda: metrics.closed_set_accuracy([]), "known"),
        (lambda: metrics.auroc([], [0.5]), "known"),
        (lambda: metrics.auroc([0.5], []), "unknown"),
        (lambda: metrics.oscr([0.5], [True], []), "unknown"),
        (lambda: metrics.fpr_at_tpr([], [0.5]), "known"),
        (lambda: metrics.fpr_at_tpr([0.5], []), "unknown"),
        (lambda: metrics.false_accept_rate([], 0.5), "unknown"),
        (lambda: metrics.false_reject_rate([], 0.5), "known"),
        (lambda: metrics.reliability([], []), "scored"),
    ],
)
def test_nothing_to_measure_is_an_error(measure: Callable[[], object], what: str) -> None:
    with pytest.raises(ValueError, match=f"^no {what} queries to measure$"):
        measure()


def test_lists_of_whole_numbers_are_scores_too() -> None:
    assert metrics.fsos_accuracy([1, 0], [1, 1], [0, 1], 0.5) == 0.5
