"""Arrays of positions, and named fields as `.npz` and `.json` hold them, to a recording."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from actioncli.clips.clip import FloatArray
from actioncli.clips.formats.files import check_range
from actioncli.clips.recording import LARGEST_CLIP, MOST_JOINTS, Recording
from actioncli.errors import ClipError

# Where positions are looked for, best first; MeTRAbs calls them poses3d, a nameless array of
# numpy.savez is arr_0.
POSITIONS = (
    "poses3d", "joints", "joints3d", "joints_3d", "smpl_joints3d", "pred_joints3d",
    "pred_keypoints_3d", "keypoints3d", "keypoints_3d", "arr_0",
)  # fmt: skip
NOT_3D = (
    "holds positions in a picture (2D), and recognition needs them in space (3D): give actioncli "
    "the video itself."
)
METADATA = ("joint_names", "fps", "layout", "unit", "up", "confidence")
# Values a frame of MediaPipe's pose landmarks (x, y, z, visibility each), alone or before those
# of the left and the right hand (x, y, z), or of face and hands.
_POSE, _HANDS, _FACE = 33 * 4, 2 * 21 * 3, 468 * 3
_HIPS = slice(23, 25)
# With true depth, examples squeezed as 4:3, 16:9 and 9:16 pictures are all decided as in space.
_IN_PICTURE = (
    "MediaPipe's landmarks in the picture: their depth is rough and the picture's proportions are "
    "not known; its world landmarks, or the video, are better"
)
_LANDMARKS = (_POSE, _POSE + _HANDS, _POSE + _FACE + _HANDS)
# Confidence beyond 1 that is rounding, and steps such as those of Kinects.
_ROUNDED, _MOST_STEPS = 1.05, 3
T = TypeVar("T")


def from_fields(
    fields: Mapping[str, NDArray[Any]], where: str, named: bool = True, landmarks: bool = False
) -> Recording:
    """A recording from positions and what may stand beside them.

    Args:
        fields: `poses3d` or `joints`; optional `joint_names` (J,), `fps`, `layout`, `unit`,
            `up`, `confidence` (T, J) or (T, P, J).
        where: the file, for messages.
        named: whether the fields have names in the file.
        landmarks: whether they may be MediaPipe's, in the picture.

    Raises:
        ClipError: positions are absent, or a field has the wrong type or shape.
    """
    key = next((key for key in POSITIONS if key in fields), None)
    if key is None:
        raise ClipError(f"{where}: holds {listed(fields)}; a clip needs poses3d or joints.")
    values = np.asarray(fields[key])
    if values.ndim == 2 and values.shape[1] in _LANDMARKS and values.dtype.kind in "iuf":
        joints, seen = _landmarks(values)
        return from_fields({"confidence": seen, **fields, key: joints}, where, named, True)
    positions = to_people(values, f"{where} ({key})" if named else where)
    confidence, notes = _confidence(fields, positions, where)
    if landmarks and positions.shape[2] in (33, 75):
        positions, told = _from_picture(positions)
        notes += told

    def one(key: str, kinds: str, what: str, convert: Callable[[Any], T]) -> T | None:
        if key not in fields:
            return None
        value = np.asarray(fields[key])
        if value.size != 1 or value.dtype.kind not in kinds:
            raise ClipError(f"{where}: {key} must be one {what}.")
        return convert(value.item())

    return Recording(
        positions,
        joint_names=_names(fields, where),
        layout=one("layout", "USiuf", "word", _decoded),
        fps=one("fps", "iuf", "number", float),
        unit=one("unit", "USiuf", "word", _decoded),
        up=one("up", "USiuf", "word", _decoded),
        confidence=confidence,
        notes=notes,
    )


def _landmarks(values: NDArray[Any]) -> tuple[NDArray[Any], NDArray[Any]]:
    """MediaPipe's values (T, V) to places (T, J, 3) and visibilities (T, J): J is 33, or 75 with
    hands, of which those that are zero throughout a frame were not found in it."""
    frames = len(values)
    pose = values[:, :_POSE].reshape(frames, 33, 4)
    if values.shape[1] == _POSE:
        return pose[..., :3], pose[..., 3]
    both = values[:, -_HANDS:].reshape(frames, 2, 21, 3)
    found = np.broadcast_to(both.any(axis=(2, 3), keepdims=True), both.shape)
    hands = np.where(found, both, np.nan).reshape(frames, 42, 3)
    seen = found[..., 0].reshape(frames, 42)
    return np.concatenate([pose[..., :3], hands], 1), np.concatenate([pose[..., 3], seen], 1)


def _from_picture(positions: FloatArray) -> tuple[FloatArray, tuple[str, ...]]:
    """MediaPipe's landmarks (T, P, J, 3) in a picture, with its corners at 0 and 1, from where the
    hips are; those in space are so already."""
    hips = positions[:, :, _HIPS].mean(axis=2)
    hips = hips[np.isfinite(hips).all(axis=2) & hips.any(axis=2)]
    if not len(hips):
        return positions, ()
    across, down, depth = middle = np.median(hips, axis=0)
    if max(across, down) < 0.1 or not (0 <= across <= 1 and 0 <= down <= 1.5) or abs(depth) > 0.2:
        return positions, ()
    # Who was not found stays zero.
    moved = np.where(positions.any(axis=3, keepdims=True), positions - middle, 0)
    return np.asarray(moved, np.float32), (_IN_PICTURE,)


def in_small_letters(fields: Mapping[str, T]) -> dict[str, T]:
    """Fields by the names that are looked for, however they are spelt."""
    known = {*POSITIONS, *METADATA, "frames"}
    spelt = {name: name.lower() for name in fields if name.lower() in known - fields.keys()}
    return {spelt.get(name, name): value for name, value in fields.items()}


def listed(names: Iterable[str]) -> str:
    """Names of fields in a file for a message, of bearable length."""
    return ", ".join(repr(name[:40]) for name in list(names)[:20]) or "nothing"


def to_people(values: NDArray[Any], where: str) -> FloatArray:
    """(T, J, 3), (T, J x 3), (T, P, J, 3), or one of them in a batch of one, to (T, P, J, 3).

    Raises:
        ClipError: it has another shape, or does not hold numbers.
    """
    if values.dtype.kind not in "iuf":
        raise ClipError(f"{where}: joint positions must be numbers, not {values.dtype}.")
    given = values.shape
    if values.ndim > 3 and given[0] == 1:
        values = values[0]
    if values.ndim == 2 and values.shape[1] and values.shape[1] % 3 == 0:
        values = values.reshape(len(values), -1, 3)
    if values.ndim == 3:
        values = values[:, None]
    if values.ndim != 4 or values.shape[3] != 3 or 0 in values.shape:
        raise ClipError(
            f"{where}: joint positions must be (frames, joints, 3), (frames, joints x 3) or "
            f"(frames, people, joints, 3), not {given}.{_hint(given)}"
        )
    if values.size > LARGEST_CLIP:
        raise ClipError(
            f"{where}: holds {values.size} numbers in an array of shape {given}, more than the "
            f"{LARGEST_CLIP} that a clip may have; cut out the action."
        )
    with np.errstate(over="ignore", invalid="ignore"):
        positions = np.ascontiguousarray(values, dtype=np.float32)
    check_range(positions, where)
    return positions


def _hint(shape: tuple[int, ...]) -> str:
    """What an array of a shape that is not read may be, and the way on."""
    if len(shape) in (4, 5) and shape[-4] == 3 and shape[-1] <= 2:
        first = "a[0]" if len(shape) == 5 else "a"
        order, one = "coordinates, frames, joints, people", f"{first}.transpose(1, 3, 2, 0)"
    elif len(shape) == 3 and shape[-1] == 150:
        order, one = "frames, people x joints x coordinates", "a[0].reshape(-1, 2, 25, 3)"
    elif 2 in shape[-1:]:
        return " Positions in the image (2D) are not enough."
    elif 4 in shape[-1:]:
        return " Save x, y and z alone, a fourth number as `confidence` (.npz, .json)."
    else:
        return ""
    clips = "" if len(shape) == 4 else "clips, "
    return (
        f" This is the order of NTU RGB+D arrays ({clips}{order}); one clip is: "
        f"numpy.save('clip.npy', {one})"
    )


def _names(fields: Mapping[str, NDArray[Any]], where: str) -> tuple[str, ...] | None:
    if "joint_names" not in fields:
        return None
    names = np.asarray(fields["joint_names"])
    if names.dtype.kind not in "US" or names.ndim != 1 or len(names) > MOST_JOINTS:
        raise ClipError(f"{where}: joint_names must be a list of at most {MOST_JOINTS} names.")
    return tuple(map(_decoded, names.tolist()))


def _confidence(
    fields: Mapping[str, NDArray[Any]], positions: FloatArray, where: str
) -> tuple[FloatArray | None, tuple[str, ...]]:
    if "confidence" not in fields:
        return None, ()
    value = np.asarray(fields["confidence"])
    if value.dtype.kind not in "iufb" or value.size != positions.size // 3:
        raise ClipError(
            f"{where}: confidence must be (frames, joints) or (frames, people, joints) like the "
            f"positions, not {value.shape}."
        )
    with np.errstate(over="ignore", invalid="ignore"):
        return as_confidence(value.reshape(positions.shape[:3]).astype(np.float32), positions)


def as_confidence(values: FloatArray, positions: FloatArray) -> tuple[FloatArray, tuple[str, ...]]:
    """What tools state beside positions as confidence in [0, 1], with notes on what it was not.

    Args:
        values: as stated, (T, P, J): percent, or steps from 0 to 2 or 3, in other tools.
        positions: (T, P, J, 3); where there is none, nothing need be stated.
    """
    there = np.isfinite(positions).all(axis=-1)
    none, negative = there & np.isnan(values), there & (values < 0)
    notes = [
        f"confidence is {what} for {share:.1%} of the joint positions, which counts as not seen"
        for what, share in (("NaN", none.mean()), ("negative", negative.mean()))
        if share
    ]
    values = np.nan_to_num(values, nan=0.0)
    most = float(values.max(initial=0))
    if most > _ROUNDED:
        steps = most <= _MOST_STEPS and bool((values == np.round(values)).all())
        full = most if steps else 100.0 if _MOST_STEPS < most <= 100 else 1.0
        taken = f"taken for parts of {full:g}" if full > 1 else "of which more than 1 counts as 1"
        notes.append(f"confidence reaches {most:.3g} instead of 1: {taken}")
        values = values / np.float32(full)
    return np.clip(values, 0, 1), tuple(notes)


def _decoded(value: Any) -> str:
    return value.decode("utf-8", "replace") if isinstance(value, bytes) else str(value)
