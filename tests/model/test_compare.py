"""Embeddings and scores of both recipes: what must not matter does not, what must does."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from cases import cases
from hypothesis import given, settings
from hypothesis import strategies as st

from actioncli.clips.clip import Clip, FloatArray
from actioncli.clips.prepare import prepare
from actioncli.clips.read import read_clip
from actioncli.clips.skeleton import DEFAULT_JOINTS
from actioncli.model import compare, trx_os
from actioncli.model.arrays import softmax
from actioncli.model.config import ModelConfig
from actioncli.model.embedding import embed
from actioncli.model.features import mirror
from actioncli.model.warping import warping_cost
from actioncli.model.weights import read_weights
from actioncli.recognition.recognizer import Recognizer
from tests.clips.test_prepare import waving

torch = pytest.importorskip("torch", reason="numpy is compared with torch")

EXAMPLES = Path(__file__).parents[2] / "examples"
PAPER, DEFAULT = ModelConfig(), read_weights().trx_os


def motions(count: int, seed: int = 0) -> list[Clip]:
    """People who swing all their limbs, each differently."""
    rng = np.random.default_rng(seed)
    clips = []
    for _ in range(count):
        joints = waving(int(rng.integers(20, 60)), seed=int(rng.integers(1000)))
        phase = np.linspace(0, 2 * np.pi, len(joints))[:, None, None]
        joints = joints + rng.normal(0, 0.1, (1, 15, 3)) * np.sin(phase * rng.integers(1, 4))
        clips.append(Clip(joints, DEFAULT_JOINTS))
    return clips


def frames(config: ModelConfig, clips: list[Clip]) -> FloatArray:
    return np.stack([prepare(clip, config.preparation) for clip in clips])


def random_model(config: ModelConfig, seed: int = 0) -> dict[str, FloatArray]:
    rng = np.random.default_rng(seed)
    params = {
        name: rng.uniform(-1, 1, shape).astype(np.float32) / np.float32(shape[0] ** 0.5)
        for name, shape in trx_os.parameter_shapes(config).items()
    }
    if config.warp_width:
        turn = np.linalg.qr(rng.normal(size=(42, config.warp_width)))[0]
        params["warp.components"] = turn.astype(np.float32)
        params["score.weight"] = np.array([1, 2, 3, 0.1], np.float32)
        params["score.bias"] = np.array([-1], np.float32)
    if config.neighbours:
        alone = replace(config, neighbours=0)
        cohort = embed(params, alone, frames(config, motions(30, seed=99)))
        params["cohort"] = np.concatenate([cohort, np.ones((30, 16, 1), np.float32)], axis=2)
    return params


def logits(config: ModelConfig, queries: list[Clip], actions: list[list[Clip]]) -> FloatArray:
    params = random_model(config)
    return compare.scores(
        params,
        config,
        embed(params, config, frames(config, queries)),
        [embed(params, config, frames(config, clips)) for clips in actions],
    )[1]


@pytest.mark.parametrize("config", [PAPER, DEFAULT], ids=["paper", "default"])
def test_shapes_follow_the_configuration(config: ModelConfig) -> None:
    params = random_model(config)
    embedding = embed(params, config, frames(config, motions(3)))
    assert embedding.shape == (3, config.tokens, config.embedding_width)
    assert embedding.dtype == np.float32
    assert embed(params, config, frames(config, motions(1))[:0]).shape[0] == 0
    distance, logit = compare.scores(params, config, embedding, [embedding[:1], embedding[1:]])
    assert distance.shape == logit.shape == (3, 2)


def plain_parts(
    params: dict[str, FloatArray], config: ModelConfig, query: FloatArray, example: FloatArray
) -> tuple[float, float, float, float]:
    """T, warping cost, radius and Disc of a query and a single example, both seen as they are,
    written as the equations are."""
    width = 4 * config.key_width
    (asked, known), (asked_values, known_values) = trx_os.pairs(
        params, config, np.stack([query, example])[..., :width]
    )
    scores = asked @ known.T / np.sqrt(config.key_width)
    rows = np.exp(scores) / np.exp(scores).sum(axis=1, keepdims=True)
    columns = np.exp(scores) / np.exp(scores).sum(axis=0)
    ways = [asked_values - rows @ known_values]
    if config.both_ways:
        ways.append(known_values - columns.T @ asked_values)
    power = 1 if config.distance == "squared" else 0.5
    t = [(((way**2).sum(axis=1) + 1e-6) ** power).mean() for way in ways]
    disc = [trx_os.discriminator(params, way) for way in ways]
    cost = radius = 1.0
    if config.warp_width:
        at = slice(width, width + config.warp_width)
        cost = float(warping_cost(query[None, :, at], example[None, :, at])[0, 0])
        radius = float(np.sqrt(query[0, -1] * example[0, -1]))
    return float(np.mean(t)), cost, radius, float(np.mean(disc))


@pytest.mark.parametrize(
    "config",
    [PAPER, replace(DEFAULT, mirrored=0.0)],
    ids=["paper", "default"],
)
def test_scores_are_what_the_equations_say(config: ModelConfig) -> None:
    params = random_model(config)
    if config.warp_width:
        # As trained: everything speaks for a match but Disc's own share.
        params["score.weight"] = np.array([1.5, 2, 3, 0.5], np.float32)
    embedding = embed(params, config, frames(config, motions(5)))
    queries, actions = embedding[:2], [embedding[[k]] for k in range(2, 5)]
    parts = compare.score_parts(params, config, queries, actions)
    plain = np.array(
        [[plain_parts(params, config, q, action[0]) for action in actions] for q in queries]
    )
    np.testing.assert_allclose(parts, plain, rtol=1e-4, atol=1e-5)
    distance, logit = compare.scores(params, config, queries, actions)
    t, cost, radius, disc = np.moveaxis(plain, -1, 0)
    if config.warp_width:
        sure = -1.5 * np.log(t) - 2 * np.log(cost) + 3 * np.log(radius) + 0.5 * disc - 1
        np.testing.assert_allclose(logit, sure, rtol=1e-4, atol=1e-4)
        np.testing.assert_allclose(distance, np.exp(-sure), rtol=1e-3)
    else:
        np.testing.assert_allclose(distance, t, rtol=1e-4)
        np.testing.assert_allclose(logit, disc, rtol=1e-4, atol=1e-5)


def test_queries_in_pieces_are_compared_as_together(
    monkeypatch: pytest.MonkeyPatch, varied: FloatArray
) -> None:
    weights = Recognizer().weights
    actions = [varied[15:17], varied[17:18], varied[18:20]]
    together = compare.score_parts(weights.tensors, weights.config, varied[:7], actions)
    monkeypatch.setattr(compare, "_BLOCK_QUERIES", 3)
    pieces = compare.score_parts(weights.tensors, weights.config, varied[:7], actions)
    np.testing.assert_allclose(pieces, together, rtol=1e-4, atol=1e-5)


def test_probabilities_of_large_numbers() -> None:
    found = softmax(np.array([[1000.0, 999.0], [-1000.0, -1000.0]]))
    np.testing.assert_allclose(found, [[0.731059, 0.268941], [0.5, 0.5]], rtol=1e-5)


@pytest.mark.parametrize("config", [PAPER, DEFAULT], ids=["paper", "default"])
def test_a_score_does_not_depend_on_what_else_is_there(config: ModelConfig) -> None:
    clips = motions(7)
    together = logits(config, clips[:2], [[clips[2]], [clips[3], clips[4]], [clips[5]], [clips[6]]])
    alone = logits(config, [clips[1]], [[clips[3], clips[4]]])
    np.testing.assert_allclose(together[1, 1], alone[0, 0], atol=1e-5)
    turned = logits(config, clips[:2], [[clips[6]], [clips[5]], [clips[3], clips[4]], [clips[2]]])
    np.testing.assert_allclose(together[:, ::-1], turned[:, [0, 1, 2, 3]], atol=1e-5)


def test_the_nearest_action_is_the_most_confident_one() -> None:
    clips, params = motions(8), random_model(DEFAULT)
    embedding = embed(params, DEFAULT, frames(DEFAULT, clips))
    distance, logit = compare.scores(
        params, DEFAULT, embedding[:3], [embedding[[k]] for k in range(3, 8)]
    )
    np.testing.assert_array_equal(distance.argsort(axis=1), (-logit).argsort(axis=1))
    np.testing.assert_allclose(distance, 1 / compare.sigmoid(logit) - 1, rtol=1e-3)


@given(angle=st.floats(-3.1, 3.1), size=st.floats(0.5, 1.8), shift=st.floats(-3, 3))
@settings(max_examples=cases(10))
def test_heading_size_and_place_do_not_matter_to_the_default(
    angle: float, size: float, shift: float
) -> None:
    clips = motions(3)
    cos, sin = np.cos(angle), np.sin(angle)
    turn = np.array([[cos, 0, -sin], [0, 1, 0], [sin, 0, cos]])
    moved = Clip(size * clips[0].joints @ turn + shift, DEFAULT_JOINTS)
    actions = [[clips[1]], [clips[2]]]
    np.testing.assert_allclose(
        logits(DEFAULT, [moved], actions), logits(DEFAULT, [clips[0]], actions), atol=0.02
    )


def test_the_other_hand_is_recognised_at_a_price() -> None:
    params = random_model(DEFAULT)
    clip = frames(DEFAULT, motions(1))
    action = [embed(params, DEFAULT, clip)]
    slight = np.random.default_rng(0).normal(0, 0.02, clip.shape).astype(np.float32)
    same = embed(params, DEFAULT, clip + slight)
    other = embed(params, DEFAULT, mirror(DEFAULT, clip + slight))
    ours = compare.score_parts(params, DEFAULT, same, action)[0, 0]
    theirs = compare.score_parts(params, DEFAULT, other, action)[0, 0]
    np.testing.assert_allclose(theirs[:2], DEFAULT.mirrored * ours[:2], rtol=1e-3)
    np.testing.assert_allclose(theirs[3], ours[3], rtol=1e-3)


def test_the_best_of_several_examples_counts() -> None:
    clips = motions(4)
    params = random_model(DEFAULT)
    embedding = embed(params, DEFAULT, frames(DEFAULT, clips))
    one = compare.score_parts(params, DEFAULT, embedding[:1], [embedding[1:2]])[0, 0]
    three = compare.score_parts(params, DEFAULT, embedding[:1], [embedding[1:4]])[0, 0]
    assert three[1] <= one[1]
    with_itself = compare.score_parts(params, DEFAULT, embedding[:1], [embedding[[1, 0]]])[0, 0]
    assert with_itself[1] == pytest.approx(0, abs=1e-2)


@pytest.fixture(scope="module")
def varied() -> FloatArray:
    """Embeddings, by the shipped weights, of the example clips and of 45 that are like them."""
    clips = [read_clip(path) for path in sorted(EXAMPLES.glob("*/*.npz"))]
    embeddings = Recognizer().embed(clips)
    noise = np.random.default_rng(0).normal(1, 0.05, (3, *embeddings.shape))
    like = (embeddings * noise).astype(np.float32).reshape(-1, *embeddings.shape[1:])
    return np.concatenate([embeddings, like])


def in_actions(varied: FloatArray, most: int) -> list[FloatArray]:
    """All but the example clips, in actions of one to `most` examples."""
    cuts = np.cumsum([1 + (k % most) for k in range(45 // most)])
    return [part for part in np.split(varied[15:], cuts) if len(part)]


@pytest.mark.parametrize("most", [1, 3])
def test_a_short_list_decides_as_the_exact_comparison(
    monkeypatch: pytest.MonkeyPatch, varied: FloatArray, most: int
) -> None:
    weights = Recognizer().weights
    actions = in_actions(varied, most)
    queries = varied[:15]
    exact = compare.scores(weights.tensors, weights.config, queries, actions)[1]
    monkeypatch.setattr(compare, "EXACT", 12)
    distance, logit = compare.scores(weights.tensors, weights.config, queries, actions)
    np.testing.assert_array_equal(logit.argmax(axis=1), exact.argmax(axis=1))
    np.testing.assert_array_equal(distance.argmin(axis=1), exact.argmax(axis=1))
    np.testing.assert_allclose(
        compare.sigmoid(logit.max(axis=1)), compare.sigmoid(exact.max(axis=1)), atol=1e-5
    )


@pytest.mark.parametrize("most", [1, 3])
def test_the_rule_of_the_short_list(
    monkeypatch: pytest.MonkeyPatch, varied: FloatArray, most: int
) -> None:
    """The rule again, for one query after another, none of which is much like an action."""
    weights, exact, at_most, fewest, slack = Recognizer().weights, 5, 24, 3, 0.6
    noise = np.random.default_rng(1).normal(1, 0.8, varied[:15].shape)
    queries = np.concatenate([varied[:3], (varied[:15] * noise).astype(np.float32)])
    actions = in_actions(varied, most)
    limits = {"EXACT": exact, "_AT_MOST": at_most, "_FEWEST": fewest, "_SLACK": slack}
    for name, value in limits.items():
        monkeypatch.setattr(compare, name, value)
    parts = compare.score_parts(weights.tensors, weights.config, queries, actions)
    weight, bias = weights.tensors["score.weight"], weights.tensors["score.bias"][0]
    counted, every = [], []
    for query, (t, cost, radius, disc) in enumerate(np.moveaxis(parts, -1, 1)):
        cheap = -weight[1] * np.log(cost) + weight[2] * np.log(radius) + bias
        full = cheap - weight[0] * np.log(t) + weight[3] * disc
        added = full - cheap
        order = np.argsort(-cheap)
        before = np.cumsum([0, *(len(actions[k]) for k in order[:-1])])
        first = [k for at, k in enumerate(order) if before[at] < exact or at < fewest]
        beyond = [k for at, k in enumerate(order) if before[at] < at_most and k not in first]
        enough = full[first].max() - added[first].max() - slack
        compared = first + [k for k in beyond if cheap[k] >= enough]
        lowest = cheap + added[compared].min()
        lowest[compared] = full[compared]
        counted.append((len(compared) - len(first), len(beyond)))
        logit = compare.scores(weights.tensors, weights.config, queries[[query]], actions)[1][0]
        np.testing.assert_allclose(logit, lowest, atol=1e-3)
        every.append(lowest)
    together = compare.scores(weights.tensors, weights.config, queries, actions)[1]
    np.testing.assert_allclose(together, every, atol=1e-3)
    # Of some queries there are rivals, of some not all.
    assert any(rivals for rivals, _ in counted)
    assert any(rivals < beyond for rivals, beyond in counted)


def test_as_many_as_are_compared_in_full_are_compared_in_full(
    monkeypatch: pytest.MonkeyPatch, varied: FloatArray
) -> None:
    weights, actions = Recognizer().weights, list(varied[15:, None])
    exact = compare.scores(weights.tensors, weights.config, varied[:5], actions)[1]
    monkeypatch.setattr(compare, "EXACT", len(actions))
    monkeypatch.setattr(compare, "_largest", None)
    logit = compare.scores(weights.tensors, weights.config, varied[:5], actions)[1]
    np.testing.assert_array_equal(logit, exact)


def test_queries_that_need_other_actions_each(varied: FloatArray) -> None:
    """As many pairs as actions, but not each action once."""
    weights = Recognizer().weights
    queries, actions = varied[:3], list(varied[15:18, None])
    wanted = np.array([[False, True, False], [True, False, False], [False, False, True]])
    warped = compare.warp(weights.tensors, weights.config, queries, actions)
    some = compare._parts(weights.tensors, weights.config, queries, actions, warped, wanted)
    every = compare.score_parts(weights.tensors, weights.config, queries, actions)
    np.testing.assert_allclose(some[wanted], every[wanted], rtol=1e-4)


def test_a_short_list_does_not_depend_on_the_order_of_enrolment(
    monkeypatch: pytest.MonkeyPatch, varied: FloatArray
) -> None:
    weights = Recognizer().weights
    monkeypatch.setattr(compare, "EXACT", 10)
    actions = list(varied[15:, None])
    order = np.random.default_rng(1).permutation(len(actions))
    straight = compare.scores(weights.tensors, weights.config, varied[:5], actions)[1]
    shuffled = compare.scores(
        weights.tensors, weights.config, varied[:5], [actions[k] for k in order]
    )[1]
    np.testing.assert_allclose(shuffled, straight[:, order], atol=1e-4)


def test_many_clips_are_decided_as_each_alone(varied: FloatArray) -> None:
    recognizer = Recognizer()
    clips = [read_clip(path) for path in sorted(EXAMPLES.glob("*/*.npz"))]
    support = {str(k): varied[k : k + 2] for k in range(15, 25)}
    together = recognizer.classify_all(clips, support, negatives=varied[30:32])
    assert recognizer.classify_all([], support) == []
    for clip, decision in zip(clips, together, strict=True):
        alone = recognizer.classify(clip, support, negatives=varied[30:32])
        assert (decision.label, decision.nearest) == (alone.label, alone.nearest)
        assert decision.notes == alone.notes
        assert decision.confidence == pytest.approx(alone.confidence, abs=1e-5)
        assert [r.label for r in decision.ranking] == [r.label for r in alone.ranking]
