"""Named fields, as `.npz` and `.json` hold them, to a recording."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from actioncli.clips.clip import FloatArray
from actioncli.clips.formats.shapes import to_people
from actioncli.clips.recording import MOST_JOINTS, Recording
from actioncli.errors import ClipError

# Where positions are looked for, best first; MeTRAbs calls them poses3d, a nameless array of
# numpy.savez is arr_0.
POSITIONS = ("poses3d", "joints", "arr_0")


def from_fields(fields: Mapping[str, NDArray[Any]], where: str) -> Recording:
    """A recording from positions and what may stand beside them.

    Args:
        fields: `poses3d` or `joints`; optional `joint_names` (J,), `fps`, `layout`, `unit`,
            `up`, `confidence` (T, J) or (T, P, J).
        where: the file, for messages.

    Raises:
        ClipError: positions are absent, or a field has the wrong type or shape.
    """
    key = next((key for key in POSITIONS if key in fields), None)
    if key is None:
        held = ", ".join(repr(name[:40]) for name in list(fields)[:20]) or "nothing"
        raise ClipError(f"{where}: holds {held}; a clip needs poses3d or joints.")
    positions = to_people(np.asarray(fields[key]), f"{where} ({key})")
    return Recording(
        positions,
        joint_names=_names(fields, where),
        layout=_text(fields, "layout", where),
        fps=_number(fields, "fps", where),
        unit=_text(fields, "unit", where),
        up=_text(fields, "up", where),
        confidence=_confidence(fields, positions.shape[:3], where),
    )


def _names(fields: Mapping[str, NDArray[Any]], where: str) -> tuple[str, ...] | None:
    if "joint_names" not in fields:
        return None
    names = np.asarray(fields["joint_names"])
    if names.dtype.kind not in "US" or names.ndim != 1 or len(names) > MOST_JOINTS:
        raise ClipError(f"{where}: joint_names must be a list of at most {MOST_JOINTS} names.")
    return tuple(_decoded(name) for name in names.tolist())


def _text(fields: Mapping[str, NDArray[Any]], key: str, where: str) -> str | None:
    if key not in fields:
        return None
    value = np.asarray(fields[key])
    if value.size != 1 or value.dtype.kind not in "USiuf":
        raise ClipError(f"{where}: {key} must be one word.")
    return _decoded(value.reshape(-1).tolist()[0])


def _number(fields: Mapping[str, NDArray[Any]], key: str, where: str) -> float | None:
    if key not in fields:
        return None
    value = np.asarray(fields[key])
    if value.size != 1 or value.dtype.kind not in "iuf":
        raise ClipError(f"{where}: {key} must be one number.")
    return float(value.reshape(-1)[0])


def _confidence(
    fields: Mapping[str, NDArray[Any]], shape: tuple[int, ...], where: str
) -> FloatArray | None:
    if "confidence" not in fields:
        return None
    value = np.asarray(fields["confidence"])
    if value.dtype.kind not in "iufb" or value.size != np.prod(shape):
        raise ClipError(
            f"{where}: confidence must be (frames, joints) or (frames, people, joints) like the "
            f"positions, not {value.shape}."
        )
    with np.errstate(over="ignore", invalid="ignore"):
        known = np.nan_to_num(value.reshape(shape).astype(np.float32), nan=0.0)
    return np.clip(known, 0, 1)


def _decoded(value: Any) -> str:
    return value.decode("utf-8", "replace") if isinstance(value, bytes) else str(value)
