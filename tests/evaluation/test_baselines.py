"""Baselines answer as their names say, through the interface of a recogniser."""

import numpy as np
import pytest

from actioncli.clips.collection import Collection
from actioncli.clips.prepare import Preparation
from actioncli.errors import SupportError
from actioncli.evaluation.baselines import AlwaysReject, Dtw, Random
from actioncli.evaluation.task import Scorer

DEFAULT = Preparation(size="torso", heading=True)


def scorers(toy: Collection) -> list[Scorer]:
    return [Dtw(DEFAULT), Dtw(DEFAULT, toy.clips[-8:]), AlwaysReject(), Random(1)]


def test_every_scorer_gives_a_comparison(toy: Collection) -> None:
    for scorer in scorers(toy):
        embedded = scorer.embed(toy.clips)
        assert len(embedded) == len(toy.clips)
        support = {"b": embedded[:2], "a": embedded[8:11], "c": embedded[16:17]}
        compared = scorer.compare(embedded[20:25], support)
        assert compared.labels.tolist() == ["b", "a", "c"]
        for table in (compared.distance, compared.confidence, compared.probability):
            assert table.shape == (5, 3)
            assert table.dtype == np.float32
        assert (compared.confidence >= 0).all()
        assert (compared.confidence <= 1).all()
        np.testing.assert_allclose(compared.probability.sum(axis=1), 1, rtol=1e-5)


def test_a_column_depends_on_its_own_action_only(toy: Collection) -> None:
    for scorer in scorers(toy)[:3]:
        embedded = scorer.embed(toy.clips)
        both = scorer.compare(embedded[20:25], {"a": embedded[:3], "b": embedded[8:9]})
        alone = scorer.compare(embedded[20:25], {"b": embedded[8:9]})
        np.testing.assert_allclose(both.distance[:, 1], alone.distance[:, 0], rtol=1e-5)
        np.testing.assert_allclose(both.confidence[:, 1], alone.confidence[:, 0], rtol=1e-5)


def test_every_scorer_refuses_an_empty_support_set(toy: Collection) -> None:
    for scorer in scorers(toy):
        embedded = scorer.embed(toy.clips[:3])
        with pytest.raises(SupportError, match="support set is empty"):
            scorer.compare(embedded, {})
        with pytest.raises(SupportError, match="'a' has no examples"):
            scorer.compare(embedded, {"a": embedded[:0]})


def test_dtw_takes_the_nearest_of_several_examples(toy: Collection) -> None:
    scorer = Dtw(DEFAULT)
    embedded = scorer.embed(toy.clips)
    pairs = scorer.compare(embedded[:4], {str(i): embedded[i : i + 1] for i in range(8, 12)})
    together = scorer.compare(embedded[:4], {"all": embedded[8:12]})
    np.testing.assert_allclose(together.distance[:, 0], pairs.distance.min(axis=1), rtol=1e-5)


def test_dtw_finds_the_action(toy: Collection) -> None:
    for scorer in (Dtw(Preparation()), Dtw(DEFAULT), Dtw(DEFAULT, toy.clips[-8:])):
        embedded = scorer.embed(toy.clips)
        first = {toy.labels[i]: embedded[i : i + 1] for i in range(0, len(toy.clips), 8)}
        compared = scorer.compare(embedded, first)
        nearest = compared.labels[compared.distance.argmin(axis=1)]
        assert np.mean(nearest == np.array(toy.labels)) > 0.8


def test_the_cohort_puts_the_unlike_below_one_half(toy: Collection) -> None:
    # the cohort shows the same kind of motion, so its members are nearer than another action
    scorer = Dtw(DEFAULT, toy.clips[:8])
    embedded = scorer.embed(toy.clips[8:32])
    compared = scorer.compare(embedded[:1], {"same": embedded[1:8], "other": embedded[8:]})
    assert compared.distance[0, 0] < compared.distance[0, 1]
    assert compared.confidence[0, 0] > compared.confidence[0, 1]
    np.testing.assert_allclose(compared.confidence, 1 / (1 + compared.distance), rtol=1e-5)


def test_random_guesses_follow_from_the_seed(toy: Collection) -> None:
    nothing = Random(3).embed(toy.clips)
    support = {"a": nothing[:1], "b": nothing[:2]}
    one, same, other = (Random(seed).compare(nothing, support) for seed in (3, 3, 4))
    np.testing.assert_array_equal(one.distance, same.distance)
    np.testing.assert_array_equal(one.confidence, same.confidence)
    assert not np.array_equal(one.distance, other.distance)
    assert not np.array_equal(one.distance, one.confidence)
