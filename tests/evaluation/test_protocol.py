"""Whole evaluations with real scorers on made-up motions, and on recordings where they are."""

import dataclasses
import json
from pathlib import Path

import numpy as np
import pytest

from actioncli.clips.collection import Collection
from actioncli.clips.prepare import Preparation
from actioncli.errors import ClipError, UsageError
from actioncli.evaluation.baselines import AlwaysReject, Dtw, Random
from actioncli.evaluation.episodes import Protocol
from actioncli.evaluation.protocol import EpisodeScores, evaluate
from actioncli.evaluation.result import METRICS
from actioncli.evaluation.splits import Split, Splits, read_splits

from .conftest import collection

DEFAULT = Preparation(size="torso", heading=True)


@pytest.mark.parametrize("protocol", list(Protocol))
def test_dtw_solves_easy_motions(toy: Collection, protocol: Protocol) -> None:
    found = evaluate(Dtw(DEFAULT), [toy], ways=[3], episodes=10, protocol=protocol).results[0]
    assert found["closed_set_accuracy"].mean > 0.9
    assert found["auroc"].mean > 0.9
    assert found["oscr"].mean <= found["closed_set_accuracy"].mean


def test_a_random_scorer_gets_half_its_closed_set_accuracy(toy: Collection) -> None:
    found = evaluate(Random(0), [toy], ways=[4], episodes=300).results[0]
    closed = found["closed_set_accuracy"].mean
    assert closed == pytest.approx(1 / 4, abs=0.03)
    assert found["oscr"].mean == pytest.approx(closed / 2, abs=0.02)
    assert found["auroc"].mean == pytest.approx(0.5, abs=0.03)


def test_always_reject_is_measured_beside_every_scorer(toy: Collection) -> None:
    found = evaluate(AlwaysReject(), [toy], ways=[4], episodes=20).results[0]
    assert found["fsos_accuracy"] == found["always_reject_fsos_accuracy"]
    assert found["fsos_accuracy"].mean == 0.5
    assert found["oscr"].mean == pytest.approx(found["closed_set_accuracy"].mean / 2)
    assert found["false_accept_rate"].mean == 0
    assert found["false_reject_rate"].mean == 1


def test_same_seed_same_figures_whatever_else_is_measured(toy: Collection) -> None:
    other = collection("other", classes=5, seed=1)
    alone = evaluate(Dtw(DEFAULT), [toy], ways=[3], episodes=5, seed=7).results[0]
    beside = evaluate(Dtw(DEFAULT), [other, toy], ways=[2, 3], episodes=8, seed=7)
    again = next(r for r in beside.results if r.collection == "toy" and r.ways == 3)
    for name in METRICS:
        np.testing.assert_array_equal(alone.values[name], again.values[name][:5])


def test_too_few_classes_use_all_but_two_and_say_so(toy: Collection) -> None:
    found = evaluate(Random(0), [toy], ways=[3, 5, 10], episodes=4)
    assert [(r.ways, r.ways_used) for r in found.results] == [(3, 3), (5, 4), (10, 4)]
    assert found.results[1]["auroc"] == found.results[2]["auroc"]
    assert [mean.ways for mean in found.means] == [3, 5, 10]


def test_means_weigh_collections_alike_and_leave_out_small_ones(toy: Collection) -> None:
    collections = [toy, collection("large", people=8), collection("three", classes=3)]
    found = evaluate(Random(0), collections, ways=[2], episodes=30)
    mean = found.means[0]
    assert mean.collections == ("toy", "large")
    by_name = {r.collection: r for r in found.results}
    assert by_name["three"].ways_used == 1
    expected = (by_name["toy"]["auroc"].mean + by_name["large"]["auroc"].mean) / 2
    assert mean["auroc"].mean == pytest.approx(expected)
    assert mean["auroc"].std < by_name["toy"]["auroc"].std


def test_splits_choose_the_classes(toy: Collection) -> None:
    benchmark = tuple(f"action {i}" for i in (0, 2, 3, 5))
    splits = Splits("s.json", {"toy": Split(("action 1",), benchmark, ())})
    found = evaluate(Random(0), [toy], ways=[5], episodes=3, splits=splits).results[0]
    assert (found.classes, found.ways_used) == (4, 2)


