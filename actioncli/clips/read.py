"""Read a clip from a file of any supported format.

A format's reader says what the file holds; here is decided, once for all formats, what it means:
which person, which joints, which unit, which way is up. Nothing is guessed: what is inferred is
unambiguous and stands in the clip's notes, the rest is an error that names the settling option.
"""

from __future__ import annotations

import importlib
import os
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from actioncli.clips import axes
from actioncli.clips.checks import not_places
from actioncli.clips.clip import LEAST_FPS, MOST_FPS, Clip, FloatArray
from actioncli.clips.gaps import fill_gaps, filled
from actioncli.clips.persons import most_active
from actioncli.clips.recording import (
    LARGEST_CLIP,
    LONGEST_CLIP,
    MOST_JOINTS,
    MOST_PEOPLE,
    Recording,
)
from actioncli.clips.skeleton import LAYOUTS, default_columns
from actioncli.errors import AmbiguousClipError, ClipError, UsageError

# Suffix to the module of `actioncli.clips.formats` that reads it.
_FORMATS = {
    ".npy": "npy", ".npz": "npz", ".json": "json_file", ".csv": "csv_file", ".skeleton": "ntu",
    ".trc": "trc", ".bvh": "bvh", ".c3d": "c3d",
}  # fmt: skip
CLIP_SUFFIXES = tuple(_FORMATS)
# Formats that are not read, and what makes a file of them that is.
CONVERTERS = {
    ".fbx": "save it as .bvh with Blender (File, Export, Motion Capture) or Autodesk FBX Converter",
    ".mot": "it holds angles; OpenSim's Point Kinematics or Analyze tool gives positions: save "
    "them, or the markers, as .trc",
    ".pkl": "pickles may run any program and are never loaded; save the array joints3d by "
    "numpy.savez",
}
CONVERTERS[".sto"] = CONVERTERS[".mot"]
# How the content begins where that settles the format.
_BEGINNINGS = {
    b"\x93NUMPY": "npy",
    b"PK\x03\x04": "npz",
    b"HIERARCHY": "bvh",
    b"PathFileType": "trc",
}
_USUAL_FPS = 30.0


def read_clip(
    path: str | os.PathLike[str],
    layout: str | None = None,
    fps: float | None = None,
    unit: str | float | None = None,
    up: str | None = None,
) -> Clip:
    """Read one person's clip.

    Args:
        path: a file with one of `CLIP_SUFFIXES`.
        layout: one of `skeleton.LAYOUTS`; names the joints in column order.
        fps: frames per second.
        unit: of length: m, cm, mm, in, or metres per unit.
        up: the axis that points up: y, -y (camera axes), z, -z, x or -x.
            Options win over what the file states.

    Raises:
        ClipError: the file cannot be read or does not hold a clip.
        AmbiguousClipError: an option must say what the file does not.
        UsageError: an option has an impossible value.
    """
    _check_options(layout, fps, unit, up)
    file = Path(path)
    recording = _read(file)
    stated = replace(
        recording,
        layout=layout or recording.layout,
        joint_names=None if layout else recording.joint_names,
        fps=recording.fps if fps is None else float(fps),
        unit=recording.unit if unit is None else str(unit),
        up=up or recording.up,
    )
    # A signalling NaN is a gap like any other.
    with np.errstate(invalid="ignore"):
        try:
            return _decide(stated, str(path), unit_is_certain=unit is not None)
        except AmbiguousClipError as error:
            # An option would not help where these are no places at all.
            names, _ = _joint_names(stated, str(path))
            _check_places(stated.positions[:, 0], names, str(path), error)
            raise


def _check_places(
    positions: FloatArray, names: tuple[str, ...], where: str, error: Exception | None = None
) -> None:
    for finding in not_places(positions, names):
        if finding.forbids_enrolment:
            raise ClipError(f"{where}: {finding.text}.") from error


def find_clips(
    paths: Iterable[str | os.PathLike[str]], suffixes: Sequence[str] = CLIP_SUFFIXES
) -> list[Path]:
    """Files, folders (all clips below them, by name) and globs as a list of files.

    What is named outright, or matches nothing, stays in the list: reading it gives the error.
    """
    found: dict[Path, None] = {}
    for path in paths:
        found.update(dict.fromkeys(sorted(walk_clips(path, suffixes)) or [Path(path)]))
    return list(found)


def walk_clips(path: str | os.PathLike[str], suffixes: Sequence[str]) -> Iterator[Path]:
    """A file, the clips below a folder, or what matches a pattern, in any order, one by one."""
    here = Path(path)
    try:
        is_folder, exists = here.is_dir(), here.exists()
    except OSError:  # too long for a file's name: reading it gives that error
        is_folder, exists = False, True
    if is_folder:
        yield from _clips_below(here, suffixes)
    elif not exists and any(mark in str(here) for mark in "*?["):
        yield from _matching(here, suffixes)
    else:
        yield here


