from __future__ import annotations

import numpy as np
import pytest

from actioncli.clips.skeleton import DEFAULT_JOINTS, LAYOUTS, default_columns, select_joints
from actioncli.errors import ClipError

MIXAMO = ["Hips", "Spine", "Neck", "Head"] + [
    side + bone
    for side in ("Left", "Right")
    for bone in ("Shoulder", "Arm", "ForeArm", "Hand", "UpLeg", "Leg", "Foot")
]
BONES = {
    "lsho": "LeftArm", "lelb": "LeftForeArm", "lwri": "LeftHand", "lhip": "LeftUpLeg",
    "lkne": "LeftLeg", "lank": "LeftFoot", "rsho": "RightArm", "rank": "RightFoot",
}  # fmt: skip


def chosen(names: list[str]) -> dict[str, list[str]]:
    return {joint: [names[at] for at in at] for joint, at in default_columns(names).items()}


@pytest.mark.parametrize("layout", LAYOUTS)
def test_every_layout_gives_the_default_joints(layout: str) -> None:
    columns = default_columns(LAYOUTS[layout])
    assert set(columns) == set(DEFAULT_JOINTS)
    for left, right in (("lsho", "rsho"), ("lwri", "rwri"), ("lkne", "rkne")):
        assert set(columns[left]).isdisjoint(columns[right])


@pytest.mark.parametrize(
    "prefix", ["mixamorig:", "mixamorig1:", "mixamorig_", "", "Bip01 ", "Model_"]
)
def test_rigs_name_joints_by_their_bones(prefix: str) -> None:
    names = [prefix + name for name in MIXAMO]
    found = chosen(names)
    assert set(found) == set(DEFAULT_JOINTS)
    assert {joint: found[joint] for joint in BONES} == {
        joint: [prefix + name] for joint, name in BONES.items()
    }


@pytest.mark.parametrize(
    ("bones", "style"),
    [
        ("Shoulder UpperArm LowerArm Hand UpperLeg LowerLeg Foot", "{bone}_{side}"),
        ("Clavicle UpperArm Forearm Hand Thigh Calf Foot", "Bip01 {side} {bone}"),
    ],
)
def test_collarbones_are_not_shoulders(bones: str, style: str) -> None:
    names = [style.format(bone=bone, side=side) for side in "LR" for bone in bones.split()]
    found = chosen([*names, "Head"])
    assert set(found) == set(DEFAULT_JOINTS)
    assert found["lsho"] == [style.format(bone="UpperArm", side="L")]


def test_pose2sim_and_gait_markers() -> None:
    parts = ("Hip", "Knee", "Ankle", "Shoulder", "Elbow", "Wrist", "BigToe", "Heel")
    halpe = [side + part for side in "RL" for part in parts]
    assert set(chosen([*halpe, "CHip", "Neck", "Head", "Nose"])) == set(DEFAULT_JOINTS)
    coco = [*halpe, "Nose", "LEye", "REye", "LEar", "REar"]
    assert chosen(coco)["head"] == ["LEar", "REar"]
    markers = ("ASI", "PSI", "KNE", "ANK", "SHO", "ELB", "WRA", "WRB", "FHD", "BHD", "TOE")
    gait = [side + marker for side in "LR" for marker in markers]
    found = chosen(gait)
    assert set(found) == set(DEFAULT_JOINTS)
    assert found["lwri"] == ["LWRA", "LWRB"]
    assert len(found["head"]) == 4


def test_pelvis_and_neck_are_midpoints_in_every_layout() -> None:
    names = LAYOUTS["kinect_v2_25"]
    joints = np.random.default_rng(0).normal(size=(4, 25, 3)).astype(np.float32)
    pelvis, neck = select_joints(joints, names, ("pelv", "neck")).swapaxes(0, 1)
    hips = joints[:, [names.index("lhip"), names.index("rhip")]].mean(axis=1)
    shoulders = joints[:, [names.index("lsho"), names.index("rsho")]].mean(axis=1)
    np.testing.assert_allclose(pelvis, hips, atol=1e-6)
    np.testing.assert_allclose(neck, shoulders, atol=1e-6)


def test_joints_beyond_the_default_ones_are_taken_by_name() -> None:
    names = LAYOUTS["smpl_24"]
    joints = np.arange(2 * 24 * 3, dtype=np.float32).reshape(2, 24, 3)
    picked = select_joints(joints, names, ("spi3", "head"))
    np.testing.assert_array_equal(picked, joints[:, [names.index("spi3"), names.index("head")]])


def test_missing_joints_are_named() -> None:
    with pytest.raises(ClipError, match=r"clip: the model needs the joints head.*--layout"):
        select_joints(np.zeros((2, 1, 3), np.float32), ["lsho"], ["lsho", "head"], "clip")
