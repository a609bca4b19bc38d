"""C3D: markers of optical motion capture, read by ezc3d (the extra `c3d`).

The markers of the common sets (Plug-in Gait, Helen Hayes and others of OpenSim, Qualisys) stand for
the joints that they lie on; where a joint has one on each side, it is between them.
"""

from __future__ import annotations

import importlib
from pathlib import Path
from typing import Any

import numpy as np

from actioncli.clips.axes import parse_up
from actioncli.clips.formats.files import check_range
from actioncli.clips.recording import LARGEST_CLIP, LONGEST_CLIP, Recording
from actioncli.clips.skeleton import default_columns
from actioncli.errors import ClipError

# What the format itself can count to.
_MOST_MARKERS = 2**16


def read(file: Path) -> Recording:
    """Marker positions (T, 1, J, 3): of the markers that stand for joints, or all where none does.

    Raises:
        ClipError: ezc3d is not installed, or the file is damaged.
    """
    try:
        ezc3d = importlib.import_module("ezc3d")
    except ImportError as error:
        raise ClipError(
            f"{file}: .c3d needs ezc3d: pip install 'actioncli[c3d]'; or save its markers as .trc."
        ) from error
    try:
        content = ezc3d.c3d(str(file))
        stated = content["parameters"]["POINT"]
        points = np.asarray(content["data"]["points"], np.float64)
        residuals = np.asarray(content["data"]["meta_points"]["residuals"], np.float64)
        labels = [str(label) for key in ("LABELS", "LABELS2") for label in _values(stated, key)]
    # The library's own errors are of many types.
    except Exception as error:
        text = str(error)[:200]
        raise ClipError(f"{file}: is a damaged .c3d file: {text}.") from error
    count, frames = points.shape[1:]
    if not 0 < count < _MOST_MARKERS or frames > LONGEST_CLIP or count * frames > LARGEST_CLIP:
        raise ClipError(f"{file}: {frames} frames of {count} markers are no clip.")
    names = [*labels, *(f"marker {at}" for at in range(count))][:count] if labels else None
    positions = points[:3].transpose(2, 1, 0)
    positions[residuals[0].T < 0] = np.nan
    if names is not None:
        first = {name: at for at, name in reversed(list(enumerate(names)))}
        columns = default_columns(tuple(first))
        numbers = list(first.values())
        used = sorted({numbers[at] for group in columns.values() for at in group})
        kept = used or sorted(numbers)
        positions, names = positions[:, kept], [names[at] for at in kept]
    with np.errstate(over="ignore", invalid="ignore"):
        places = np.ascontiguousarray(positions, np.float32)[:, None]
    check_range(places, str(file))
    rate = next(iter(_values(stated, "RATE")), None)
    up = parse_up(str(next(iter(_values(stated, "Y_SCREEN")), "")))
    return Recording(
        places,
        joint_names=None if names is None else tuple(names),
        fps=float(rate) if rate else None,
        unit=str(next(iter(_values(stated, "UNITS")), "")) or None,
        rest_up=up,
    )


def _values(group: Any, key: str) -> list[Any]:
    return list(group[key]["value"]) if key in group else []
