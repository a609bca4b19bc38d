"""From a clip of any layout to points, bones, sides and ground."""

import numpy as np
import pytest
from clips.bodies import STANCE

from actioncli import Clip
from actioncli.clips.skeleton import DEFAULT_JOINTS, HAND_JOINTS, LAYOUTS
from actioncli.report.figure import figure, project


def standing(frames: int = 5) -> np.ndarray:
    joints = np.tile(np.array([STANCE[name] for name in DEFAULT_JOINTS], float), (frames, 1, 1))
    joints[:, DEFAULT_JOINTS.index("rwri"), 1] += np.linspace(0, 0.5, frames)
    return joints


def turned(joints: np.ndarray, angle: float) -> np.ndarray:
    cos, sin = np.cos(angle), np.sin(angle)
    return joints @ np.array([[cos, 0, -sin], [0, 1, 0], [sin, 0, cos]])


def test_the_body_stands_on_the_ground_and_faces_the_viewer() -> None:
    for angle in (0, 1, 3):
        walked = turned(standing(), angle) + [3, -0.7, 2] + np.arange(5)[:, None, None] * 0.1
        found = figure(Clip(walked, DEFAULT_JOINTS))
        assert found.points[..., 1].min() == pytest.approx(0, abs=1e-6)
        left, right = (found.points[:, found.names.index(name)] for name in ("lsho", "rsho"))
        assert (left[:, 0] < right[:, 0] - 0.3).all()
        # The viewer sees the body's left side on the right.
        flat = project(found.points)
        assert flat[0, found.names.index("lsho"), 0] > flat[0, found.names.index("rsho"), 0]


def test_who_does_push_ups_is_seen_from_the_side() -> None:
    """A body in the plank, wherever its head points to, lies across the picture, hands below."""
    lying = standing() @ np.array([[1.0, 0, 0], [0, 0, -1], [0, 1, 0]])  # on its front
    for angle in (0, 1, 3):
        found = figure(Clip(turned(lying, angle), DEFAULT_JOINTS))
        flat = project(found.points)[0]
        head, ankle, hip, wrist = (
            flat[found.names.index(name)] for name in ("head", "lank", "lhip", "lwri")
        )
        assert ankle[0] - head[0] > 1.2
        assert abs(ankle[1] - head[1]) < 0.3
        assert wrist[1] < hip[1]


def test_the_telling_frame_is_where_the_action_is() -> None:
    joints = standing(9)
    raised = joints[-1].copy()
    joints[:] = joints[0]
    joints[4] = raised
    # Walking along tells nothing.
    walked = joints + np.arange(9)[:, None, None] * [0.3, 0, 0]
    for clip in (joints, walked):
        assert figure(Clip(clip, DEFAULT_JOINTS)).telling == 4


def test_what_is_nearer_to_the_viewer_is_lower_in_the_picture() -> None:
    near, far = project(np.array([[0, 0, -1], [0, 0, 1]], np.float32))
    assert near[1] < far[1]


def test_a_body_centred_by_its_source_stands_in_every_frame() -> None:
    joints = standing()
    joints -= joints[:, :1]
    joints[2:, DEFAULT_JOINTS.index("lank"), 1] += 0.4
    joints[2:, DEFAULT_JOINTS.index("rank"), 1] += 0.4
    found = figure(Clip(joints, DEFAULT_JOINTS))
    np.testing.assert_allclose(found.points[..., 1].min(axis=1), 0, atol=1e-6)


@pytest.mark.parametrize("layout", LAYOUTS)
def test_bones_of_every_layout_join_the_same_side(layout: str) -> None:
    names = LAYOUTS[layout]
    joints = np.random.default_rng(0).normal(size=(3, len(names), 3))
    found = figure(Clip(joints, names))
    assert {"left", "right", "middle"} == {side for _, _, side in found.bones}
    assert len(found.bones) >= 14
    for a, b, side in found.bones:
        assert 0 <= a < len(found.names)
        assert a != b
        if side == "middle":
            assert {found.names[a], found.names[b]} <= {"pelv", "neck", "head"}
        else:
            far = found.names[b].lower()
            assert far.startswith(side[0]) or side in far
    feet = {"smpl_24": "ltoe", "kinect_v1_20": "foot_left", "blazepose_33": "rheel"}
    if layout in feet:
        assert feet[layout] in found.names


def test_rigs_have_toes() -> None:
    names = [f"mixamorig:{side}{part}" for side in ("Left", "Right")
             for part in ("UpLeg", "Leg", "Foot", "ToeBase", "Arm", "ForeArm", "Hand")]  # fmt: skip
    joints = np.random.default_rng(0).normal(size=(3, len(names), 3))
    found = figure(Clip(joints, names))
    ankle, toe = found.names.index("lank"), found.names.index("mixamorig:LeftToeBase")
    assert (ankle, toe, "left") in found.bones


def test_guessed_joints_are_told() -> None:
    confidence = np.ones((5, 15))
    confidence[3, DEFAULT_JOINTS.index("lwri")] = 0.1
    found = figure(Clip(standing(), DEFAULT_JOINTS, confidence=confidence))
    assert np.argwhere(~found.sure).tolist() == [[3, found.names.index("lwri")]]


def test_a_hand_lies_in_the_wrist_until_it_is_seen() -> None:
    body, hand = standing(), np.random.default_rng(0).normal(size=(5, 42, 3))
    hand[:3, :21] = np.nan
    hand[:, 21:] = np.nan
    found = figure(Clip(np.concatenate([body, hand], axis=1), (*DEFAULT_JOINTS, *HAND_JOINTS)))
    fingers = [found.names.index(name) for name in HAND_JOINTS[:21]]
    wrist = found.points[:, found.names.index("lwri")]
    away = np.linalg.norm(found.points[:, fingers] - wrist[:, None], axis=2).max(axis=1)
    assert (away[:3] == 0).all()
    assert (away[3:] > 0.5).all()
    assert "rhand5" not in found.names
    thin = [bone for bone in found.bones if found.stroke(bone) < 1]
    assert len(thin) == 20
    assert {side for _, _, side in thin} == {"left"}
    assert (fingers[7], fingers[8], "left") in thin
    assert found.sure[:, fingers].all()


def test_joints_of_no_known_body_are_points() -> None:
    joints = np.random.default_rng(0).normal(size=(4, 3, 3))
    found = figure(Clip(joints, ["a", "b", "c"]))
    assert (found.names, found.bones, found.head) == (("a", "b", "c"), (), None)


def test_frames_by_time() -> None:
    found = figure(Clip(standing(), DEFAULT_JOINTS, fps=2))
    assert found.duration == 2
    assert [found.at(seconds) for seconds in (0, 0.9, 2, 9)] == [0, 2, 4, 4]
