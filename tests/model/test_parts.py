"""The part transformer: one forward pass for numpy and torch, and what must not decide."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from actioncli import Clip, Recognizer, WeightsError, read_clip
from actioncli.clips.clip import FloatArray
from actioncli.clips.parts import PARTS, PartFrames, prepare_parts
from actioncli.model import parts, parts_tokens
from actioncli.model.config import PartsConfig, config_from_json, config_to_json
from actioncli.model.weights import Weights, read_weights, write_weights

CONFIG = PartsConfig(width=16, key_width=8, evidence=8)
EXAMPLES = Path(__file__).parents[2] / "examples"


def some_params() -> dict[str, FloatArray]:
    rng = np.random.default_rng(0)
    shapes = parts.parameter_shapes(CONFIG) | parts.fitted_shapes(CONFIG)
    return {
        name: rng.normal(0, 0.3, shape).astype(np.float32) for name, shape in shapes.items()
    } | {name: np.ones(shapes[name], np.float32) for name in ("confidence.scale", "pool.weight")}


PARAMS = some_params()


def some_frames(n: int = 5) -> PartFrames:
    rng = np.random.default_rng(1)
    missing = rng.random((n, 48, len(PARTS))) < 0.2
    missing[0, :, 3:] = True
    missing[1, :, 5] = True
    bones, hands = (rng.normal(size=(n, 48, count, 3)) for count in (14, 40))
    bones, hands = (x / np.linalg.norm(x, axis=-1, keepdims=True) for x in (bones, hands))
    hands *= ~missing[:, :, 5:].repeat(20, axis=2)[..., None]
    return PartFrames(bones.astype(np.float32), hands.astype(np.float32), missing)


def embedded(frames: PartFrames) -> parts.Embedded:
    return parts.embed(PARAMS, CONFIG, parts_tokens.tokens(CONFIG, *frames))


def test_numpy_and_torch_agree() -> None:
    torch = pytest.importorskip("torch")
    params = {name: torch.from_numpy(tensor) for name, tensor in PARAMS.items()}
    tensors = parts_tokens.tokens(CONFIG, *map(torch.from_numpy, some_frames()))
    other = parts.embed(params, CONFIG, tensors)
    here = embedded(some_frames())
    for one, two in zip(here, other, strict=True):
        np.testing.assert_allclose(one, two.numpy(), atol=1e-5)
    logits = parts.logits(params, CONFIG, other, other).numpy()
    np.testing.assert_allclose(parts.logits(PARAMS, CONFIG, here, here), logits, atol=1e-5)
    assert logits.std() > 1e-2


def test_pairs_do_not_depend_on_what_is_compared_beside_them() -> None:
    clips = embedded(some_frames())
    logits = parts.logits(PARAMS, CONFIG, clips, clips)
    np.testing.assert_allclose(logits, logits.T, atol=1e-5)
    np.testing.assert_allclose(
        parts.paired_logits(PARAMS, CONFIG, clips, clips), logits.diagonal(), atol=1e-5
    )
    one = parts.Embedded(*(x[:, 2:3] for x in clips))
    np.testing.assert_allclose(parts.logits(PARAMS, CONFIG, one, clips), logits[2:3], atol=1e-5)


@pytest.mark.parametrize(("part", "bones"), [(1, [8, 10, 12]), (3, [3, 5]), (4, [4, 6])])
def test_a_missing_part_does_not_change_a_logit_through_its_values(
    part: int, bones: list[int]
) -> None:
    frames = some_frames()
    frames.missing[:2, :, part] = True
    before = embedded(frames)
    frames.bones[:2, :, bones] = frames.bones[2:4, :, bones]
    after = embedded(frames)
    np.testing.assert_array_equal(
        parts.logits(PARAMS, CONFIG, before, before), parts.logits(PARAMS, CONFIG, after, after)
    )
    # A support that lacks the part altogether leaves nothing to compare it with.
    seen = parts.logits(PARAMS, CONFIG, before, before)
    before.values[part, 2:] += 1
    changed = parts.logits(PARAMS, CONFIG, before, before)
    np.testing.assert_array_equal(seen[:2], changed[:2])
    assert np.abs(seen[2:, 2:] - changed[2:, 2:]).min() > 1e-4


@pytest.fixture(scope="module")
def clips() -> list[Clip]:
    names = ("wave_right/ada", "wave_right/cleo", "squat/ada", "bow/ben")
    return [read_clip(EXAMPLES / f"{name}.npz") for name in names]


@pytest.fixture(scope="module")
def recognizer(tmp_path_factory: pytest.TempPathFactory) -> Recognizer:
    path = tmp_path_factory.mktemp("parts") / "parts.safetensors"
    checksum = write_weights(path, CONFIG, PARAMS, {"seed": 0})
    weights = read_weights(path)
    assert (weights.config, weights.checksum) == (CONFIG, checksum)
    return Recognizer(path)


def test_the_recognizer_reads_and_compares(recognizer: Recognizer, clips: list[Clip]) -> None:
    embedding = recognizer.embed(clips)
    assert embedding.shape == (4, CONFIG.tokens, CONFIG.embedding_width)
    assert recognizer.embed([]).shape == (0, *embedding.shape[1:])
    support = {"one": embedding[:1], "two": embedding[1:3]}
    found = recognizer.compare(embedding, support)
    frames = embedded(prepare_parts(clips, CONFIG.preparation))
    logits = parts.logits(PARAMS, CONFIG, frames, frames) + PARAMS["confidence.shift"]
    best = np.stack([logits[:, 0], logits[:, 1:3].max(axis=1)], axis=1)
    np.testing.assert_allclose(found.confidence, 1 / (1 + np.exp(-best)), atol=1e-5)
    np.testing.assert_allclose(found.distance, np.exp(-best), rtol=1e-4)
    np.testing.assert_allclose(found.probability.sum(axis=1), 1, atol=1e-5)
    # Many pairs are compared in blocks.
    many = recognizer.compare(np.tile(embedding, (10, 1, 1)), support)
    np.testing.assert_allclose(many.distance, np.tile(found.distance, (10, 1)), rtol=1e-4)
    decision = recognizer.classify(clips[0], {"one": [clips[0]], "two": clips[1:3]})
    assert [each.label for each in decision.ranking] == sorted(
        support, key=lambda label: found.distance[0, list(support).index(label)]
    )


def test_other_configurations_are_refused(clips: list[Clip]) -> None:
    text = config_to_json(CONFIG)
    for old, new in (
        ('"tokens": 16', '"tokens": 17'), ('"width": 16', '"width": 1e9'),
        ('"layers"', '"layer"'), ("standard", "torso"), ('"lsho"', '"lshou"'),
    ):  # fmt: skip
        assert old in text
        with pytest.raises(WeightsError, match="cannot read"):
            config_from_json(text.replace(old, new))
    broken = {**PARAMS, "judge1.bias": np.full(1, np.nan, np.float32)}
    other = Recognizer(Weights(CONFIG, broken, {}, "", Path("broken")))
    with pytest.raises(WeightsError, match="no numbers"):
        other.compare(clips[:1], {"": clips[:1]})


def without_legs(clip: Clip) -> Clip:
    """As somebody at a desk is seen."""
    joints = clip.joints.copy()
    names = ("hip", "pelv", "kne", "ank", "toe", "foo")
    joints[:, [at for at, name in enumerate(clip.joint_names) if name.endswith(names)]] = np.nan
    return Clip(joints, clip.joint_names, clip.fps)


@pytest.mark.parametrize(
    ("action", "of_legs"),
    [
        ("wave_right/ada", False),
        ("punch_right/dev", False),
        ("squat/ada", True),
        ("kick_right/ada", True),
    ],
)
def test_legs_that_are_not_seen_neither_speak_for_an_action_nor_against_one(
    recognizer: Recognizer, action: str, of_legs: bool
) -> None:
    whole = read_clip(EXAMPLES / f"{action}.npz")
    desk = without_legs(whole)
    for query, enrolled in ((desk, whole), (whole, desk)):
        confidence = float(recognizer.compare([query], {action: [enrolled]}).confidence[0, 0])
        assert confidence < 0.002 if of_legs else confidence > 0.5
