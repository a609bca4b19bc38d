"""What an explanation says: leaving a part or a moment out, and what attends to what."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from actioncli import Clip, Recognizer, WeightsError, read_clip
from actioncli.clips.clip import FloatArray
from actioncli.clips.parts import PARTS
from actioncli.clips.skeleton import LIMBS, default_columns
from actioncli.model import trx_os
from actioncli.model.config import ModelConfig
from actioncli.model.weights import Weights
from actioncli.recognition.explanation import explain, listed

EXAMPLES = Path(__file__).parents[2] / "examples"


@pytest.fixture(scope="module")
def clips() -> dict[str, Clip]:
    names = ("wave_right/ada", "wave_right/ben", "squat/ada", "squat/ben")
    return {name: read_clip(EXAMPLES / f"{name}.npz") for name in names}


def logit(recognizer: Recognizer, query: Clip, example: Clip) -> float:
    return -float(np.log(recognizer.compare([query], {"": [example]}).distance[0, 0]))


def unseen(clip: Clip, *limbs: str) -> Clip:
    confidence: FloatArray = np.ones(clip.joints.shape[:2], np.float32)
    for limb in limbs:
        for joint in LIMBS[limb][1:]:
            confidence[:, list(default_columns(clip.joint_names)[joint])] = 0
    return Clip(clip.joints, clip.joint_names, clip.fps, confidence)


def test_a_part_contributes_what_the_score_loses_without_it(
    recognizer: Recognizer, clips: dict[str, Clip]
) -> None:
    query, example = clips["squat/ben"], clips["squat/ada"]
    found = explain(recognizer, query, [clips["wave_right/ada"], example])
    assert found.example == 1
    assert found.score == pytest.approx(logit(recognizer, query, example), abs=1e-3)
    # Nobody's hands are in these clips.
    assert list(found.parts) == list(PARTS[:5])
    # As if the arm had not been seen: its bones also take the place of what is not there.
    gone = logit(recognizer, unseen(query, "left arm"), unseen(example, "left arm"))
    assert found.parts["left arm"] == pytest.approx(found.score - gone, abs=0.75)


def test_what_moves_contributes_most(recognizer: Recognizer, clips: dict[str, Clip]) -> None:
    found = explain(recognizer, clips["wave_right/ben"], [clips["wave_right/ada"]])
    assert max(found.parts, key=lambda part: found.parts[part]) == "right arm"
    assert found.parts["right arm"] > 1


def test_moments_and_attention_go_through_the_clip(
    recognizer: Recognizer, clips: dict[str, Clip]
) -> None:
    found = explain(recognizer, clips["squat/ben"], [clips["squat/ada"]])
    assert found.moments.shape == (16,)
    assert found.attention.shape == (16, 16)
    np.testing.assert_allclose(found.attention.sum(axis=1), 1, atol=1e-5)
    middle = found.attention @ np.arange(16)
    assert np.corrcoef(middle, np.arange(16))[0, 1] > 0.9


def test_exchanged_parts_are_those_of_the_example(
    recognizer: Recognizer, clips: dict[str, Clip]
) -> None:
    query, example = clips["wave_right/ben"], clips["squat/ada"]
    found = explain(recognizer, query, [example])
    assert len(found.exchanged) == 5 + 10 + 10
    # What is exchanged for itself changes nothing.
    same = explain(recognizer, example, [example]).exchanged.values()
    assert list(same) == pytest.approx([recognizer.compare([example], {"": [example]})
                                        .confidence[0, 0]] * 25, abs=1e-4)  # fmt: skip
    # A body whose arms squat, and whose legs stand as when waving.
    columns = [query.joint_names.index(side + joint) for side in "lr"
               for joint in ("elb", "wri", "han")]  # fmt: skip
    shoulders = [query.joint_names.index(f"{side}sho") for side in "lr" for _ in range(3)]
    at = np.round(np.linspace(0, len(query) - 1, len(example))).astype(int)
    joints = query.joints[at]
    moved = example.joints[:, columns] - example.joints[:, shoulders]
    joints[:, columns] = joints[:, shoulders] + moved
    made = Clip(joints, query.joint_names, example.fps)
    wanted = recognizer.compare([made], {"": [example]}).confidence[0, 0]
    assert found.exchanged["left arm", "right arm"] == pytest.approx(wanted, abs=0.25)


def test_what_lacks_is_told_in_words(recognizer: Recognizer, clips: dict[str, Clip]) -> None:
    found = explain(recognizer, clips["wave_right/ben"], [clips["squat/ada"]])
    # The fewest parts that suffice, and of these the surest.
    sure = dict.fromkeys(found.exchanged, 0.1)
    sure["left arm", "right arm"], sure["torso", "left leg"] = 0.7, 0.6
    sure["torso", "left leg", "right leg"] = 0.9
    found = replace(found, exchanged=sure)
    as_in = "as in the example it would have been accepted"
    assert found.lacking(0.5) == f"with both arms {as_in} (confidence 0.70 > tau 0.50)"
    assert found.lacking(0.8).startswith(f"with the torso and both legs {as_in}")
    assert found.lacking(0.9) == "most of the body moves in another way"
    assert listed(["right leg"]) == "the right leg"
    hands = ["torso", "left arm", "left hand", "right hand"]
    assert listed(hands) == "the torso, the left arm and both hands"


def test_weights_of_the_paper_explain_nothing(clips: dict[str, Clip]) -> None:
    rng = np.random.default_rng(0)
    config = ModelConfig(width=8, key_width=4, tuple_width=2)
    tensors = {
        name: rng.normal(0, 0.1, shape).astype(np.float32)
        for name, shape in trx_os.parameter_shapes(config).items()
    }
    paper = Recognizer(Weights(config, tensors, {}, "", Path("paper")))
    with pytest.raises(WeightsError, match="only weights of recipe default explain"):
        explain(paper, clips["squat/ben"], [clips["squat/ada"]])
