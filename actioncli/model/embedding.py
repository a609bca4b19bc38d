"""From prepared frames to embeddings: all that comparison needs of a clip, numpy only.

*Two views.* A clip is seen as it is and in the mirror. Of a query one view is compared, with both
of an example. Which one is decided by a number that changes its sign in the mirror: a clip and
its mirror image are then asked in the same view, and meet each example's views with left and right
exchanged. So a mirrored query has exactly the mirrored decision, though neither the network nor
the warping cost knows of left and right.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from actioncli.clips.clip import FloatArray
from actioncli.clips.skeleton import BONES
from actioncli.model import trx_os
from actioncli.model.arrays import Params
from actioncli.model.config import ModelConfig
from actioncli.model.features import mirror, token_features, warp_features
from actioncli.model.warping import warping_cost

# Distances below this are one and the same clip; keeps logarithms finite.
SAME = 1e-3


def finalized_shapes(config: ModelConfig, cohort: int) -> dict[str, tuple[int, ...]]:
    """Name and shape of the tensors that are computed when training is over.

    `score.weight` and `score.bias` belong to (-log T, -log of the warping cost, log of the
    radii, the discriminator's logit), see `scores`.
    """
    shapes: dict[str, tuple[int, ...]] = {}
    if config.warp_width:
        shapes |= {"warp.components": (42, config.warp_width)}
        shapes |= {"score.weight": (4,), "score.bias": (1,)}
    if config.neighbours:
        shapes |= {"cohort": (cohort, config.tokens, config.embedding_width)}
    return shapes


def embed(
    params: Params, config: ModelConfig, frames: FloatArray, queries: bool = False
) -> FloatArray:
    """All that comparison needs of clips.

    Args:
        frames: (N, frames, J, 3) prepared frames.
        queries: they are never compared with as examples; what only examples need stays zero.

    Returns:
        (N, F, E): the view of the clip (projected tokens, warp features), with `mirrored` the
        view of its mirror image, and with a cohort the clip's radius in every row.
    """
    embedding = np.zeros((len(frames), config.tokens, config.embedding_width), np.float32)
    views = [frames, mirror(config, frames)] if config.mirrored else [frames]
    if config.warp_width:
        for columns, view in zip(warp_columns(config), views, strict=True):
            embedding[..., columns] = warp_features(config, params["warp.components"], view)
    asked = query_view(params, config, embedding)
    for at, (columns, view) in enumerate(zip(token_columns(config), views, strict=True)):
        rows = np.flatnonzero(asked == at) if queries else np.arange(len(frames))
        features = trx_os.psi(params, config, token_features(config, view[rows]))
        features = trx_os.with_positions(params, config, features)
        embedding[rows, :, columns] = trx_os.project(params, config, features)
    if config.neighbours:
        embedding[..., -1] = _radius(params, config, embedding, asked)[:, None]
    return embedding


def warp_columns(config: ModelConfig) -> list[slice]:
    """Where in an embedding the warp features of each view stand."""
    starts = [at * config.view_width + 4 * config.key_width for at in range(config.views)]
    return [np.s_[start : start + config.warp_width] for start in starts]


def token_columns(config: ModelConfig) -> list[slice]:
    """Where in an embedding the projected tokens of each view stand."""
    starts = [at * config.view_width for at in range(config.views)]
    return [np.s_[start : start + 4 * config.key_width] for start in starts]


def in_view(embedding: FloatArray, columns: Sequence[slice], view: NDArray[np.intp]) -> FloatArray:
    """These columns of clips (N, F, E), of each clip in its own view (N,)."""
    both = np.stack([embedding[..., at] for at in columns])
    return np.asarray(both[view, np.arange(len(view))])


def query_view(params: Params, config: ModelConfig, embedding: FloatArray) -> NDArray[np.intp]:
    """Which view of clips (N, F, E) is compared when they are queries, (N,): 0 as they are, 1 in
    the mirror.

    That in which the right side moves more than the left, as far as the warp features show;
    without warping the clip as it is.
    """
    if not (config.mirrored and config.warp_width):
        return np.zeros(len(embedding), np.intp)
    components = params["warp.components"].reshape(len(BONES), 3, config.warp_width)
    right, left = (
        components[[child[0] == side for child, _, _ in BONES]].reshape(-1, config.warp_width)
        for side in "rl"
    )
    # Sum of squares on the right minus that on the left, of what differs from the clip's mean.
    right_sided = right.T @ right - left.T @ left
    moved = []
    for columns in warp_columns(config):
        motion = embedding[..., columns]
        motion = motion - motion.mean(axis=1, keepdims=True)
        moved.append(((motion @ right_sided) * motion).sum(axis=(1, 2)))
    return np.asarray(moved[1] > moved[0], np.intp)


def _radius(
    params: Params, config: ModelConfig, embedding: FloatArray, asked: NDArray[np.intp]
) -> FloatArray:
    """Mean warping cost to the nearest motions of the cohort, (N,): how much room is around a clip.
    Ordinary motions have near neighbours, so that near a query says less for them."""
    columns = warp_columns(config)
    clips = in_view(embedding, columns, asked)
    cohort = params["cohort"]
    cost = warping_cost(clips, cohort[..., columns[0]])
    if config.mirrored:
        other = warping_cost(clips, cohort[..., columns[1]])
        cost = np.minimum(cost, config.mirrored * other)
    nearest = np.sort(cost, axis=1)[:, : config.neighbours].mean(axis=1)
    return np.asarray(np.maximum(nearest, SAME), np.float32)
