"""Units and axes: from those of a file to right-handed metres, y up.

Both are inferred from the body where a file does not state them: the unit from the length of the
limbs, since metres, centimetres and millimetres lie a factor of ten apart and people do not; the
up axis from the posture, since the head stands above the ankles along it. Turning the up axis to
y is a rotation, never a reflection, so that left stays left; the heading remains free.
"""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from actioncli.clips.clip import FloatArray
from actioncli.clips.skeleton import default_columns, midpoints
from actioncli.errors import AmbiguousClipError

# Metres per unit.
UNITS: Mapping[str, float] = MappingProxyType({"m": 1.0, "cm": 0.01, "mm": 0.001, "in": 0.0254})
_UNIT_STEMS = {"met": "m", "centi": "cm", "milli": "mm", "inch": "in"}

# For each axis that may point up in a file: where the canonical x, y, z are found, and their
# signs. Each is a rotation (determinant 1). Camera axes (x right, y down, z away) are "-y":
# turned by 180 degrees about z they keep the distance from the sensor in z.
_TURNS: Mapping[str, tuple[tuple[int, int, int], tuple[int, int, int]]] = MappingProxyType(
    {
        "y": ((0, 1, 2), (1, 1, 1)),
        "-y": ((0, 1, 2), (-1, -1, 1)),
        "z": ((0, 2, 1), (1, 1, -1)),
        "-z": ((0, 2, 1), (1, -1, 1)),
        "x": ((1, 0, 2), (-1, 1, 1)),
        "-x": ((1, 0, 2), (1, -1, 1)),
    }
)
UPS = tuple(_TURNS)
_UP_WORDS = {"camera": "-y", "opencv": "-y", "ydown": "-y", "zdown": "-z", "xdown": "-x"}

# Length of a grown person's bones in metres, between default joints.
_LIMBS = {("hip", "kne"): 0.43, ("kne", "ank"): 0.42, ("sho", "elb"): 0.29, ("elb", "wri"): 0.25}
_BONES = {(side + a, side + b): length for (a, b), length in _LIMBS.items() for side in "lr"}
_BONES[("pelv", "neck")] = 0.50
# Toddlers to giants, with room for crude sensors and drawn characters: over ten collections of
# recordings the clips' sizes run from 0.54 to 1.23. The two ends are less than a factor of ten
# apart, so that at most one decimal unit can fit.
_SIZES = (0.3, 2.5)

# The share of frames that settles the up axis, and the cosine between it and the line from
# ankles to head. Of 7,773 recorded clips with y up, 99.6 % are settled so, one wrongly (a swimmer);
# for the others, who sit, lie or crawl, --up is needed. With z up, it is 95 %.
_MOST_FRAMES = 0.6
_USUAL_UPS = ("y", "-y", "z")
_UPRIGHT = 0.7


def parse_unit(text: str | float) -> float | None:
    """Metres per unit from a name of the unit or a number; None where it is neither."""
    word = str(text).strip().lower()
    if word in UNITS:
        return UNITS[word]
    for stem, unit in _UNIT_STEMS.items():
        if word.startswith(stem):
            return UNITS[unit]
    try:
        metres = float(word)
    except ValueError:
        return None
    return metres if 1e-9 < metres < 1e9 else None


def parse_up(text: str) -> str | None:
    """One of `UPS` from the usual spellings (`y`, `+Y`, `z-up`, `camera`), else None."""
    word = str(text).strip().lower().replace("_", "").replace(" ", "")
    sign = "-" if word.startswith("-") else ""
    bare = word.lstrip("+-").replace("-", "")
    up = _UP_WORDS.get(bare, bare.removesuffix("up"))
    up = sign + up if not up.startswith("-") else up
    return up if up in UPS else None


def body_size(positions: FloatArray, names: tuple[str, ...]) -> float | None:
    """How long the bones are against a grown person's, in the file's unit (a ratio x unit).

    Args:
        positions: (T, J, 3), finite.
        names: J joint names.

    Returns:
        The median ratio over bones of their median length over frames, or None where the names
        give no bone.
    """
    columns = default_columns(names)
    measured = [bone for bone in _BONES if bone[0] in columns and bone[1] in columns]
    if not measured:
        return None
    ends = midpoints(positions, [columns[joint] for bone in measured for joint in bone])
    bones = ends[:, ::2] - ends[:, 1::2]
    sizes = median(np.sqrt((bones * bones).sum(axis=2)))
    return float(median(sizes / np.array([_BONES[bone] for bone in measured])))


def infer_unit(size: float | None, where: str) -> tuple[float, str]:
    """Metres per unit by the body's size, and a note on it.

    The one usual unit in which it is a person's; where there is none (motion capture in units of
    its own, drawn figures), the body is given a grown person's: no decision depends on it.

    Raises:
        AmbiguousClipError: there is no body to measure.
    """
    if size is None or not 1e-8 < size < 1e8:
        raise AmbiguousClipError(
            f"{where}: the unit of length is not stated, and the joint names give no bone to "
            f"measure. Give --unit ({', '.join(UNITS)}) or, if the names are wrong, --layout."
        )
    fitting = [unit for unit in ("m", "cm", "mm") if fits_a_body(size, UNITS[unit])]
    if len(fitting) == 1:
        return UNITS[fitting[0]], f"unit inferred from the size of the body: {fitting[0]} (--unit)"
    return 1 / size, f"unit taken for {1 / size:.3g} m, so that the body has a grown person's size"


