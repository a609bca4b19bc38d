"""The NTU RGB+D 120 protocol on small generated files of that data set's format."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from actioncli.clips.layouts import LAYOUTS
from actioncli.clips.prepare import Preparation
from actioncli.errors import ClipError
from actioncli.evaluation.baselines import AlwaysReject, Dtw, Random
from actioncli.evaluation.ntu import EXEMPLARS, evaluate_ntu

from .conftest import motion

JOINTS = LAYOUTS["kinect_v2_25"]


def write_skeleton(file: Path, action: int, seed: int) -> None:
    """One body whose joints move as in `motion`; joints that it lacks stay at the pelvis."""
    clip = motion(action, np.random.default_rng(seed))
    joints = np.repeat(clip.joints[:, :1], len(JOINTS), axis=1)
    for name in set(JOINTS) & set(clip.joint_names):
        joints[:, JOINTS.index(name)] = clip.joints[:, clip.joint_names.index(name)]
    lines = [str(len(joints))]
    for frame in joints:
        lines += ["1", "72057594037931101 0 1 1 1 1 0 0.02 -0.2 2", str(len(JOINTS))]
        # x y z, depth and colour pixels, orientation, tracked
        lines += [f"{x} {y} {z} 0 0 0 0 0 0 0 1 2" for x, y, z in frame]
    file.write_text("\n".join(lines) + "\n")


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Every exemplar, two more samples of each class, and an action that is not in the protocol."""
    place = tmp_path_factory.mktemp("ntu")
    for number, (action, exemplar) in enumerate(EXEMPLARS.items()):
        others = [f"S002C00{camera}P003R001{action}" for camera in (1, 2)]
        for seed, name in enumerate([exemplar, *others]):
            (place / name[:4]).mkdir(exist_ok=True)
            write_skeleton(place / name[:4] / f"{name}.skeleton", number, seed)
    write_skeleton(place / "S001C003P008R001A055.skeleton", 3, 0)
    (place / "notes.skeleton").write_text("not a sample")
    return place


def test_exemplars_are_the_official_ones_without_the_actions_of_two() -> None:
    assert len(EXEMPLARS) == 17
    assert list(EXEMPLARS)[:2] == ["A001", "A007"]
    assert list(EXEMPLARS)[-1] == "A103"
    assert not {"A055", "A109", "A115"} & set(EXEMPLARS)
    assert EXEMPLARS["A049"] == "S001C003P008R001A049"
    assert EXEMPLARS["A061"] == "S018C003P008R001A061"


def test_protocol_runs_for_each_number_of_ways(folder: Path) -> None:
    told: list[tuple[str, int, int]] = []
    scorer = Dtw(Preparation(size="torso", heading=True))
    found = evaluate_ntu(
        scorer, folder, ways=[5, 15], episodes=6, progress=lambda *step: told.append(step)
    )
    five, fifteen = found.evaluation.results
    assert found.evaluation.protocol == "ntu-one-shot"
    assert (five.ways_used, five.classes, five.queries) == (5, 17, 34)
    assert five["closed_set_accuracy"].mean > 0.8
    assert five["always_reject_fsos_accuracy"].mean == pytest.approx(12 / 17)
    assert fifteen["always_reject_fsos_accuracy"].mean == pytest.approx(2 / 17)
    assert found.acceptance.classes == tuple(EXEMPLARS)
    assert (found.acceptance.asked == 2).all()
    assert told[-1][1] == told[-1][2]


def test_draws_follow_from_the_seed(folder: Path) -> None:
    one, same, other = (
        evaluate_ntu(Random(0), folder, ways=[5], episodes=5, seed=seed).evaluation.results[0]
        for seed in (0, 0, 1)
    )
    np.testing.assert_array_equal(one.values["auroc"], same.values["auroc"])
    assert not np.array_equal(one.values["auroc"], other.values["auroc"])


def test_missing_exemplars_are_named(tmp_path: Path) -> None:
    with pytest.raises(ClipError, match=r"not there: S001C003P008R001A001\.skeleton, "):
        evaluate_ntu(AlwaysReject(), tmp_path)


def test_unusable_samples_are_skipped_and_classes_without_any_refused(tmp_path: Path) -> None:
    for number, (action, exemplar) in enumerate(EXEMPLARS.items()):
        write_skeleton(tmp_path / f"{exemplar}.skeleton", number, 0)
        write_skeleton(tmp_path / f"S002C001P003R001{action}.skeleton", number, 1)
    (tmp_path / "S003C001P003R001A001.skeleton").write_text("0\n")
    found = evaluate_ntu(AlwaysReject(), tmp_path, ways=[5], episodes=1)
    assert "1 samples" in found.evaluation.skipped[0].reason
    assert "S003C001P003R001A001" in found.evaluation.skipped[0].reason
    (tmp_path / "S002C001P003R001A007.skeleton").unlink()
    with pytest.raises(ClipError, match="beside the exemplar of A007"):
        evaluate_ntu(AlwaysReject(), tmp_path, ways=[5], episodes=1)
