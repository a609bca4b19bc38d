"""JSON: named fields as in `.npz`, or frames one by one, or a bare nested list."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from actioncli.clips.formats.fields import (
    METADATA,
    NOT_3D,
    POSITIONS,
    from_fields,
    in_small_letters,
    listed,
)
from actioncli.clips.formats.files import MEGABYTE, check_size, frame_rate
from actioncli.clips.recording import LARGEST_CLIP, Recording
from actioncli.errors import ClipError

# Python needs up to 100 bytes for a value and 200 for a bracket; what passes stays far below a
# gigabyte. 4 million values are 12 minutes of 30 joints at 60 fps.
_LARGEST = 64 * MEGABYTE
_MOST_COMMAS = 4_000_000
_MOST_BRACKETS = 2_000_000
_LONGEST_NAME = 200


def read(file: Path) -> Recording:
    """A clip from JSON.

    Positions stand under `poses3d` or `joints`, or are the whole file, as nested lists in one
    of the shapes of `fields.to_people`; with a varying number of people per frame too. They
    may also be a list of frames (or stand under `frames`), each with `poses3d` or `joints`, or
    each a mapping of joint names to [x, y, z] or {"x":, "y":, "z":}, as it is or under
    `keypoints`; or hold MediaPipe's `world_landmarks` or `landmarks`; or be those of Azure
    Kinect's offline processor, with `bodies`. null is a missing number.

    Raises:
        ClipError: it is not JSON, or holds something else.
    """
    content = _load(file)
    fields: dict[str, Any] = {}
    poses = content
    one = content[0] if isinstance(content, list) and content else content
    if isinstance(one, dict) and (_mark_of_2d(one) or _of_coco(one)):
        raise ClipError(f"{file}: {NOT_3D}")
    if isinstance(content, dict):
        content = in_small_letters(content)
        key = next((key for key in (*POSITIONS, "frames") if key in content), None)
        if key is None:
            raise ClipError(f"{file}: holds {listed(content)}; a clip needs poses3d or joints.")
        fields = {name: content[name] for name in METADATA if content.get(name) is not None}
        poses = content[key]
    if not isinstance(poses, list) or not poses:
        raise ClipError(f"{file}: positions must be a list of frames.")
    frames: list[Any] = poses
    if all(isinstance(frame, dict) for frame in frames):
        if any(map(_mark_of_2d, frames)):
            raise ClipError(f"{file}: {NOT_3D}")
        rate = _rate(frames)
        if rate is not None:
            fields.setdefault("fps", rate)
        tool = next((tool for key, tool in _TOOLS.items() if key in frames[0]), None)
        if tool is not None:
            frames, stated = tool(frames)
            fields = stated | fields
        else:
            frames, names = _from_mappings(frames, file)
            if names is not None:
                fields.setdefault("joint_names", names)
    positions = _nested(frames, file)
    arrays = {name: _as_array(name, value, file) for name, value in fields.items()}
    return from_fields({POSITIONS[0]: positions, **arrays}, str(file))


def _load(file: Path) -> Any:
    check_size(file, _LARGEST)
    data = file.read_bytes()
    if data.startswith((b"\xff\xfe", b"\xfe\xff")):
        data = data.decode("utf-16", "replace").encode()
    if data.count(b",") > _MOST_COMMAS or data.count(b"[") + data.count(b"{") > _MOST_BRACKETS:
        raise ClipError(
            f"{file}: holds more than {_MOST_COMMAS} values or {_MOST_BRACKETS} lists, more "
            "than a clip may have as JSON; save it as .npz."
        )
    try:
        return json.loads(data.decode("utf-8-sig"))
    except UnicodeDecodeError as error:
        raise ClipError(f"{file}: is not text in UTF-8 (byte {error.start}).") from error
    except json.JSONDecodeError as error:
        raise ClipError(
            f"{file}: is not JSON: {error.msg} in line {error.lineno}, column {error.colno}."
        ) from error
    except RecursionError as error:
        raise ClipError(f"{file}: its lists are nested too deeply.") from error
    except ValueError as error:
        raise ClipError(f"{file}: is not JSON: {error}.") from error


def _mark_of_2d(frame: dict[str, Any]) -> bool:
    """Whether a frame is one of OpenPose, AlphaPose or another tool that gives no depth."""
    points = frame.get("keypoints")
    people = frame.get("people")
    return (
        "pose_keypoints_2d" in frame
        or (
            isinstance(people, list) and any(isinstance(p, dict) and _mark_of_2d(p) for p in people)
        )
        # [x, y, score] of 17 to 136 joints in one row, and YOLO's lists of each coordinate.
        or (isinstance(points, list) and "category_id" in frame)
        or (isinstance(points, dict) and {"x", "y"} <= points.keys() and "z" not in points)
    )


def _of_coco(content: dict[str, Any]) -> bool:
    notes = content.get("annotations")
    return isinstance(notes, list) and bool(notes) and "images" in content


def _rate(frames: list[dict[str, Any]]) -> float | None:
    """Frames a second from the times that frames state."""
    for key, unit in (("timestamp_usec", 1e-6), ("timestamp_ms", 1e-3)):
        times = [frame.get(key) for frame in frames]
        if len(times) > 1 and all(isinstance(time, int | float) for time in times):
            return frame_rate(float(np.median(np.diff(np.array(times, float)))) * unit)
    return None


def _from_landmarks(frames: list[dict[str, Any]]) -> tuple[list[Any], dict[str, Any]]:
    """MediaPipe's lists of 33 points with a visibility each; those of the world come first."""
    key = next(key for key in _LANDMARKS if key in frames[0])
    lists = [frame.get(key) for frame in frames]
    # The tasks API lists people.
    lists = [one[0] if one and isinstance(one[0], list) else one for one in lists]
    count = max(len(one) for one in lists if one)
    bodies = [one if one and len(one) == count else [{}] * count for one in lists]
    seen = [[_given(point, "visibility", 1.0) for point in one] for one in bodies]
    places = [[[_given(point, axis, None) for axis in "xyz"] for point in one] for one in bodies]
    return places, {"confidence": seen}


