"""Warping many pairs at once gives what warping each by the recurrence gives."""

import numpy as np
import pytest

from actioncli.evaluation.warping import warping_cost


def one_by_one(a: np.ndarray, b: np.ndarray) -> float:
    cheapest = np.full((len(a) + 1, len(b) + 1), np.inf)
    cheapest[0, 0] = 0
    for i, j in np.ndindex(len(a), len(b)):
        steps = cheapest[i, j + 1], cheapest[i + 1, j], cheapest[i, j]
        cheapest[i + 1, j + 1] = np.linalg.norm(a[i] - b[j]) + min(steps)
    return float(2 * cheapest[-1, -1] / (len(a) + len(b)))


@pytest.mark.parametrize("frames", [(16, 16), (3, 7), (7, 3), (1, 5), (1, 1)])
def test_agrees_with_the_recurrence(frames: tuple[int, int]) -> None:
    rng = np.random.default_rng(0)
    queries, supports = (
        rng.normal(size=(count, length, 15)) for count, length in zip((4, 3), frames, strict=True)
    )
    expected = [[one_by_one(query, support) for support in supports] for query in queries]
    np.testing.assert_allclose(warping_cost(queries, supports), expected, rtol=1e-4)


def test_many_supports_are_split_into_blocks() -> None:
    rng = np.random.default_rng(0)
    queries, supports = rng.normal(size=(3, 4, 6)), rng.normal(size=(700, 4, 6))
    whole = warping_cost(queries, supports)
    parts = [warping_cost(queries[q : q + 1], supports[:50]) for q in range(3)]
    np.testing.assert_allclose(whole[:, :50], np.concatenate(parts), rtol=1e-5)


def test_a_warped_copy_is_nearer_than_its_reverse() -> None:
    time = np.linspace(0, 1, 16)
    path = np.stack([time, time**2, 0 * time], axis=-1)[None]
    slow_start = np.stack([time**2, time**4, 0 * time], axis=-1)[None]
    warped, straight = warping_cost(path, slow_start)[0, 0], np.abs(path - slow_start).mean()
    assert warped < straight
    assert warped < warping_cost(path, path[:, ::-1])[0, 0]
    assert warping_cost(path, path)[0, 0] == pytest.approx(0, abs=1e-3)
    assert warping_cost(path, slow_start) == pytest.approx(warping_cost(slow_start, path))


def test_no_queries_or_no_supports_give_an_empty_table() -> None:
    some = np.zeros((2, 4, 15), np.float32)
    assert warping_cost(some[:0], some).shape == (0, 2)
    assert warping_cost(some, some[:0]).shape == (2, 0)
