from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from actioncli.clips.formats.json_file import read
from actioncli.clips.skeleton import DEFAULT_JOINTS
from actioncli.errors import ClipError

from ..bodies import waving

BODY = waving().round(4)


def load(tmp_path: Path, content: Any) -> Any:
    text = content if isinstance(content, str | bytes) else json.dumps(content)
    (tmp_path / "a.json").write_bytes(text.encode() if isinstance(text, str) else text)
    return read(tmp_path / "a.json")


@pytest.mark.parametrize(
    "content",
    [
        BODY.tolist(),
        BODY.reshape(40, -1).tolist(),
        BODY[:, None].tolist(),
        {"poses3d": BODY.tolist(), "poses2d": []},
        {"frames": BODY.tolist()},
        {"frames": [{"frame": at, "joints": body} for at, body in enumerate(BODY.tolist())]},
        [{"poses3d": [body]} for body in BODY.tolist()],
    ],
)
def test_the_ways_people_nest_poses(tmp_path: Path, content: Any) -> None:
    np.testing.assert_allclose(load(tmp_path, content).positions[:, 0], BODY, atol=1e-6)


def test_frames_by_joint_name(tmp_path: Path) -> None:
    lists = [dict(zip(DEFAULT_JOINTS, frame, strict=True)) for frame in BODY.tolist()]
    points = [
        {"id": 3, "joints": {name: dict(zip("xyz", at, strict=True)) for name, at in frame.items()}}
        for frame in lists
    ]
    del points[4]["joints"]["head"]
    for content in (lists, points, {"frames": points, "fps": 12}):
        recording = load(tmp_path, content)
        assert recording.joint_names == DEFAULT_JOINTS
        known = np.isfinite(recording.positions)
        np.testing.assert_allclose(recording.positions[known], BODY[:, None][known], atol=1e-6)
    assert recording.fps == 12
    assert not known[4, 0, DEFAULT_JOINTS.index("head")].any()


def listed(one: Any = lambda place: dict(zip("xyz", place, strict=True))) -> list[Any]:
    """Frames as lists of points without names."""
    return [[one(place) for place in frame] for frame in BODY.tolist()]


SEEN = listed(lambda place: {**dict(zip("xyz", place, strict=True)), "visibility": 0.5})
NAMED = [
    [{"name": name, **point} for name, point in zip(DEFAULT_JOINTS, frame, strict=True)]
    for frame in SEEN
]
FLAT = [[{"x": x, "y": y, "score": 0.9} for x, y, _ in frame] for frame in BODY.tolist()]


@pytest.mark.parametrize(
    "content",
    [
        [{"worldLandmarks": [frame], "landmarks": FLAT[:1]} for frame in SEEN],
        [{"pose_landmarks": {"landmark": frame}} for frame in SEEN],
        {"landmarks": SEEN, "fps": 30},
        SEEN,
        [None, *SEEN[1:]],
        [{"poseWorldLandmarks": [[*place, 0.5] for place in frame]} for frame in BODY.tolist()],
        [{"keypoints": FLAT[0], "keypoints3D": frame} for frame in NAMED],
        [{"keypoints": frame} for frame in NAMED],
        [{"joints": {point["name"]: {"position": point} for point in frame}} for frame in NAMED],
        [{one["name"]: {axis.upper(): one[axis] for axis in "xyz"} for one in frame}
         for frame in NAMED],
    ],
)  # fmt: skip
def test_points_as_tools_spell_them(tmp_path: Path, content: Any) -> None:
    recording = load(tmp_path, content)
    found = recording.positions[1:, 0]
    np.testing.assert_allclose(found, BODY[1:], atol=1e-6)
    assert recording.joint_names in (None, DEFAULT_JOINTS)
    assert recording.confidence is None or (recording.confidence[1:] == 0.5).all()


def test_people_in_lists_of_points_are_kept_apart(tmp_path: Path) -> None:
    content = [{"landmarks": [frame, listed()[0]]} for frame in SEEN]
    positions = load(tmp_path, content).positions
    np.testing.assert_allclose(positions[:, 0], BODY, atol=1e-6)
    np.testing.assert_allclose(positions[:, 1], np.repeat(BODY[:1], 40, 0), atol=1e-6)


ROW = [1.0] * 51
PERSON = {"keypoints": ROW, "score": 2.0, "category_id": 1}


