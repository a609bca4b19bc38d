"""Episodes keep the rules of their protocol whatever the collection looks like."""

import numpy as np
import pytest
from cases import cases
from hypothesis import given, settings
from hypothesis import strategies as st

from actioncli.errors import ClipError
from actioncli.evaluation.episodes import QUERIES_PER_CLASS, Protocol, Sampler, possible_ways


def regular(classes: int, people: int, clips: int) -> tuple[list[str], list[str]]:
    """Labels and subjects of a collection in which everybody does everything `clips` times."""
    rows = [(f"c{c}", f"p{p}") for c in range(classes) for p in range(people) for _ in range(clips)]
    return [label for label, _ in rows], [person for _, person in rows]


collections = st.lists(
    st.tuples(st.sampled_from("abcdefg"), st.sampled_from("PQRST")), min_size=20, max_size=80
)


@settings(max_examples=cases(40))
@given(
    collections,
    st.integers(1, 4),
    st.sampled_from([1, 2, 3]),
    st.sampled_from(list(Protocol)),
    st.integers(0, 2**32),
)
def test_rules_hold_on_any_collection(
    rows: list[tuple[str, str]], ways: int, shots: int, protocol: Protocol, seed: int
) -> None:
    labels, subjects = [row[0] for row in rows], [row[1] for row in rows]
    used = sorted(set(labels))[1:]
    try:
        episode = Sampler("any", labels, subjects, used, protocol, shots, seed).episode(ways, 0)
    except ClipError:
        return  # allowed of thin collections; see below for those that are not
    known, unknown = episode.target >= 0, episode.target < 0
    assert len(set(episode.labels)) == ways
    assert episode.support.shape == (ways, shots)
    for label, support in zip(episode.labels, episode.support, strict=True):
        assert {labels[clip] for clip in support} == {label}
    for query, target in zip(episode.queries, episode.target, strict=True):
        shown = labels[query]
        assert shown in used
        assert shown == episode.labels[target] if target >= 0 else shown not in episode.labels
    assert known.sum() == unknown.sum() > 0
    clips = [*episode.support.ravel(), *episode.queries]
    assert len(set(clips)) == len(clips), "a clip was used twice"
    enrolled = {subjects[clip] for clip in episode.support.ravel()}
    asking = {subjects[clip] for clip in episode.queries}
    if protocol is Protocol.PERSONAL:
        assert enrolled == asking
        assert len(asking) == 1
    else:
        assert not enrolled & asking


@pytest.mark.parametrize("protocol", list(Protocol))
def test_thin_collections_are_refused_only_when_nothing_can_be_drawn(protocol: Protocol) -> None:
    labels, subjects = regular(classes=3, people=2, clips=2)
    episode = Sampler("thin", labels, subjects, ["c0", "c1", "c2"], protocol).episode(1, 0)
    assert len(episode.queries) == (4 if protocol is Protocol.CROSS_PERSON else 2)
    with pytest.raises(ClipError, match="thin: no 3-way 1-shot episode"):
        Sampler("thin", labels, subjects, ["c0", "c1", "c2"], protocol).episode(3, 0)


def test_known_queries_are_spread_evenly_and_capped() -> None:
    labels, subjects = regular(classes=8, people=6, clips=20)
    episode = Sampler("big", labels, subjects, set(labels)).episode(5, 0)
    assert np.bincount(episode.target[episode.target >= 0]).tolist() == [QUERIES_PER_CLASS] * 5
    shown = [labels[query] for query in episode.queries[episode.target < 0]]
    assert sorted(shown.count(label) for label in set(shown)) == [16, 17, 17]


def test_episodes_follow_from_the_seed_and_differ_among_themselves() -> None:
    labels, subjects = regular(classes=6, people=4, clips=2)

    def drawn(seed: int, number: int, name: str = "x") -> tuple[object, ...]:
        episode = Sampler(name, labels, subjects, set(labels), seed=seed).episode(3, number)
        return episode.labels, episode.support.tolist(), episode.queries.tolist()

    assert drawn(1, 5) == drawn(1, 5)
    assert len({str(drawn(1, n)) for n in range(20)}) == 20
    assert drawn(1, 0) != drawn(2, 0)
    assert drawn(1, 0) != drawn(1, 0, name="y")


def test_supports_of_several_shots_come_from_several_people() -> None:
    labels, subjects = regular(classes=5, people=10, clips=1)
    episode = Sampler("one each", labels, subjects, set(labels), shots=5).episode(3, 0)
    assert all(len({subjects[clip] for clip in support}) == 5 for support in episode.support)


def test_more_shots_add_examples_to_the_same_episode() -> None:
    labels, subjects = regular(classes=5, people=10, clips=2)
    one, three = (
        Sampler("shots", labels, subjects, set(labels), shots=shots).episode(3, 0)
        for shots in (1, 3)
    )
    assert one.labels == three.labels
    np.testing.assert_array_equal(one.support, three.support[:, :1])
    np.testing.assert_array_equal(one.queries, three.queries)


def test_every_class_gets_its_turn_as_known_and_as_unknown() -> None:
    labels, subjects = regular(classes=6, people=4, clips=1)
    sampler = Sampler("fair", labels, subjects, set(labels))
    enrolled = [label for n in range(300) for label in sampler.episode(3, n).labels]
    assert all(100 < enrolled.count(label) < 200 for label in set(labels))


def test_performers_must_be_told_and_be_two() -> None:
    with pytest.raises(ClipError, match="x: 1 clips do not tell their performer"):
        Sampler("x", ["a", "b"], ["", "P"], ["a", "b"])
    with pytest.raises(ClipError, match="--protocol personal"):
        Sampler("x", ["a", "b"], ["P", "P"], ["a", "b"])


@pytest.mark.parametrize(("ways", "classes", "used"), [(5, 12, 5), (5, 6, 4), (5, 4, 2), (5, 2, 0)])
def test_all_but_two_where_there_are_fewer(ways: int, classes: int, used: int) -> None:
    assert possible_ways(ways, classes) == used
