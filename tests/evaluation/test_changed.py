"""Clips that show nearly an action."""

from pathlib import Path

import numpy as np
import pytest

from actioncli.clips.clip import Clip
from actioncli.clips.collection import Collection
from actioncli.clips.read import read_clip
from actioncli.clips.skeleton import DEFAULT_JOINTS, LIMBS, select_joints
from actioncli.errors import ClipError
from actioncli.evaluation.changed import CHANGES, changed
from actioncli.recognition.recognizer import Recognizer

EXAMPLES = Path(__file__).parents[2] / "examples"


@pytest.fixture(scope="module")
def kick() -> Clip:
    return read_clip(EXAMPLES / "kick_right/ada.npz")


def made(kind: str, clip: Clip) -> Clip:
    return CHANGES[kind](clip, np.random.default_rng(0))


def test_frames_change_their_order_alone(kick: Clip) -> None:
    np.testing.assert_array_equal(made("played backwards", kick).joints, kick.joints[::-1])
    np.testing.assert_array_equal(made("first quarter", kick).joints, kick.joints[: len(kick) // 4])
    shuffled = made("four blocks shuffled", kick).joints
    assert not np.array_equal(shuffled, kick.joints)
    np.testing.assert_array_equal(*(np.sort(x.ravel()) for x in (shuffled, kick.joints)))


def test_the_limb_that_moves_most_keeps_its_place(kick: Clip) -> None:
    def limbs(clip: Clip) -> dict[str, float]:
        """How far each limb's end wanders about its root."""
        joints = select_joints(clip.joints, clip.joint_names, DEFAULT_JOINTS, clip.source)
        at = {name: joints[:, column] for column, name in enumerate(DEFAULT_JOINTS)}
        return {limb: float((at[end] - at[root]).std(axis=0).sum())
                for limb, (root, _, end) in LIMBS.items()}  # fmt: skip

    before, after = limbs(kick), limbs(made("most moving limb frozen", kick))
    assert after.pop("right leg") < 0.01 < before.pop("right leg")
    assert after == pytest.approx(before, abs=1e-5)


def test_depth_is_gone_and_nothing_else(kick: Clip) -> None:
    flat = made("without depth", kick)
    np.testing.assert_array_equal(flat.joints[..., :2], kick.joints[..., :2])
    assert np.ptp(flat.joints[..., 2]) == 0


def test_shares_by_kind_follow_from_the_seed(recognizer: Recognizer) -> None:
    files = sorted(EXAMPLES.glob("*/*.npz"))
    examples = Collection(
        clips=tuple(map(read_clip, files)),
        labels=tuple(file.parent.name for file in files),
        subjects=tuple(file.stem for file in files),
        name="examples",
    )
    found = changed(recognizer, [examples])
    assert found == changed(recognizer, [examples])
    share = {each.kind: each.share for each in found}
    assert share["another person"] > 0.5 > share["something else"]
    # Nobody moves, so it is rejected whatever the score.
    assert share["standing in the first pose"] == 0
    assert share.keys() >= CHANGES.keys()


def test_a_quarter_in_which_nothing_moves_is_left_out(recognizer: Recognizer) -> None:
    whole = read_clip(EXAMPLES / "squat/ada.npz")
    late = np.concatenate([np.repeat(whole.joints[:1], len(whole), axis=0), whole.joints])
    clip = Clip(late, whole.joint_names, whole.fps)
    with pytest.raises(ClipError):
        made("first quarter", clip)
    two = Collection(clips=(clip, whole), labels=("a", "b"), subjects=("p", "q"), name="two")
    asked = {each.kind: each.of for each in changed(recognizer, [two])}
    assert asked["something else"] == 1
    assert asked.get("first quarter", 0) < 2
