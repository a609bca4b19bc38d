"""What is computed when the network has learned: warp components, cohort, score."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch.nn import functional

from actioncli.clips.clip import FloatArray
from actioncli.clips.prepare import prepare
from actioncli.model import compare
from actioncli.model.config import ModelConfig
from actioncli.model.features import warp_features
from actioncli.training.data import Indices, TrainingSet
from actioncli.training.validation import Validation

COHORT = 256

# Weights of (-log T, -log warping cost, log radius, discriminator's logit) in the score, and its
# bias, with T in units of the median T within the cohort. Fitted on validation classes of three
# folds, each on queries that its model had not seen: see the model card.
_PRIOR = (1.7, 3.7, 6.1, 0.2)
_PRIOR_BIAS = -1.8
# How strongly the held-out classes of a run, which are few, may move these.
_PRIOR_STRENGTH = 0.02


def close(
    config: ModelConfig,
    learned: Mapping[str, FloatArray],
    data: TrainingSet,
    validation: Validation,
    seed: int,
) -> dict[str, NDArray[Any]]:
    """All tensors of the weights file; matrices in half precision.

    Args:
        learned: what training learned, as `parameter_shapes` names it.
        data: clips from which components and cohort come.
        validation: episodes of held-out classes, on which the score is fitted.
        seed: of the choice of the cohort.
    """
    tensors: dict[str, NDArray[Any]] = {name: _halved(array) for name, array in learned.items()}
    if not config.warp_width:
        return dict(learned)
    rows = _spread(data, COHORT, np.random.default_rng([seed, 0xC0]))
    frames = np.stack([prepare(data.clips[row], config.preparation) for row in rows])
    tensors["warp.components"] = warp_components(config, frames)
    params = {name: array.astype(np.float32) for name, array in tensors.items()}
    if config.neighbours:
        tensors["cohort"] = _cohort(config, params, frames).astype(np.float16)
        params["cohort"] = tensors["cohort"].astype(np.float32)
    weight, bias = fit_score(config, params, validation)
    return tensors | {"score.weight": weight, "score.bias": bias}


def warp_components(config: ModelConfig, frames: FloatArray) -> FloatArray:
    """The V directions in which bone directions differ most within clips, (42, V)."""
    everything = warp_features(config, np.eye(42, dtype=np.float32), frames)
    components = np.linalg.svd(everything.reshape(-1, 42), full_matrices=False)[2]
    return np.ascontiguousarray(components[: config.warp_width].T, dtype=np.float32)


def _cohort(
    config: ModelConfig, params: Mapping[str, FloatArray], frames: FloatArray
) -> FloatArray:
    """Embeddings of the cohort's clips; each one's own radius does not count itself."""
    alone = compare.embed(params, replace(config, neighbours=0), frames)
    blank = np.zeros((*alone.shape[:2], 1), np.float32)
    # In halves, so that a clip finds its neighbours in the half without it.
    half = len(frames) // 2
    first, second = alone[:half], alone[half:]
    radii = [
        compare.embed({**params, "cohort": np.concatenate([other, blank[: len(other)]], 2)},
                      config, own)[..., -1:]
        for own, other in ((frames[:half], second), (frames[half:], first))
    ]  # fmt: skip
    return np.concatenate([alone, np.concatenate(radii)], axis=2)


def _spread(data: TrainingSet, count: int, rng: np.random.Generator) -> Indices:
    """Clips of all collections, the small ones favoured by the root of their size."""
    sizes = np.bincount(data.collections)[data.collections]
    chances = 1 / np.sqrt(sizes)
    count = min(count, len(data.clips))
    return np.sort(rng.choice(len(data.clips), count, replace=False, p=chances / chances.sum()))


def fit_score(
    config: ModelConfig, params: Mapping[str, FloatArray], validation: Validation
) -> tuple[FloatArray, FloatArray]:
    """Weights (4,) and bias (1,) of the score: logistic regression, held near `_PRIOR`.

    The samples are queries against their nearest action, right or not, and unknown queries
    against theirs, as many of these as of the known: confidence 0.5 is then an even chance.
    """
    cohort = params["cohort"] if config.neighbours else compare.embed(params, config, _no(config))
    scale = 1.0
    if len(cohort) > 1:
        among = compare.score_parts(
            params, config, cohort[:16], [clip[None] for clip in cohort[16:64]]
        )
        scale = float(np.median(among[..., 0]))
    prior = np.array(_PRIOR, np.float64)
    start = _PRIOR_BIAS + prior[0] * np.log(max(scale, 1e-6))
    terms, hits = validation.nearest(params, config, prior)
    x = torch.tensor(terms, dtype=torch.float64)
    y = torch.tensor(hits, dtype=torch.float64)
    w = torch.tensor(prior, requires_grad=True)
    b = torch.tensor(start, requires_grad=True)
    optimiser = torch.optim.LBFGS([w, b], max_iter=200, line_search_fn="strong_wolfe")

    def loss() -> torch.Tensor:
        optimiser.zero_grad()
        away = (w / torch.tensor(prior) - 1).square().sum() + (b - start).square() / 4
        value = functional.binary_cross_entropy_with_logits(x @ w + b, y)
        value = value + _PRIOR_STRENGTH * away
        value.backward()  # type: ignore[no-untyped-call]  # torch declares no types here
        return value

    optimiser.step(loss)  # type: ignore[no-untyped-call]
    return w.detach().numpy().astype(np.float32), b.detach().numpy().astype(np.float32)[None]


def _no(config: ModelConfig) -> FloatArray:
    joints = len(config.preparation.joints)
    return np.empty((0, config.preparation.frames, joints, 3), np.float32)


def _halved(array: FloatArray) -> NDArray[Any]:
    return array.astype(np.float16) if array.ndim > 1 else array
