"""JSON: named fields as in `.npz`, or frames one by one, or a bare nested list."""

from __future__ import annotations

import json
from collections.abc import Sequence
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
    with points, or with a list of points for each of several people: a mapping of joint names to
    points, or a list of points that may have names, as it is or under `keypoints3D`, `keypoints`,
    or MediaPipe's `world_landmarks` or `landmarks`. A point is [x, y, z], with or without a
    confidence, or {"x":, "y":, "z":}. Or frames are those of Azure Kinect's offline processor, with
    `bodies`. null is a missing number.

    Raises:
        ClipError: it is not JSON, or holds something else.
    """
    content = _load(file)
    fields: dict[str, Any] = {}
    poses = content
    if isinstance(content, dict):
        poses = in_small_letters(content)
        fields = {name: poses[name] for name in METADATA if poses.get(name) is not None}
        key = _key(poses, (*POSITIONS, "frames", *_POINTS))
        if key is None:
            _refuse_2d(content, file)
            raise ClipError(f"{file}: holds {listed(poses)}; a clip needs poses3d or joints.")
        poses = poses[key]
    if not isinstance(poses, list) or not poses:
        raise ClipError(f"{file}: positions must be a list of frames.")
    frames: list[Any] = poses
    first = next(filter(None, frames), None)
    if all(isinstance(frame, dict) for frame in frames):
        rate = _rate(frames)
        if rate is not None:
            fields.setdefault("fps", rate)
        key = _key(first or {}, (*POSITIONS, "bodies", *_POINTS))
        if key is not None:
            frames = [frame.get(key) for frame in frames]
        if key == "keypoints":
            _refuse_2d(content, file)
        elif key == "bodies":  # Azure Kinect's
            fields = {"unit": "mm", "up": "-y"} | fields
            frames = [
                [body.get("joint_positions") for body in people if isinstance(body, dict)]
                for people in frames
                if isinstance(people, list)
            ]
    positions, named = _from_points(frames, content, file)
    if positions is None:
        positions = _nested(frames, file)
        if positions.ndim > 2 and positions.shape[-1] == 4:
            positions, seen = positions[..., :3], positions[..., 3]
            named = {"confidence": seen}
    arrays = {name: _as_array(name, value, file) for name, value in (named | fields).items()}
    return from_fields({POSITIONS[0]: positions, **arrays}, str(file), landmarks=True)


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


def _refuse_2d(content: Any, file: Path) -> None:
    if _is_2d(content):
        raise ClipError(f"{file}: {NOT_3D}")


def _is_2d(value: Any, depth: int = 6) -> bool:
    """Whether it is of OpenPose, AlphaPose, COCO, YOLO, MMPose or another tool without depth."""
    if not depth or not isinstance(value, list | dict):
        return False
    if isinstance(value, list):
        return any(_is_2d(one, depth - 1) for one in value[:9])
    keys = {_letters(key) for key in value}
    pairs = [one for one in value.values() if isinstance(one, list) and len(one) == 2]
    return (
        "posekeypoints2d" in keys
        or {"images", "annotations"} <= keys
        # [x, y, score] of 17 to 136 joints in one row, and YOLO's lists of each coordinate.
        or ("keypoints" in keys and bool(keys & _BESIDE_2D))
        or ({"x", "y"} <= keys and "z" not in keys)
        or len(pairs) > 4
        or any(_is_2d(one, depth - 1) for one in list(value.values())[:9])
    )


def _rate(frames: list[dict[str, Any]]) -> float | None:
    """Frames a second from the times that frames state."""
    for key, unit in (("timestamp_usec", 1e-6), ("timestamp_ms", 1e-3)):
        times = [frame.get(key) for frame in frames]
        if len(times) > 1 and all(isinstance(time, int | float) for time in times):
            return frame_rate(float(np.median(np.diff(np.array(times, float)))) * unit)
    return None


# What frames of tools call points, best first, in letters alone; and what stands beside `keypoints`
# that have no depth.
_POINTS = (
    "worldlandmarks", "poseworldlandmarks", "keypoints3d",
    "landmarks", "poselandmarks", "keypoints",
)  # fmt: skip
_BESIDE_2D = {"categoryid", "keypointscores", "scores", "numkeypoints"}
_SEEN = ("visibility", "confidence", "score")
Points = dict[str | int, list[Any]]


def _letters(name: str) -> str:
    return name.lower().replace("_", "")


def _key(content: dict[str, Any], wanted: Sequence[str]) -> str | None:
    """The name in a mapping that is the first of those wanted, however it is spelt."""
    spelt = {_letters(name): name for name in reversed(content)}
    return next((spelt[_letters(name)] for name in wanted if _letters(name) in spelt), None)


def _from_points(
    frames: list[Any], content: Any, file: Path
) -> tuple[NDArray[np.float64] | None, dict[str, Any]]:
    """Positions (T, P, J, 3) where frames hold points, and their names and confidence; or None."""
    people = [_people(frame) for frame in frames]
    if not any(one is not None for one in people):
        return None, {}
    bodies = [one or [] for one in people]
    names = list(dict.fromkeys(name for frame in bodies for body in frame for name in body))
    if not names:
        _refuse_2d(content, file)
        held: Any = next(filter(None, frames), {})
        raise ClipError(
            f"{file}: a frame holds {listed(held if isinstance(held, dict) else [])}; it needs "
            "poses3d, joints, or joint names with [x, y, z] each."
        )
    if all(isinstance(name, int) for name in names):
        names = list(range(max(map(int, names)) + 1))
    most = max(map(len, bodies))
    if len(names) * most * len(frames) * 3 > LARGEST_CLIP:
        raise ClipError(f"{file}: holds more than {LARGEST_CLIP} numbers; cut out the action.")
    nobody: Points = {}
    missing = [None] * 4
    values = _numbers([
        [[body.get(name, missing) for name in names] for body in (*frame, *[nobody] * most)[:most]]
        for frame in bodies
    ])  # fmt: skip
    if values is None or values.ndim != 4:
        raise ClipError(f"{file}: a point must be three numbers, x, y and z.")
    positions, seen = values[..., :3], values[..., 3]
    named: dict[str, Any]
    named = {} if np.isnan(seen).all() else {"confidence": np.where(np.isnan(seen), 1, seen)}
    if not all(isinstance(name, int) for name in names):
        named["joint_names"] = [str(name) for name in names]
    return positions, named


def _people(value: Any) -> list[Points] | None:
    """The points of each person in a frame; None where it holds something else."""
    if isinstance(value, dict):
        return [_points(value)]
    first = value[0] if isinstance(value, list) and value else None
    several = isinstance(first, list) and bool(first) and isinstance(first[0], dict)
    if several or (isinstance(first, dict) and "landmark" in first):
        return [_points(one) for one in value]
    return [_points(value)] if isinstance(first, dict) else None


def _points(value: Any) -> Points:
    """Points by name, or by number where they have none: x, y, z and a confidence or None each."""
    found: Points = {}
    if isinstance(value, dict):
        value = value.get("landmark", value)
    numbered = enumerate(value) if isinstance(value, list) else ()
    for name, one in value.items() if isinstance(value, dict) else numbered:
        if (point := _point(one)) is not None:
            words = one if isinstance(one, dict) else {}
            stated = next((words[key] for key in ("name", "joint", "part") if key in words), name)
            found[stated if isinstance(stated, int) else str(stated)] = point
    return found


def _point(value: Any) -> list[Any] | None:
    """[x, y, z, confidence or None] of such a list, or a mapping; None for anything else."""
    if isinstance(value, dict):
        value = {key.lower(): one for key, one in value.items()}
        if "position" in value:
            return _point(value["position"])
        if value.keys() >= set("xyz"):
            seen = next((value[key] for key in _SEEN if key in value), None)
            return [*(value[axis] for axis in "xyz"), seen]
        return None
    return [*value, None][:4] if isinstance(value, list) and len(value) in (3, 4) else None


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