def _given(point: Any, key: str, otherwise: float | None) -> Any:
    return point.get(key, otherwise) if isinstance(point, dict) else otherwise


def _from_bodies(frames: list[dict[str, Any]]) -> tuple[list[Any], dict[str, Any]]:
    """Frames of Azure Kinect's offline processor: millimetres, y down."""
    people = [[body.get("joint_positions") for body in frame["bodies"]] for frame in frames]
    return people, {"unit": "mm", "up": "-y"}


_LANDMARKS = ("world_landmarks", "pose_world_landmarks", "landmarks", "pose_landmarks")
# What a frame of a tool holds, best first, to what reads it.
_TOOLS: dict[str, Callable[[list[dict[str, Any]]], tuple[list[Any], dict[str, Any]]]] = {
    **dict.fromkeys(_LANDMARKS, _from_landmarks),
    "bodies": _from_bodies,
}


def _from_mappings(frames: list[dict[str, Any]], file: Path) -> tuple[list[Any], list[str] | None]:
    """Frames given as mappings to nested lists, and the joint names where they are the keys."""
    first = frames[0]
    key = next((key for key in (*POSITIONS, "keypoints") if key in first), None)
    if key is not None:
        inner = [frame.get(key) for frame in frames]
        if not all(isinstance(frame, dict) for frame in inner):
            return inner, None
        frames = [frame for frame in inner if isinstance(frame, dict)]
        first = frames[0]
    names = [name for name, value in first.items() if _point(value) is not None]
    if not names:
        raise ClipError(
            f"{file}: a frame holds {listed(first)}; it needs poses3d, joints, or joint names "
            "with [x, y, z] each."
        )
    if len(names) * len(frames) * 3 > LARGEST_CLIP:
        raise ClipError(f"{file}: holds more than {LARGEST_CLIP} numbers; cut out the action.")
    missing = [None] * 3
    return [[_point(frame.get(name)) or missing for name in names] for frame in frames], names


def _point(value: Any) -> list[Any] | None:
    """The coordinates in [x, y, z] or {"x":, "y":, "z":}, or None for anything else."""
    if isinstance(value, dict) and value.keys() >= set("xyz"):
        return [value[axis] for axis in "xyz"]
    return value if isinstance(value, list) and len(value) == 3 else None


def _nested(frames: list[Any], file: Path) -> NDArray[np.float64]:
    """Nested lists to an array; frames with different numbers of people are padded by NaN."""
    regular = _numbers(frames)
    if regular is not None:
        return regular
    # No people in a frame is an empty list; the others are (P, J, 3), or (J, 3) for one alone.
    people = [_numbers([] if frame is None else frame) for frame in frames]
    people = [body[None] if body is not None and body.ndim == 2 else body for body in people]
    bodies = [body for body in people if body is not None and body.size]
    shapes = {body.shape[1:] for body in bodies if body.ndim == 3}
    if any(body is None or (body.size and body.ndim != 3) for body in people) or len(shapes) != 1:
        raise ClipError(
            f"{file}: positions must be numbers in lists of equal lengths: (frames, joints, 3) "
            "or (frames, people, joints, 3)."
        )
    _, joints, width = bodies[0].shape
    most = max(len(body) for body in bodies)
    if len(frames) * most * joints * width > LARGEST_CLIP:
        raise ClipError(
            f"{file}: {len(frames)} frames of up to {most} people and {joints} joints are more "
            f"than the {LARGEST_CLIP} numbers that a clip may have; cut out the action."
        )
    padded = np.full((len(frames), most, joints, width), np.nan)
    for frame, body in enumerate(people):
        if body is not None and body.size:
            padded[frame, : len(body)] = body
    return padded


def _numbers(values: Any) -> NDArray[np.float64] | None:
    try:
        return np.array(values, dtype=np.float64)
    except (TypeError, ValueError, OverflowError):
        return None


def _as_array(name: str, value: Any, file: Path) -> NDArray[Any]:
    if name == "confidence":
        array = _numbers(value)
        if array is None:
            raise ClipError(f"{file}: confidence must be numbers in lists of equal lengths.")
        return array
    words = value if isinstance(value, list) else [value]
    if not all(isinstance(word, str | int | float) for word in words):
        raise ClipError(f"{file}: {name} must be a word, a number or a list of names.")
    if any(len(str(word)) > _LONGEST_NAME for word in words):
        raise ClipError(f"{file}: {name} has more than {_LONGEST_NAME} characters.")
    if name == "joint_names":
        return np.array([str(word) for word in words])
    return np.array(value if not isinstance(value, bool) else str(value))
