"""The forward pass against the plain formulation of the paper, and numpy against torch."""

from __future__ import annotations

import numpy as np
import pytest
from cases import cases
from hypothesis import given, settings
from hypothesis import strategies as st

from actioncli.clips.clip import FloatArray
from actioncli.model import trx_os
from actioncli.model.config import ModelConfig

torch = pytest.importorskip("torch", reason="numpy is compared with torch")

CONFIG = ModelConfig()


def random_params(seed: int, config: ModelConfig = CONFIG) -> dict[str, FloatArray]:
    rng = np.random.default_rng(seed)
    return {
        name: rng.uniform(-1, 1, shape).astype(np.float32) / np.float32(shape[0] ** 0.5)
        for name, shape in trx_os.parameter_shapes(config).items()
    }


def random_frames(seed: int, clips: int, frames: int = 16) -> FloatArray:
    return np.random.default_rng(seed).normal(size=(clips, frames, 15, 3)).astype(np.float32)


def plain(params: dict[str, FloatArray], query: FloatArray, support: FloatArray) -> FloatArray:
    """The difference of the paper, written as the paper writes it: (P, 2D) tuples, one by one."""

    def tuples(frames: FloatArray) -> FloatArray:
        x = frames.reshape(16, 45)
        for layer in ("psi.0", "psi.1"):
            x = np.maximum(x @ params[f"{layer}.weight"] + params[f"{layer}.bias"], 0)
        x = x + trx_os.positional_encoding(16, 256)
        return np.stack([np.concatenate([x[i], x[j]]) for i in range(16) for j in range(i + 1, 16)])

    def keys(of: FloatArray) -> FloatArray:
        k = of @ params["key.weight"] + params["key.bias"]
        k = (k - k.mean(1, keepdims=True)) / np.sqrt(k.var(1, keepdims=True) + 1e-5)
        return k * params["key.norm.scale"] + params["key.norm.shift"]

    asked, known = tuples(query), np.concatenate([tuples(clip) for clip in support])
    values = [of @ params["value.weight"] + params["value.bias"] for of in (asked, known)]
    scores = keys(asked) @ keys(known).T / np.sqrt(128)
    attention = np.exp(scores - scores.max(1, keepdims=True))
    attention /= attention.sum(1, keepdims=True)
    return np.asarray(values[0] - attention @ values[1])


def projected(params: dict[str, FloatArray], frames: FloatArray) -> FloatArray:
    features = trx_os.with_positions(CONFIG, trx_os.psi(params, frames))
    return np.asarray(trx_os.project(params, CONFIG, features))


def difference(params: dict[str, FloatArray], query: FloatArray, support: FloatArray) -> FloatArray:
    keys, values = trx_os.pairs(params, CONFIG, projected(params, query[None]))
    s_keys, s_values = trx_os.pairs(params, CONFIG, projected(params, support))
    prototype = trx_os.prototypes(
        trx_os.attention(keys[0], s_keys.reshape(-1, 128)), s_values.reshape(-1, 128)
    )
    return np.asarray(values[0] - prototype)


@given(seed=st.integers(0, 2**32 - 1), shots=st.integers(1, 3))
@settings(max_examples=cases(10))
def test_projecting_frames_first_equals_the_plain_tuple_matrix(seed: int, shots: int) -> None:
    params = random_params(seed)
    query, support = random_frames(seed, 1)[0], random_frames(seed + 1, shots)
    np.testing.assert_allclose(
        difference(params, query, support), plain(params, query, support), atol=2e-5
    )


def test_numpy_and_torch_agree() -> None:
    params = random_params(3)
    frames = random_frames(4, 6)
    tensors = {name: torch.from_numpy(value) for name, value in params.items()}

    def forward(weights, x):  # type: ignore[no-untyped-def]  # either array type
        features = trx_os.with_positions(CONFIG, trx_os.psi(weights, x))
        keys, values = trx_os.pairs(weights, CONFIG, trx_os.project(weights, CONFIG, features))
        attended = trx_os.attention(keys[:1], keys[1:])
        gap = values[:1] - trx_os.prototypes(attended, values[1:])
        return trx_os.distance(gap), trx_os.discriminator(weights, gap)

    for ours, theirs in zip(
        forward(params, frames), forward(tensors, torch.from_numpy(frames)), strict=True
    ):
        np.testing.assert_allclose(ours, theirs.numpy(), atol=1e-5)


def test_a_clip_is_nearer_to_itself_than_to_others() -> None:
    params, frames = random_params(0), random_frames(0, 8)
    distances = [
        float(trx_os.distance(difference(params, frames[0], frames[[other]]))) for other in range(8)
    ]
    assert np.argmin(distances) == 0


def test_the_distance_is_the_mean_squared_norm() -> None:
    gap = np.zeros((120, 128), np.float32)
    gap[:, 0], gap[60:, 1] = 3.0, 4.0
    assert trx_os.distance(gap) == pytest.approx(17.0)


def test_pairs_are_ordered_and_complete() -> None:
    first, second = trx_os.pair_indices(16)
    assert len(first) == 120
    assert all(i < j for i, j in zip(first, second, strict=True))
    assert len(set(zip(first, second, strict=True))) == 120


def test_prototypes_attend_to_all_examples_of_an_action() -> None:
    rng = np.random.default_rng(0)
    keys = np.zeros((4, 8), np.float32)
    values = rng.normal(size=(6, 8)).astype(np.float32)
    prototype = trx_os.prototypes(trx_os.attention(keys, np.zeros((6, 8), np.float32)), values)
    np.testing.assert_allclose(prototype, np.tile(values.mean(0), (4, 1)), atol=1e-6)
