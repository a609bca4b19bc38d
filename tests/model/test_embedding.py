"""What is kept of a clip: two views of it, one of which is asked, and its radius."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from model.test_compare import DEFAULT, PAPER, frames, motions, random_model

from actioncli.clips.read import read_clip
from actioncli.model import compare
from actioncli.model.embedding import embed, in_view, query_view, token_columns, warp_columns
from actioncli.model.features import mirror
from actioncli.recognition.recognizer import Recognizer

EXAMPLES = Path(__file__).parents[2] / "examples"


def test_the_mirror_image_holds_the_same_views_exchanged() -> None:
    params, clips = random_model(DEFAULT), frames(DEFAULT, motions(6))
    plain, seen = (embed(params, DEFAULT, each) for each in (clips, mirror(DEFAULT, clips)))
    for columns in (token_columns(DEFAULT), warp_columns(DEFAULT)):
        for view in (0, 1):
            np.testing.assert_allclose(
                plain[..., columns[view]], seen[..., columns[1 - view]], atol=1e-4
            )
    # Asked the same, with as much room around.
    view, other = (query_view(params, DEFAULT, each) for each in (plain, seen))
    np.testing.assert_array_equal(view, 1 - other)
    np.testing.assert_allclose(
        in_view(plain, token_columns(DEFAULT), view),
        in_view(seen, token_columns(DEFAULT), other),
        atol=1e-4,
    )
    np.testing.assert_allclose(plain[..., -1], seen[..., -1], rtol=1e-4)


def test_a_mirrored_query_scores_as_the_query_against_mirrored_actions() -> None:
    params, clips = random_model(DEFAULT), frames(DEFAULT, motions(9))
    scored = []
    for each in (clips, mirror(DEFAULT, clips)):
        embedding = embed(params, DEFAULT, each)
        scored.append(compare.scores(params, DEFAULT, embedding[:4], [*embedding[4:, None]])[1])
    np.testing.assert_allclose(scored[0], scored[1], atol=1e-3)


def test_what_only_examples_need_may_be_left_out_of_queries() -> None:
    params, clips = random_model(DEFAULT), frames(DEFAULT, motions(9))
    whole = embed(params, DEFAULT, clips)
    actions = [whole[4:6], whole[6:9]]
    lean = embed(params, DEFAULT, clips[:4], queries=True)
    assert lean.shape == whole[:4].shape
    assert (lean == 0).mean() > 0.4
    np.testing.assert_array_equal(
        compare.scores(params, DEFAULT, lean, actions)[1],
        compare.scores(params, DEFAULT, whole[:4], actions)[1],
    )


def test_the_side_that_moves_is_asked_as_the_right_one() -> None:
    recognizer = Recognizer()
    params, config = recognizer.weights.tensors, recognizer.weights.config
    for action, view in (("wave_right", 0), ("kick_right", 0), ("wave_left", 1)):
        clips = [read_clip(path) for path in sorted((EXAMPLES / action).glob("*.npz"))]
        found = query_view(params, config, recognizer.embed(clips))
        assert found.tolist() == [view] * len(clips), action


@pytest.mark.parametrize(
    "config", [PAPER, replace(DEFAULT, mirrored=0.0)], ids=["paper", "one view"]
)
def test_without_mirroring_there_is_one_view(config) -> None:  # type: ignore[no-untyped-def]
    params = random_model(config)
    embedding = embed(params, config, frames(config, motions(3)))
    assert embedding.shape[2] == config.view_width + bool(config.neighbours)
    assert query_view(params, config, embedding).tolist() == [0, 0, 0]
