"""The example clips: made by the generator, shaped like people, and recognised as promised."""

from pathlib import Path

import make_examples
import numpy as np
import puppet
import pytest

import actioncli
from actioncli.clips.skeleton import LAYOUTS

EXAMPLES = Path(__file__).parent.parent / "examples"
CLIPS = [f"{action}/{performer}" for action, performer, *_ in make_examples.CLIPS]

_BONES = (
    "lhip-lkne lkne-lank lank-ltoe rhip-rkne rkne-rank rank-rtoe pelv-lhip pelv-rhip "
    "pelv-spi1 spi1-spi2 spi2-spi3 spi3-neck neck-head spi3-lcla lcla-lsho lsho-lelb "
    "lelb-lwri lwri-lhan spi3-rcla rcla-rsho rsho-relb relb-rwri rwri-rhan head-htop "
    "head-nose head-leye head-reye head-lear head-rear"
)
BONES = [tuple(bone.split("-")) for bone in _BONES.split()]


def test_generator_reproduces_the_committed_files(tmp_path: Path) -> None:
    make_examples.main(tmp_path)
    made = {path.relative_to(tmp_path): path.read_bytes() for path in tmp_path.glob("*/*.npz")}
    kept = {path.relative_to(EXAMPLES): path.read_bytes() for path in EXAMPLES.glob("*/*.npz")}
    assert sorted(made) == sorted(kept)
    assert [path for path in made if made[path] != kept[path]] == []
    assert max(map(len, kept.values())) < 60_000


def test_joint_names_are_those_of_the_layout() -> None:
    assert LAYOUTS["smpl+head_30"] == puppet.JOINT_NAMES


@pytest.mark.parametrize("entry", make_examples.CLIPS, ids=CLIPS)
def test_bodies_keep_their_bones_and_stay_above_the_ground(entry: tuple) -> None:
    _, name, perform, side = entry
    stage = perform(make_examples.PERFORMERS[name], side)
    make_examples.fidget(stage, np.random.default_rng(0))
    joints = puppet.joint_positions(stage.performer.body, stage.motion)
    column = puppet.JOINT_NAMES.index
    for start, end in BONES:
        lengths = np.linalg.norm(joints[:, column(end)] - joints[:, column(start)], axis=1)
        np.testing.assert_allclose(lengths, lengths[0], rtol=1e-9, err_msg=f"{start}-{end}")
    assert joints[..., 1].min() > -0.02
    # Nobody's joint is quicker than a fast punch.
    speed = np.linalg.norm(np.diff(joints, axis=0), axis=2).max() * stage.performer.fps
    assert speed < 9.0


@pytest.mark.parametrize("clip", CLIPS)
def test_clips_are_read_without_an_option(clip: str) -> None:
    read = actioncli.read_clip(EXAMPLES / f"{clip}.npz")
    performer = make_examples.PERFORMERS[Path(clip).name]
    assert read.joint_names == puppet.JOINT_NAMES
    assert read.fps == pytest.approx(performer.fps)
    assert 2.0 < read.duration < 6.0
    # Metres, y up: the first frame stands, as tall as the performer, nearly upright.
    first = dict(zip(read.joint_names, read.joints[0], strict=True))
    tall = first["htop"][1] - min(first["ltoe"][1], first["rtoe"][1])
    assert tall == pytest.approx(performer.body.stature, rel=0.08)
    # Everyone faces the camera more or less: the left side at smaller x.
    assert first["lsho"][0] < first["rsho"][0]
    assert first["nose"][2] < first["head"][2]


def test_folder_reads_as_a_collection() -> None:
    collection = actioncli.read_collection(EXAMPLES)
    assert sorted(collection.labels) == sorted(action for action, *_ in make_examples.CLIPS)


@pytest.mark.parametrize(
    ("query", "label"),
    [
        ("wave_right/cleo", "wave_right"),
        ("squat/cleo", "squat"),
        ("jumping_jack/dev", "jumping_jack"),
        ("bow/ben", None),
        ("kick_right/cleo", None),
    ],
)
def test_enrolled_actions_are_recognised_and_others_rejected(
    recognizer: actioncli.Recognizer, query: str, label: str | None
) -> None:
    enrolled = ("wave_right", "squat", "jumping_jack")
    support = {action: [actioncli.read_clip(EXAMPLES / action / "ada.npz")] for action in enrolled}
    assert (
        recognizer.classify(actioncli.read_clip(EXAMPLES / f"{query}.npz"), support).label == label
    )


def test_left_is_not_right(recognizer: actioncli.Recognizer) -> None:
    clips = {
        name: actioncli.read_clip(EXAMPLES / f"{name}.npz")
        for name in ("wave_left/ada", "wave_right/ada", "wave_left/dev", "wave_right/cleo")
    }
    support = {side: [clips[f"wave_{side}/ada"]] for side in ("left", "right")}
    assert recognizer.classify(clips["wave_left/dev"], support).label == "left"
    assert recognizer.classify(clips["wave_right/cleo"], support).label == "right"