def test_collections_that_cannot_be_measured_are_told(toy: Collection) -> None:
    nobody = dataclasses.replace(toy, subjects=("",) * len(toy.clips), name="nobody")
    single = collection("single", clips=1)
    found = evaluate(
        Random(0), [toy, nobody, single], ways=[2], episodes=2, protocol=Protocol.PERSONAL
    )
    assert [r.collection for r in found.results] == ["toy"]
    assert [skip.collection for skip in found.skipped] == ["nobody", "single"]
    assert "performer" in found.skipped[0].reason
    assert "no 2-way 1-shot episode of the personal protocol" in found.skipped[1].reason
    with pytest.raises(ClipError, match=r"nothing to measure.*nobody"):
        evaluate(Random(0), [nobody])


def test_senseless_arguments_are_refused(toy: Collection) -> None:
    with pytest.raises(UsageError, match="several collections are called toy"):
        evaluate(Random(0), [toy, toy])
    with pytest.raises(UsageError, match="at least 1"):
        evaluate(Random(0), [toy], episodes=0)


def test_progress_counts_to_its_total(toy: Collection) -> None:
    told: list[tuple[str, int, int]] = []
    evaluate(Random(0), [toy], ways=[2, 3], episodes=4, progress=lambda *step: told.append(step))
    done = [step[1] for step in told]
    assert done == sorted(done)
    assert told[-1][1] == told[-1][2] == len(toy.clips) + 2 * 4


def test_json_keys_are_stable(toy: Collection) -> None:
    found = evaluate(Dtw(DEFAULT), [toy], ways=[3], episodes=4, tau=0.6, seed=5)
    parsed = json.loads(json.dumps(found.to_json()))
    keys = ("scorer", "protocol", "shots", "episodes", "tau", "seed", "skipped")
    assert [parsed[key] for key in keys] == ["dtw", "cross-person", 1, 4, 0.6, 5, []]
    result = parsed["results"][0]
    keys_of_each = (
        "collection ways ways_used classes queries_per_episode metrics "
        "expected_calibration_error reliability"
    )
    assert set(result) == set(keys_of_each.split())
    assert set(result["metrics"]) == set(METRICS)
    assert set(result["metrics"]["oscr"]) == {"mean", "std"}
    assert set(result["reliability"][0]) == {"share", "confidence", "accuracy"}
    assert sum(row["share"] for row in result["reliability"]) == pytest.approx(1)
    assert parsed["means"][0]["collections"] == ["toy"]


def test_one_episode_by_hand() -> None:
    asked = EpisodeScores()
    distance = np.array([[1, 2], [2, 1], [3, 1], [1, 5], [4, 2]], np.float32)
    confidence = np.array([[0.9, 0], [0, 0.4], [0, 0.8], [0.7, 0], [0, 0.2]], np.float32)
    asked.add(distance, confidence, np.array([0, 1, 0, -1, -1]), tau=0.5)
    found = asked.result("hand", 2, 4)
    # right: the first, accepted, and the last, rejected
    assert found["fsos_accuracy"].mean == pytest.approx(2 / 5)
    assert found["always_reject_fsos_accuracy"].mean == pytest.approx(2 / 5)
    assert found["closed_set_accuracy"].mean == pytest.approx(2 / 3)
    assert found["auroc"].mean == pytest.approx(5 / 6)
    assert found["oscr"].mean == pytest.approx((2 + 1) / 6)
    assert found["fpr_at_95_tpr"].mean == pytest.approx(1 / 2)
    assert found["false_accept_rate"].mean == pytest.approx(1 / 2)
    assert found["false_reject_rate"].mean == pytest.approx(1 / 3)
    assert found.queries == 5


def test_figures_on_recordings(shared: Path) -> None:
    from actioncli.clips.collection import read_collection

    recordings = read_collection(shared / "data" / "utd_mhad.npz")
    splits = read_splits(shared / "data" / "splits.json")
    found = evaluate(Dtw(DEFAULT), [recordings], episodes=20, splits=splits).results[0]
    assert (found.classes, found.ways_used) == (6, 4)
    # far above chance, far from solved
    assert 0.6 < found["closed_set_accuracy"].mean < 0.95
    assert 0.55 < found["auroc"].mean < 0.95