def _matching(pattern: Path, suffixes: Sequence[str]) -> Iterable[Path]:
    # Folders that are there are meant by name, whatever their brackets would match.
    there = next(folder for folder in pattern.parents if folder.is_dir())
    try:
        for match in there.glob(str(pattern.relative_to(there))):
            # As in a shell, `*` does not stand for a dot at the beginning.
            if match.name.startswith(".") and not pattern.name.startswith("."):
                continue
            yield from _clips_below(match, suffixes) if match.is_dir() else [match]
    # Not a pattern after all (`a**b`): a file of that name, which does not exist.
    except ValueError:
        return


def _clips_below(folder: Path, suffixes: Sequence[str]) -> Iterable[Path]:
    from actioncli.clips.formats.npy import is_sequence

    for root, folders, files in os.walk(folder):
        folders[:] = [name for name in folders if not name.startswith(".")]
        numbered = any(name.endswith(".npy") and name[0].isdigit() for name in files)
        if numbered and ".npy" in suffixes and is_sequence(Path(root)):
            yield Path(root)
            files = [name for name in files if not name.endswith(".npy")]
        for name in files:
            if not name.startswith(".") and Path(name).suffix.lower() in suffixes:
                yield Path(root, name)


def _check_options(
    layout: str | None, fps: float | None, unit: str | float | None, up: str | None
) -> None:
    if layout is not None and layout not in LAYOUTS:
        raise UsageError(f"unknown layout {layout!r}; --layout is one of {', '.join(LAYOUTS)}.")
    if fps is not None and not LEAST_FPS <= fps <= MOST_FPS:
        raise UsageError(f"--fps must be {LEAST_FPS:g} to {MOST_FPS:,.0f}, not {fps!r}.")
    if unit is not None and axes.parse_unit(unit) is None:
        raise UsageError(
            f"unknown unit {unit!r}; --unit is one of {', '.join(axes.UNITS)}, or metres per "
            "unit as a number."
        )
    if up is not None and axes.parse_up(up) is None:
        raise UsageError(f"unknown axis {up!r}; --up is one of {', '.join(axes.UPS)}.")


def _read(file: Path) -> Recording:
    """Choose the reader by suffix, or by content where that is certain, and run it."""
    from actioncli.clips.formats.files import check_file

    suffix = file.suffix.lower()
    if suffix not in _FORMATS:
        from actioncli.clips.formats.npy import is_sequence, read_sequence

        if is_sequence(file):
            return read_sequence(file)
    beginning = check_file(file, CLIP_SUFFIXES)
    if suffix in CONVERTERS:
        raise ClipError(f"{file}: {suffix} is not read; {CONVERTERS[suffix]}.")
    if suffix not in _FORMATS:
        raise ClipError(
            f"{file}: {suffix or 'no suffix'} is not a clip format; supported: "
            f"{', '.join(CLIP_SUFFIXES)}."
        )
    certain = (kind for mark, kind in _BEGINNINGS.items() if beginning.startswith(mark))
    kind = next(certain, _FORMATS[suffix])
    reader = importlib.import_module(f"actioncli.clips.formats.{kind}")
    try:
        recording: Recording = reader.read(file)
    except OSError as error:
        raise ClipError(f"{file}: cannot be read: {error.strerror or error}.") from error
    except MemoryError as error:
        raise ClipError(f"{file}: needs more memory than there is.") from error
    if kind != _FORMATS[suffix]:
        note = f"read as .{kind} by its content, in spite of its suffix"
        recording = replace(recording, notes=(*recording.notes, note))
    return recording


