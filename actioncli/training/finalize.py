"""What is computed when the network has learned: warp components, cohort, score."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from actioncli.clips.clip import FloatArray
from actioncli.clips.prepare import prepare
from actioncli.clips.skeleton import BONES
from actioncli.model import compare
from actioncli.model.config import ModelConfig
from actioncli.model.embedding import embed, query_view
from actioncli.model.features import mirror, warp_features
from actioncli.training.data import Indices, TrainingSet

COHORT = 256

# What time warping makes of bones that sensors place each in their own way, hips and head, and of
# depth, which cameras only guess. Chosen on actions held back from `train`, see the model card.
_ELSEWHERE, _DEPTH = 0.5, 0.8

# Weights of (-log T, -log warping cost, log radius, discriminator's logit) in the score, and its
# bias, with T in units of the median T within the cohort. They were fitted on actions
# that their models had not seen; the classes that one run holds out are too few.
_SCORE = (0.75, 3.77, 4.58, 0.20)
_SCORE_BIAS = -0.55


def finalize(
    config: ModelConfig,
    learned: Mapping[str, FloatArray],
    data: TrainingSet,
    seed: int,
) -> dict[str, NDArray[Any]]:
    """All tensors of the weights file; matrices in half precision.

    Args:
        learned: what training learned, as `parameter_shapes` names it.
        data: clips from which components and cohort come.
        seed: of the choice of the cohort.
    """
    tensors: dict[str, NDArray[Any]] = {name: _halved(array) for name, array in learned.items()}
    if not config.warp_width:
        return dict(learned)
    rows = _spread(data, COHORT, np.random.default_rng([seed, 0xC0]))
    frames = np.stack([prepare(data.clips[row], config.preparation) for row in rows])
    tensors["warp.components"] = warp_components(config, frames)
    params = {name: array.astype(np.float32) for name, array in tensors.items()}
    tensors["cohort"] = _cohort(config, params, frames).astype(np.float16)
    params["cohort"] = tensors["cohort"].astype(np.float32)
    unit = unit_distance(config, params)
    return tensors | {
        "score.weight": np.array(_SCORE, np.float32),
        "score.bias": np.array([_SCORE_BIAS + _SCORE[0] * np.log(unit)], np.float32),
    }


def warp_components(config: ModelConfig, frames: FloatArray) -> FloatArray:
    """The V directions in which weighted bone directions differ most within clips, (42, V)."""
    trust = np.array(
        [[(_ELSEWHERE if child in ("lhip", "rhip", "head") else 1.0)] * 3 for child, _, _ in BONES]
    )
    trust = (trust * (1, 1, _DEPTH)).reshape(-1, 1).astype(np.float32)
    weighted = warp_features(config, np.diag(trust[:, 0]), frames).reshape(-1, 42)
    components = np.linalg.svd(weighted, full_matrices=False)[2][: config.warp_width]
    return np.ascontiguousarray(trust * components.T, dtype=np.float32)


def _cohort(
    config: ModelConfig, params: Mapping[str, FloatArray], frames: FloatArray
) -> FloatArray:
    """Embeddings of the cohort's clips, turned to the side on which queries are asked; each one's
    own radius does not count itself."""
    plain = replace(config, neighbours=0)
    left_sided = query_view(params, config, embed(params, plain, frames)) > 0
    frames = np.where(left_sided[:, None, None, None], mirror(config, frames), frames)
    alone = embed(params, plain, frames)
    blank = np.zeros((*alone.shape[:2], 1), np.float32)
    # In halves, so that a clip finds its neighbours in the half without it.
    half = len(frames) // 2
    first, second = alone[:half], alone[half:]
    radii = [
        embed({**params, "cohort": np.concatenate([other, blank[: len(other)]], 2)},
                      config, own)[..., -1:]
        for own, other in ((frames[:half], second), (frames[half:], first))
    ]  # fmt: skip
    return np.concatenate([alone, np.concatenate(radii)], axis=2)


def _spread(data: TrainingSet, count: int, rng: np.random.Generator) -> Indices:
    """Clips of all collections, the small ones favoured by the root of their size."""
    sizes = np.bincount(data.collections)[data.collections]
    chances = 1 / np.sqrt(sizes)
    count = min(count, len(data.clips))
    return rng.choice(len(data.clips), count, replace=False, p=chances / chances.sum())


def unit_distance(config: ModelConfig, params: Mapping[str, FloatArray]) -> float:
    """Median T among the cohort: networks differ in how large they make it."""
    some = params["cohort"][:64]
    among = compare.score_parts(params, config, some[:16], [clip[None] for clip in some[16:]])
    return max(float(np.median(among[..., 0])), 1e-6)


def _halved(array: FloatArray) -> NDArray[Any]:
    return array.astype(np.float16) if array.ndim > 1 else array
