"""Scores of the published model: what the equations say, whatever else is there."""

from __future__ import annotations

import numpy as np

from actioncli.clips.clip import Clip, FloatArray
from actioncli.clips.skeleton import DEFAULT_JOINTS
from actioncli.model import paper_compare, trx_os
from actioncli.model.arrays import softmax
from actioncli.model.config import ModelConfig
from tests.clips.test_prepare import waving

CONFIG = ModelConfig()
_RNG = np.random.default_rng(0)
PARAMS = {
    name: _RNG.uniform(-1, 1, shape).astype(np.float32) / np.float32(shape[0] ** 0.5)
    for name, shape in trx_os.parameter_shapes(CONFIG).items()
}


def embedded(count: int) -> FloatArray:
    clips = [Clip(waving(20 + 5 * seed, seed=seed), DEFAULT_JOINTS) for seed in range(count)]
    return paper_compare.embed(PARAMS, CONFIG, clips)


def test_scores_are_what_the_equations_say() -> None:
    clips = embedded(5)
    assert clips.shape == (5, CONFIG.tokens, CONFIG.embedding_width)
    assert paper_compare.embed(PARAMS, CONFIG, []).shape == (0, *clips.shape[1:])
    distance, logit = paper_compare.scores(PARAMS, CONFIG, clips[:2], [clips[2:3], clips[3:]])
    for row, column, of in ((0, 0, clips[2:3]), (1, 1, clips[3:])):
        (asked, *keys), (values, *enrolled) = trx_os.pairs(
            PARAMS, CONFIG, np.concatenate([clips[[row]], of])
        )
        weights = softmax(asked @ np.concatenate(keys).T / np.sqrt(CONFIG.key_width))
        gap = values - weights @ np.concatenate(enrolled)
        np.testing.assert_allclose(distance[row, column], (gap**2).sum(1).mean(), rtol=1e-4)
        np.testing.assert_allclose(
            logit[row, column], trx_os.discriminator(PARAMS, gap), rtol=1e-3, atol=1e-5
        )


def test_a_score_does_not_depend_on_what_else_is_there() -> None:
    clips = embedded(4)
    together = paper_compare.scores(PARAMS, CONFIG, clips[:2], [clips[2:3], clips[3:]])
    alone = paper_compare.scores(PARAMS, CONFIG, clips[1:2], [clips[3:]])
    for one, other in zip(together, alone, strict=True):
        np.testing.assert_allclose(one[1:, 1:], other, rtol=1e-4)


def test_probabilities_of_large_numbers() -> None:
    found = softmax(np.array([[1000.0, 999.0], [-1000.0, -1000.0]]))
    np.testing.assert_allclose(found, [[0.731059, 0.268941], [0.5, 0.5]], rtol=1e-5)