def fits_a_body(size: float, metres: float) -> bool:
    """Whether bones of `size` (see `body_size`) are a person's at `metres` per unit."""
    return _SIZES[0] <= size * metres <= _SIZES[1]


def infer_up(
    positions: FloatArray, names: tuple[str, ...], metres: float, rest_up: str | None, where: str
) -> str:
    """The axis along which the head is above the ankles in most frames.

    Only y, -y and z are ever inferred; other conventions are so rare that a person who lies
    down is the likelier reading. For the same reason z is not inferred where y looks like the
    height above a floor, or z like the distance from a sensor.

    Args:
        positions: (T, J, 3) in the file's unit, finite.
        names: J joint names.
        metres: per unit.
        rest_up: what the file's rest pose says, or None.
        where: the file, for the message.

    Raises:
        AmbiguousClipError: the posture settles nothing, or contradicts the rest pose.
    """
    shares = _upright_shares(positions, names)
    standing = max(shares, key=lambda axis: shares[axis]) if shares else None
    upright = standing is not None and shares[standing] >= _MOST_FRAMES
    if rest_up is not None:
        if not upright or standing == rest_up or standing not in _USUAL_UPS:
            return rest_up
    elif standing in _USUAL_UPS and upright:
        lying = standing == "z" and _may_lie(positions, metres)
        if not lying:
            return standing
    if not shares:
        seen = "the joint names give no head and ankles or hips to see the posture by"
    elif upright and rest_up is not None:
        seen = f"the rest pose stands along {rest_up} but the motion along {standing}"
    elif upright:
        seen = (
            f"the head is beyond the feet along {standing} in {shares[standing or '']:.0%} of "
            "the frames, which may be a person standing or one lying down"
        )
    else:
        figures = ", ".join(f"{axis} {share:.0%}" for axis, share in shares.items() if share)
        seen = f"the head is above the feet along: {figures or 'no axis'} of the frames"
    raise AmbiguousClipError(
        f"{where}: the axis that points up is not stated and cannot be told from the posture: "
        f"{seen}. Give --up ({', '.join(UPS)}; camera axes, with y down in the image, are -y)."
    )


def to_canonical(positions: FloatArray, metres: float, up: str) -> FloatArray:
    """Right-handed metres, y up, from a file's unit and axes.

    Args:
        positions: (..., 3).
        metres: per unit.
        up: one of `UPS`.
    """
    order, signs = _TURNS[up]
    factors = np.array([sign * metres for sign in signs])
    turned: FloatArray = (positions[..., list(order)] * factors).astype(np.float32)
    return turned


def _upright_shares(positions: FloatArray, names: tuple[str, ...]) -> dict[str, float]:
    """Signed axis to the share of frames in which the head is above the feet along it."""
    columns = default_columns(names)
    low = [columns[joint] for joint in ("lank", "rank") if joint in columns]
    low = low or [columns["pelv"]] if "pelv" in columns else low
    # A body without a head stands as its neck does.
    high = columns.get("head", columns.get("neck"))
    if high is None or not low:
        return {}
    ends = midpoints(positions, [high, *low])
    line = ends[:, 0] - ends[:, 1:].sum(axis=1) / len(low)
    length = np.sqrt((line * line).sum(axis=1, keepdims=True))
    cosine = line / np.where(length > 0, length, 1)
    counts = [(sign * cosine > _UPRIGHT).sum(axis=0).tolist() for sign in (1, -1)]
    return {
        sign + axis: count[at] / len(positions)
        for at, axis in enumerate("xyz")
        for sign, count in zip(("", "-"), counts, strict=True)
    }


def _may_lie(positions: FloatArray, metres: float) -> bool:
    """Whether a body that extends along z could be lying before a sensor or on a floor at y 0."""
    low, middle, high = (
        np.median(reduce(positions, axis=1), axis=0) * metres
        for reduce in (np.min, np.mean, np.max)
    )
    before_a_sensor = abs(low[2]) > 1.5
    # The middle of who lies or crawls is at most at knee height; one way up or the other.
    on_a_floor = (abs(low[1]) < 0.35 and 0.08 < middle[1] < 0.7) or (
        abs(high[1]) < 0.35 and 0.08 < -middle[1] < 0.7
    )
    return bool(before_a_sensor or on_a_floor)


def median(values: NDArray[Any]) -> NDArray[Any]:
    """Along the first axis. numpy's own takes longer than all else here, and still longer at its
    first call: it looks for NaN, and imports what it does so by."""
    ordered, half = np.sort(values, axis=0), len(values) // 2
    return np.asarray((ordered[half] + ordered[~half]) / 2)