@pytest.mark.parametrize(
    "content",
    [
        [{"version": 1.3, "people": [{"pose_keypoints_2d": ROW}]}] * 3,
        [{"image_id": "1.jpg", **PERSON}] * 3,
        {f"{at}.jpg": [{"keypoints": ROW, "scores": 2.0}] for at in range(3)},
        {"images": [], "annotations": [{"keypoints": ROW}]},
        [[{"name": "person", "keypoints": {"x": ROW, "y": ROW}}]] * 3,
        {"instance_info": [{"instances": [{"keypoints": [[1, 2]] * 17, "keypoint_scores": ROW}]}]},
        [{"keypoints": {name: [1, 2] for name in DEFAULT_JOINTS}}] * 3,
        [{"keypoints": frame} for frame in FLAT],
    ],
)
def test_what_has_no_depth(tmp_path: Path, content: Any) -> None:
    with pytest.raises(ClipError, match="give actioncli the video"):
        load(tmp_path, content)


def test_metadata(tmp_path: Path) -> None:
    content = {
        "joints": BODY.tolist(), "joint_names": DEFAULT_JOINTS, "fps": 50, "unit": "cm",
        "up": "z", "layout": None, "confidence": np.full((40, 15), 0.5).tolist(),
    }  # fmt: skip
    recording = load(tmp_path, content)
    assert (recording.fps, recording.unit, recording.up) == (50, "cm", "z")
    assert recording.layout is None
    assert recording.confidence is not None
    assert (recording.confidence == 0.5).all()


def test_a_varying_number_of_people(tmp_path: Path) -> None:
    frames: list[Any] = [[body, body] for body in BODY.tolist()]
    frames[3], frames[5], frames[7] = [], None, [frames[7][0]]
    recording = load(tmp_path, {"poses3d": frames})
    assert recording.positions.shape == (40, 2, 15, 3)
    assert np.isnan(recording.positions[3]).all()
    assert np.isnan(recording.positions[5]).all()
    assert np.isnan(recording.positions[7, 1]).all()
    np.testing.assert_allclose(recording.positions[7, 0], BODY[7], atol=1e-6)


def test_null_is_a_missing_number_in_any_encoding(tmp_path: Path) -> None:
    for encoding in ("utf-8-sig", "utf-16"):
        text = "[[[NaN, 1, 2], [null, null, null]], [[1, 1, 2], [3, 3, 3]]]"
        (tmp_path / "a.json").write_text(text, encoding=encoding)
        missing = np.isnan(read(tmp_path / "a.json").positions[:, 0])
        assert missing[0].tolist() == [[True, False, False], [True] * 3]
        assert not missing[1].any()


@pytest.mark.parametrize(
    ("content", "message"),
    [
        ("{", "not JSON: .* line 1"),
        ("hello", "not JSON"),
        ("[" * 100_000, "nested too deeply|not JSON"),
        ("9" * 10_000, "not JSON"),
        ("3", "list of frames"),
        ("[]", "list of frames"),
        ("[[], []]", "joint positions must be"),
        ("[[[1, 2, 3]], [[1, 2]]]", "numbers in lists of equal lengths"),
        ("[[[1, 2, 3]], 5]", "numbers in lists of equal lengths"),
        ('[["a", "b", "c"]]', "numbers in lists of equal lengths"),
        ("[[[1e999, 2, " + "9" * 400 + "]]]", "numbers in lists of equal lengths"),
        ('{"a": 1}', "holds 'a'; a clip needs poses3d or joints"),
        ('[{"a": 1}]', "a frame holds 'a'"),
        ('{"joints": {"a": 1}}', "list of frames"),
        ('[{"landmarks": [{"landmark": 3}, {}, 4]}]', "a frame holds"),
        ('[[[{"x": 1}], 2.0]]', "a frame holds"),
        ('[{"a": [[1, 1], [2, 2], [3, 3], [4, 4]]}]', "a point must be three numbers"),
        ('{"joints": [[1, 2, 3]], "joint_names": {"a": 1}}', "joint_names must be"),
        ('{"joints": [[1, 2, 3]], "joint_names": [["a"]]}', "joint_names must be"),
        ('{"joints": [[1, 2, 3]], "fps": "fast"}', "fps must be"),
        ('{"joints": [[1, 2, 3]], "confidence": "high"}', "confidence must be"),
        ('{"joints": [[1, 2, 3]], "unit": "' + "m" * 300 + '"}', "unit has more"),
        (b'{"caf\xe9": 1}', "UTF-8"),
        ("[" + "[]," * 2_000_001 + "[]]", r"save it as \.npz"),
    ],
)
def test_what_is_no_clip(tmp_path: Path, content: str | bytes, message: str) -> None:
    with pytest.raises(ClipError, match=rf"(?s)a\.json.*({message})"):
        load(tmp_path, content)