def _decide(recording: Recording, where: str, unit_is_certain: bool) -> Clip:
    """From what the file holds to a clip, in the order in which one decision needs another."""
    frames, people, joints, _ = recording.positions.shape
    if recording.positions.size > LARGEST_CLIP or frames > LONGEST_CLIP or joints > MOST_JOINTS:
        raise ClipError(
            f"{where}: {frames} frames of {joints} joints are more than the {LONGEST_CLIP} "
            f"frames, {MOST_JOINTS} joints or {LARGEST_CLIP} coordinates that a clip may have; "
            "cut out the action."
        )
    if people > MOST_PEOPLE:
        raise ClipError(f"{where}: {people} people in a frame; at most {MOST_PEOPLE} are followed.")
    if frames < 2:
        raise ClipError(f"{where}: a clip needs at least 2 frames, this has {frames}.")
    names, notes = _joint_names(recording, where)
    recording = most_active(replace(recording, notes=recording.notes + notes), where)
    recording, names = _with_head(recording, names)
    decided = list(recording.notes)
    fps = recording.fps
    if fps is None:
        fps = _USUAL_FPS
        decided.append(f"frame rate not stated: {fps:g} assumed (--fps)")
    elif not LEAST_FPS <= fps <= MOST_FPS:
        raise ClipError(f"{where}: states {fps:g} frames per second; give --fps.")
    confidence = None if recording.confidence is None else recording.confidence[:, 0]
    positions, names, confidence, gaps = fill_gaps(
        recording.positions[:, 0], names, fps, where, confidence, recording.zeros_are_gaps
    )
    decided.extend(gaps)

    whole = filled(positions) if np.isnan(positions).any() else positions
    size = axes.body_size(whole, names)
    metres, told = _unit(recording.unit, size, unit_is_certain, where)
    decided.extend(told)
    if told and size and not any(axes.fits_a_body(size, each) for each in axes.UNITS.values()):
        _check_places(whole, names, where)
    if recording.up is None:
        up = axes.infer_up(whole, names, metres, recording.rest_up, where)
        decided.append(f"up axis inferred from the posture: {up} (--up)")
    else:
        up = axes.parse_up(recording.up) or ""
        if not up:
            raise AmbiguousClipError(
                f"{where}: states the up axis {recording.up[:40]!r}, which is none of "
                f"{', '.join(axes.UPS)}; give --up."
            )
    canonical = axes.to_canonical(positions, metres, up)
    return Clip(canonical, names, fps, confidence, source=where, notes=decided)


def _with_head(recording: Recording, names: tuple[str, ...]) -> tuple[Recording, tuple[str, ...]]:
    """A body without a head has one that was not seen."""
    columns = default_columns(names)
    if "head" in columns or not {"pelv", "neck", "lwri", "rwri"} <= columns.keys():
        return recording, names
    positions = recording.positions
    confidence = recording.confidence
    if confidence is None:
        confidence = np.ones(positions.shape[:3], np.float32)
    unseen = np.full_like(positions[:, :, :1], np.nan)
    return replace(
        recording,
        positions=np.concatenate([positions, unseen], axis=2),
        confidence=np.concatenate([confidence, np.zeros_like(unseen[..., 0])], axis=2),
        notes=(*recording.notes, "has no head, which counts as not seen"),
    ), (*names, "head")


def _joint_names(recording: Recording, where: str) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """The names of the columns, and a note where they were inferred."""
    joints = recording.positions.shape[2]
    names = recording.joint_names
    if names is not None:
        if len(names) != joints:
            raise ClipError(
                f"{where}: {joints} joints but {len(names)} joint names; give --layout "
                f"({', '.join(LAYOUTS)})."
            )
        if twice := sorted({name for name in names if names.count(name) > 1}):
            raise ClipError(
                f"{where}: joint names appear twice: {', '.join(map(repr, twice))}; name each, or "
                "give --layout."
            )
        return names, ()
    if recording.layout is not None:
        named = LAYOUTS.get(recording.layout)
        if named is None:
            raise AmbiguousClipError(
                f"{where}: states the layout {recording.layout[:40]!r}, which is unknown; give "
                f"--layout ({', '.join(LAYOUTS)})."
            )
        if len(named) != joints:
            raise ClipError(
                f"{where}: {joints} joints, but the layout {recording.layout} has {len(named)}; "
                f"of this count: {', '.join(_layouts_of(joints)) or 'none'}."
            )
        return named, ()
    fitting = _layouts_of(joints)
    if len(fitting) == 1:
        return LAYOUTS[fitting[0]], (f"layout inferred from {joints} joints: {fitting[0]}",)
    if fitting:
        raise AmbiguousClipError(
            f"{where}: its {joints} joints are not named, and {len(fitting)} layouts have that "
            f"many; give --layout {' or '.join(fitting)}."
        )
    counts = ", ".join(f"{name} ({len(columns)})" for name, columns in LAYOUTS.items())
    raise ClipError(
        f"{where}: its {joints} joints are not named, and no layout has that many: {counts}. "
        "Save joint names beside the positions (.npz or .json with joint_names)."
    )


def _layouts_of(joints: int) -> list[str]:
    return [name for name, columns in LAYOUTS.items() if len(columns) == joints]


def _unit(
    stated: str | None, size: float | None, certain: bool, where: str
) -> tuple[float, list[str]]:
    """Metres per unit, with notes; a file's statement must give a body of some person's size."""
    metres = None if stated is None else axes.parse_unit(stated)
    if metres is not None and (certain or size is None or axes.fits_a_body(size, metres)):
        return metres, []
    inferred, note = axes.infer_unit(size, where)
    if stated is None:
        return inferred, [note]
    wrong = f"is none of {', '.join(axes.UNITS)}"
    if metres is not None and size is not None:
        wrong = f"would make the body {size * metres:.3g} times a grown person's"
    return inferred, [f"states {stated[:40]!r} as its unit, which {wrong}", note]
