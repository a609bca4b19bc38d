"""What an explanation says adds up, and points at what differs."""

from pathlib import Path

import numpy as np
import pytest

from actioncli import Clip, Recognizer, read_clip
from actioncli.clips.prepare import Preparation
from actioncli.clips.skeleton import LAYOUTS
from actioncli.model.config import ModelConfig
from actioncli.model.embedding import finalized_shapes
from actioncli.model.trx_os import parameter_shapes
from actioncli.model.weights import Weights, read_weights
from actioncli.recognition.explanation import explain

EXAMPLES = Path(__file__).parents[2] / "examples"
OTHER = ModelConfig(Preparation(joints=("pelv", "lwri", "rwri", "nose")))


def untrained(config: ModelConfig) -> Recognizer:
    rng = np.random.default_rng(0)
    shapes = parameter_shapes(config) | finalized_shapes(config, cohort=9)
    tensors = {
        name: rng.normal(0, 0.05, shape).astype(np.float32) for name, shape in shapes.items()
    }
    return Recognizer(Weights(config, tensors, {}, "", Path()))


@pytest.fixture(scope="module")
def clips() -> dict[str, Clip]:
    names = ("wave_right/ada", "wave_right/ben", "wave_left/ada", "squat/ada", "punch_right/dev")
    return {name: read_clip(EXAMPLES / f"{name}.npz") for name in names}


CONFIGS = {"paper": ModelConfig(), "default": read_weights().trx_os}


@pytest.fixture(scope="module", params=["shipped", *CONFIGS, "other joints"])
def recognizer(request: pytest.FixtureRequest) -> Recognizer:
    """The shipped weights, and untrained ones of every kind of model."""
    if request.param == "shipped":
        return Recognizer()
    return untrained(CONFIGS.get(request.param, OTHER))


@pytest.mark.parametrize("query", ["punch_right/dev", "wave_left/ada", "squat/ada"])
def test_parts_and_base_add_up_to_the_distance(
    clips: dict[str, Clip], recognizer: Recognizer, query: str
) -> None:
    examples = [clips["wave_right/ada"], clips["wave_right/ben"]]
    found = explain(recognizer, clips[query], examples)
    told = recognizer.compare([clips[query]], {"wave": examples}).distance[0, 0]
    assert found.distance == pytest.approx(told, abs=1e-4)
    assert found.base + sum(found.joints.values()) == pytest.approx(found.distance, abs=1e-4)
    assert found.base + found.moments.sum() == pytest.approx(found.distance, abs=1e-4)
    assert set(found.joints) == set(recognizer.weights.config.preparation.joints) - {"pelv"}
    assert found.attention.shape == (16, 16)
    assert ((found.attention >= 0) & (found.attention <= 1)).all()
    assert (found.attention.sum(axis=1) <= 1 + 1e-6).all()
    shares = [pair.share for pair in found.pairs]
    assert shares == sorted(shares, reverse=True)
    assert all(0 < pair.weight <= 1 and pair.query[0] < pair.query[1] for pair in found.pairs)


def test_one_example_takes_all_attention(clips: dict[str, Clip]) -> None:
    recognizer = untrained(CONFIGS["default"])
    found = explain(recognizer, clips["squat/ada"], [clips["wave_right/ada"]])
    np.testing.assert_allclose(found.attention.sum(axis=1), 1, atol=1e-5)


def test_what_differs_is_told_where_and_when() -> None:
    # The same recorded movement, but for the right hand in the last third.
    clip = read_clip(EXAMPLES / "squat/ada.npz", layout="smpl+head_30")
    moved = clip.joints.copy()
    last = len(moved) * 2 // 3
    names = LAYOUTS["smpl+head_30"]
    for joint in ("rwri", "rhan"):
        moved[last:, names.index(joint), 1] += np.linspace(0, 0.6, len(moved) - last)
    other = Clip(moved, clip.joint_names, clip.fps)
    found = explain(untrained(ModelConfig()), other, [clip])
    assert max(found.joints, key=lambda joint: abs(found.joints[joint])) == "rwri"
    assert np.abs(found.moments[11:]).sum() > 0.9 * np.abs(found.moments).sum()
    still = sum(abs(part) for joint, part in found.joints.items() if joint != "rwri")
    assert still == pytest.approx(0, abs=1e-4)


def test_the_example_itself_leaves_nothing_to_explain(clips: dict[str, Clip]) -> None:
    clip = clips["squat/ada"]
    found = explain(untrained(ModelConfig()), clip, [clips["wave_right/ada"], clip])
    assert found.example == 1
    assert found.base == pytest.approx(found.distance, abs=1e-5)
    assert not any(found.joints.values())


def test_a_mirrored_query_is_compared_mirrored(clips: dict[str, Clip]) -> None:
    config = CONFIGS["default"]
    assert config.mirrored
    recognizer = untrained(config)
    assert explain(recognizer, clips["wave_left/ada"], [clips["wave_right/ada"]]).mirrored
    assert not explain(recognizer, clips["wave_right/ben"], [clips["wave_right/ada"]]).mirrored
