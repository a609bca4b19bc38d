"""Collections: many labelled clips, for training and evaluation."""

from __future__ import annotations

import math
import os
import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from actioncli.clips.clip import LEAST_FPS, MOST_FPS, Clip
from actioncli.clips.gaps import BoolArray, fill_gaps, missing_joints
from actioncli.clips.read import CLIP_SUFFIXES, find_clips, read_clip
from actioncli.clips.skeleton import default_columns
from actioncli.errors import ClipError

_KEYS = ("joints_mm", "lengths", "labels", "subjects", "joint_names", "fps")
_OPTIONAL = ("visibility", "active", "repetitions")
_METRES = np.float32(0.001)
# In whole numbers, the place of a joint that was not found.
_NOT_FOUND = -32768
# An active part shorter than this is none.
_LEAST_FRAMES = 8
# NTU RGB+D names performers in the file name (S001C002P003R002A013), others by s03, subject_3.
_SUBJECT = re.compile(
    r"(?<=C\d{3})P\d{3}(?=R\d{3})"
    r"|(?i:(?<![a-z\d])(?:s|p|subj|subject|person)_?\d+(?![a-z\d]))"
)


@dataclass(frozen=True, slots=True)
class Collection:
    """Labelled clips.

    Attributes:
        clips: N clips.
        labels: N action classes.
        subjects: N performers; "" where the source has no names for them.
        name: of the collection.
        notes: what reading decided (clips skipped), for people.
    """

    clips: tuple[Clip, ...]
    labels: tuple[str, ...]
    subjects: tuple[str, ...]
    name: str
    notes: tuple[str, ...] = ()

    def __repr__(self) -> str:
        classes, people = len(set(self.labels)), len(set(self.subjects))
        counts = f"{len(self.clips)} clips, {classes} classes, {people} people"
        return f"Collection({self.name!r}, {counts})"

    def __post_init__(self) -> None:
        """Check the lengths.

        Raises:
            ClipError: they differ.
        """
        if not len(self.clips) == len(self.labels) == len(self.subjects):
            raise ClipError(
                f"{self.name}: {len(self.clips)} clips, {len(self.labels)} labels and "
                f"{len(self.subjects)} subjects; the three belong together."
            )

    def __len__(self) -> int:
        return len(self.clips)


def read_collection(
    path: str | os.PathLike[str],
    read: Callable[[Path], Clip] = read_clip,
    suffixes: Sequence[str] = CLIP_SUFFIXES,
) -> Collection:
    """Read a collection.

    Args:
        path: an `.npz` with `joints_mm` (sum of lengths, J, 3) in millimetres and the axes of
            `Clip`, `lengths` (N,), `labels` (N,), `subjects` (N,), `joint_names` (J,) and
            `fps`; joints at -32768 were not found. Optional are `visibility` (sum of lengths, J)
            in percent, and for recordings that hold more than the action `active` (N, 2), the
            seconds in which it is done once, and `repetitions` (N,), how often it is done: the
            one before and the one after then are clips too. Or a folder with a folder of clips
            for each label.
        read: reads a clip of a folder.
        suffixes: of the files that are clips.

    Raises:
        ClipError: it cannot be read, is damaged, or holds no clip.
    """
    place = Path(path)
    return _from_folder(place, read, suffixes) if place.is_dir() else _from_archive(place)


def _from_folder(folder: Path, read: Callable[[Path], Clip], suffixes: Sequence[str]) -> Collection:
    labels, clips, subjects = [], [], []
    try:
        actions = sorted(entry for entry in folder.iterdir() if entry.is_dir())
    except OSError as error:
        raise ClipError(f"{folder}: cannot be read: {error.strerror or error}.") from error
    for action in actions:
        for file in find_clips([action], suffixes):
            if file == action:
                continue
            clips.append(read(file))
            labels.append(action.name)
            subject = _SUBJECT.search(file.stem)
            subjects.append(subject[0] if subject else "")
    if not clips:
        raise ClipError(
            f"{folder}: holds no clips; a collection is a folder with a folder for each label "
            "(wave/anna.npy), or an .npz file."
        )
    return Collection(tuple(clips), tuple(labels), tuple(subjects), folder.resolve().name)


