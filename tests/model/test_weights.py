"""Weights files: what is written is read, what is damaged is refused."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from cases import cases
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from safetensors.numpy import save_file

from actioncli.clips.clip import FloatArray
from actioncli.errors import WeightsError
from actioncli.model.config import (
    Config,
    ModelConfig,
    PartsConfig,
    config_from_json,
    config_to_json,
)
from actioncli.model.trx_os import parameter_shapes
from actioncli.model.weights import FORMAT, read_weights, write_weights

CONFIG = ModelConfig()


def some_tensors() -> dict[str, FloatArray]:
    rng = np.random.default_rng(0)
    return {
        name: rng.normal(size=shape).astype(np.float32)
        for name, shape in parameter_shapes(CONFIG).items()
    }


@pytest.fixture(scope="module")
def written(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("weights") / "model.safetensors"
    write_weights(path, CONFIG, some_tensors(), {"seed": 7})
    return path


def test_round_trip(written: Path) -> None:
    weights = read_weights(written)
    assert weights.config == CONFIG
    assert weights.metadata == {"seed": 7}
    assert len(weights.checksum) == 64
    for name, tensor in some_tensors().items():
        np.testing.assert_array_equal(weights.tensors[name], tensor)


def test_half_precision_is_stored_as_such_and_read_as_single(tmp_path: Path) -> None:
    path = tmp_path / "half.safetensors"
    halves = {name: tensor.astype(np.float16) for name, tensor in some_tensors().items()}
    write_weights(path, CONFIG, halves, {})
    assert all(tensor.dtype == np.float32 for tensor in read_weights(path).tensors.values())


def test_the_checksum_tells_weights_apart(tmp_path: Path, written: Path) -> None:
    other = some_tensors()
    other["disc.2.bias"] = other["disc.2.bias"] + 1
    assert write_weights(tmp_path / "o.safetensors", CONFIG, other, {}) != (
        read_weights(written).checksum
    )


@given(cut=st.floats(0, 1, exclude_max=True))
@settings(max_examples=cases(20), suppress_health_check=[HealthCheck.function_scoped_fixture])
def test_truncated_weights_are_refused(written: Path, tmp_path: Path, cut: float) -> None:
    content = written.read_bytes()
    path = tmp_path / "cut.safetensors"
    path.write_bytes(content[: int(cut * len(content))])
    with pytest.raises(WeightsError, match=r"cut\.safetensors"):
        read_weights(path)


@given(at=st.floats(0, 1, exclude_max=True), bit=st.integers(0, 7))
@settings(max_examples=cases(60), suppress_health_check=[HealthCheck.function_scoped_fixture])
def test_a_flipped_bit_is_noticed(written: Path, tmp_path: Path, at: float, bit: int) -> None:
    content = bytearray(written.read_bytes())
    content[int(at * len(content))] ^= 1 << bit
    path = tmp_path / "flipped.safetensors"
    path.write_bytes(content)
    with pytest.raises(WeightsError, match=r"flipped\.safetensors"):
        read_weights(path)


def test_missing_and_foreign_files_are_told_apart(tmp_path: Path) -> None:
    with pytest.raises(WeightsError, match="no such weights"):
        read_weights(tmp_path / "none.safetensors")
    foreign = tmp_path / "foreign.safetensors"
    save_file({"x": np.zeros(3)}, foreign)
    with pytest.raises(WeightsError, match="not weights of actioncli"):
        read_weights(foreign)
    newer = tmp_path / "newer.safetensors"
    save_file({"x": np.zeros(3)}, newer, metadata={"format": FORMAT, "format_version": "99"})
    with pytest.raises(WeightsError, match="format version 99"):
        read_weights(newer)


def test_tensors_must_fit_the_configuration(tmp_path: Path) -> None:
    tensors = some_tensors()
    del tensors["key.bias"]
    path = tmp_path / "unfit.safetensors"
    write_weights(path, CONFIG, tensors, {})
    with pytest.raises(WeightsError, match="do not fit"):
        read_weights(path)


@pytest.mark.parametrize(
    "text", ["", "[]", "{}", '{"preparation": {}}', '{"x": 1}', '{"method": "other"}']
)
def test_unknown_configurations_are_refused(text: str) -> None:
    with pytest.raises(WeightsError, match="cannot read"):
        config_from_json(text)


@pytest.mark.parametrize("config", [CONFIG, PartsConfig(width=16)])
def test_configuration_round_trip(config: Config) -> None:
    assert config_from_json(config_to_json(config)) == config


def test_weights_of_an_earlier_method_are_refused_by_name() -> None:
    earlier = config_to_json(CONFIG).replace('"width"', '"warp_width": 16, "width"')
    with pytest.raises(WeightsError, match=r"of an earlier method: warp_width.*train"):
        config_from_json(earlier)