def _from_archive(file: Path) -> Collection:
    from actioncli.clips.formats.files import check_file
    from actioncli.clips.formats.npz import read_arrays

    check_file(file)
    try:
        arrays = read_arrays(file, (*_KEYS, *_OPTIONAL), f"a collection needs {', '.join(_KEYS)}")
    except (OSError, MemoryError) as error:
        raise ClipError(f"{file}: cannot be read: {error}.") from error
    joints, names, fps, lengths = _checked(arrays, file)
    ends = np.cumsum(lengths)
    needed = sorted({at for columns in default_columns(names).values() for at in columns})
    gaps: BoolArray = np.logical_or.reduce(missing_joints(joints[:, needed]), axis=1)
    kept: list[tuple[int, Clip]] = []
    found = [(at, frames) for at in range(len(ends)) for frames in _actions(arrays, at, ends, fps)]
    for at, frames in found:
        positions = joints[frames].astype(np.float32) * _METRES
        confidence = None
        if "visibility" in arrays:
            confidence = np.asarray(arrays["visibility"][frames] / 100, np.float32)
            lost = np.any(joints[frames] == _NOT_FOUND, axis=2)
            positions[lost], confidence[lost] = np.nan, 0
        where = f"{file} (clip {at + 1})"
        try:
            if gaps[frames].any():
                positions, _, confidence, _ = fill_gaps(positions, names, fps, where, confidence)
            if positions.shape[1] != len(names):
                raise ClipError(f"{where}: joints are mostly missing.")
            kept.append((at, Clip(positions, names, fps, confidence, source=where)))
        except ClipError:
            # Still, empty or mostly gap: of no use for training, and no fault of the file.
            continue
    if not kept:
        raise ClipError(f"{file}: none of its {len(lengths)} clips moves.")
    rows, clips = zip(*kept, strict=True)
    labels, subjects = (tuple(arrays[key][[*rows]].tolist()) for key in ("labels", "subjects"))
    unusable = len(found) - len(kept)
    notes = (f"{unusable} of {len(found)} clips skipped (still or mostly gap)",)
    return Collection(clips, labels, subjects, file.stem, notes if unusable else ())


def _actions(
    arrays: Mapping[str, NDArray[Any]], at: int, ends: NDArray[np.int64], fps: float
) -> list[slice]:
    """The frames in which recording `at` shows its action: all, or what `active` says."""
    begin, end = int(ends[at] - arrays["lengths"][at]), int(ends[at])
    if "active" not in arrays:
        return [slice(begin, end)]
    first, last = (arrays["active"][at] * fps).tolist()
    first, last = begin + int(first), min(begin + math.ceil(last) + 1, end)
    long = last - first
    if long < _LEAST_FRAMES:
        return [slice(begin, end)]
    spans = [(first, last)]
    if "repetitions" in arrays and arrays["repetitions"][at] > 1:
        spans += [(first - long, first), (last, last + long)]
    return [slice(*span) for span in spans if begin <= span[0] and span[1] <= end]


def _checked(
    arrays: Mapping[str, NDArray[Any]], file: Path
) -> tuple[NDArray[Any], tuple[str, ...], float, NDArray[np.int64]]:
    """Joints, joint names, frame rate and lengths, if all parts of a collection fit together."""
    lacking = [key for key in _KEYS if key not in arrays]
    if lacking:
        raise ClipError(f"{file}: is not a collection: it lacks {', '.join(lacking)}.")
    joints, lengths, names = arrays["joints_mm"], arrays["lengths"], arrays["joint_names"]
    if joints.ndim != 3 or joints.shape[2] != 3 or joints.dtype.kind not in "iuf":
        raise ClipError(
            f"{file}: joints_mm must be numbers (frames, joints, 3), not {joints.shape}."
        )
    if lengths.ndim != 1 or lengths.dtype.kind not in "iu" or (lengths.astype(np.int64) < 0).any():
        raise ClipError(f"{file}: lengths must be a list of counts.")
    frames = sum(lengths.tolist())
    if frames != len(joints):
        raise ClipError(
            f"{file}: is damaged: its lengths add up to {frames} frames, joints_mm has "
            f"{len(joints)}."
        )
    for key in ("labels", "subjects"):
        if arrays[key].shape != lengths.shape or arrays[key].dtype.kind != "U":
            raise ClipError(
                f"{file}: {key} must be {len(lengths)} words, one for each of the lengths."
            )
    if names.shape != joints.shape[1:2] or names.dtype.kind != "U":
        raise ClipError(f"{file}: joint_names must be {joints.shape[1]} words.")
    if len(set(names.tolist())) != len(names):
        raise ClipError(f"{file}: joint_names holds a name twice.")
    visibility = arrays.get("visibility")
    if visibility is not None and not (
        visibility.shape == joints.shape[:2]
        and visibility.dtype.kind in "iuf"
        and np.all((visibility >= 0) & (visibility <= 100))
    ):
        raise ClipError(
            f"{file}: visibility must be percent (frames, joints) = {joints.shape[:2]}."
        )
    active, repetitions = arrays.get("active"), arrays.get("repetitions")
    if active is not None and not (
        active.shape == (len(lengths), 2) and active.dtype.kind in "iuf" and np.all(active >= 0)
    ):
        raise ClipError(f"{file}: active must be seconds, start and end of each recording.")
    if repetitions is not None and not (
        repetitions.shape == lengths.shape and repetitions.dtype.kind in "iu"
    ):
        raise ClipError(f"{file}: repetitions must be a count for each recording.")
    rate = arrays["fps"]
    fps = float(rate.reshape(-1)[0]) if rate.size == 1 and rate.dtype.kind in "iuf" else 0.0
    if not LEAST_FPS <= fps <= MOST_FPS:
        raise ClipError(f"{file}: fps must be one number from {LEAST_FPS:g} to {MOST_FPS:,.0f}.")
    return joints, tuple(names.tolist()), fps, lengths.astype(np.int64)
