"""Skeleton layouts: which joint stands in which column, and how joints map to one another.

Files name joints in many ways; the model asks for joints by the short names of MeTRAbs
(`lsho`, `rkne`). Two joints that sensors place differently, pelvis and neck, are defined alike
for all of them: the midpoint of the hips and the midpoint of the shoulders.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import lru_cache
from types import MappingProxyType

import numpy as np

from actioncli.clips.clip import FloatArray
from actioncli.errors import ClipError

# The 15 joints that every sensor has, in the order in which the default model reads them.
_DEFAULT_15 = "pelv lhip rhip lkne rkne lank rank neck head lsho rsho lelb relb lwri rwri"
DEFAULT_JOINTS = tuple(_DEFAULT_15.split())

_SMPL_24 = (
    "pelv lhip rhip spi1 lkne rkne spi2 lank rank spi3 ltoe rtoe "
    "neck lcla rcla head lsho rsho lelb relb lwri rwri lhan rhan"
)
# Names, in column order, of the layouts that a file may have without naming its joints.
LAYOUTS: Mapping[str, tuple[str, ...]] = MappingProxyType(
    {
        name: tuple(columns.split())
        for name, columns in {
            "smpl_24": _SMPL_24,
            "smpl+head_30": _SMPL_24 + " htop lear leye nose rear reye",
            "coco_19": "neck nose pelv lsho lelb lwri lhip lkne lank rsho relb rwri rhip rkne "
            "rank leye lear reye rear",
            "h36m_17": "pelv rhip rkne rank lhip lkne lank spin neck head htop lsho lelb lwri "
            "rsho relb rwri",
            "h36m_25": "rhip rkne rank rfoo rtoe lhip lkne lank lfoo ltoe spin neck head htop "
            "lsho lelb lwri lthu lfin rsho relb rwri rthu rfin pelv",
            "mpi_inf_3dhp_17": "htop neck rsho relb rwri lsho lelb lwri rhip rkne rank lhip lkne "
            "lank pelv spin head",
            "mpi_inf_3dhp_28": "thor spi4 spi2 spin pelv neck head htop lcla lsho lelb lwri lhan "
            "rcla rsho relb rwri rhan lhip lkne lank lfoo ltoe rhip rkne rank rfoo rtoe",
            "kinect_v1_20": "hip_center spine shoulder_center head shoulder_left elbow_left "
            "wrist_left hand_left shoulder_right elbow_right wrist_right hand_right hip_left "
            "knee_left ankle_left foot_left hip_right knee_right ankle_right foot_right",
            "openni_15": "head neck torso shoulder_left elbow_left hand_left shoulder_right "
            "elbow_right hand_right hip_left knee_left foot_left hip_right knee_right foot_right",
            "kinect_v2_25": "spinebase spinemid neck head lsho lelb lwri lhan rsho relb rwri rhan "
            "lhip lkne lank lfoo rhip rkne rank rfoo spineshoulder lhandtip lthu rhandtip rthu",
            "blazepose_33": "nose leye_inner leye leye_outer reye_inner reye reye_outer lear rear "
            "lmouth rmouth lsho rsho lelb relb lwri rwri lpinky rpinky lindex rindex lthu rthu "
            "lhip rhip lkne rkne lank rank lheel rheel lfoo rfoo",
            "default_15": _DEFAULT_15,
        }.items()
    }
)

# What a joint may be called elsewhere, best first; `{s}` stands for either side's spelling and
# all is compared in lower case without separators. A hand stands in for a missing wrist, a foot
# for a missing ankle (OpenNI).
_SIDED: Mapping[str, tuple[str, ...]] = {
    "hip": ("{s}hip", "hip{s}", "{s}upleg", "upperleg{s}", "thigh{s}", "{s}thigh", "{s}hipjoint",
            "{s}upperleg", "hipjoint{s}"),
    "kne": ("{s}kne", "{s}knee", "knee{s}", "{s}leg", "lowerleg{s}", "{s}lowerleg", "calf{s}",
            "shin{s}", "{s}shin", "{s}calf"),
    "ank": ("{s}ank", "{s}ankle", "ankle{s}", "{s}foot", "foot{s}", "{s}foo"),
    "sho": ("{s}sho", "{s}arm", "upperarm{s}", "{s}upperarm", "{s}shoulder", "shoulder{s}"),
    "elb": ("{s}elb", "{s}elbow", "elbow{s}", "{s}forearm", "lowerarm{s}", "forearm{s}",
            "{s}lowerarm"),
    "wri": ("{s}wri", "{s}wrist", "wrist{s}", "{s}hand", "hand{s}", "{s}han"),
}  # fmt: skip
_HEAD = ("head", "headcenter")
_EARS = (("lear", "leftear", "earleft"), ("rear", "rightear", "earright"))


def _key(name: str) -> str:
    """Fold case and separators, and drop a rig's prefix (`mixamorig:LeftArm`)."""
    return "".join(c for c in name.rpartition(":")[2].lower() if c.isalnum())


def _column_of(names: Sequence[str], spellings: Sequence[str]) -> int | None:
    keys = {_key(name): column for column, name in reversed(list(enumerate(names)))}
    return next((keys[spelling] for spelling in spellings if spelling in keys), None)


def _sides(spelling: str, side: str) -> tuple[str, ...]:
    word = {"l": "left", "r": "right"}[side]
    return spelling.format(s=word), spelling.format(s=side)


def default_columns(names: Sequence[str]) -> dict[str, tuple[int, ...]]:
    """Columns whose mean is each default joint that `names` can give.

    Returns:
        Short joint name to one column, or to the two whose midpoint it is. Joints that the
        names cannot give are absent.
    """
    found: dict[str, tuple[int, ...]] = {}
    for joint, spellings in _SIDED.items():
        for side in "lr":
            tried = [word for spelling in spellings for word in _sides(spelling, side)]
            column = _column_of(names, tried)
            if column is not None:
                found[side + joint] = (column,)
    for middle, part in (("pelv", "hip"), ("neck", "sho")):
        if f"l{part}" in found and f"r{part}" in found:
            found[middle] = found[f"l{part}"] + found[f"r{part}"]
    head = _column_of(names, _HEAD)
    ears = [_column_of(names, side) for side in _EARS]
    if head is not None:
        found["head"] = (head,)
    elif ears[0] is not None and ears[1] is not None:
        found["head"] = (ears[0], ears[1])
    return found


def select_joints(
    joints: FloatArray, names: Sequence[str], wanted: Sequence[str], source: str = ""
) -> FloatArray:
    """The joints a model reads, in its order.

    Args:
        joints: (T, J, 3) in the layout `names`.
        names: J joint names.
        wanted: K names; pelvis and neck are always the midpoints of hips and shoulders.

    Returns:
        (T, K, 3) float32.

    Raises:
        ClipError: a wanted joint is neither named nor can be derived.
    """
    columns = _columns_of(tuple(names), tuple(wanted))
    missing = [name for name, column in zip(wanted, columns, strict=True) if not column]
    if missing:
        where = f"{source}: " if source else ""
        raise ClipError(
            f"{where}the model needs the joints {', '.join(missing)}, which are not among "
            f"{', '.join(names)}. If the file names its joints wrongly, give --layout "
            f"({', '.join(LAYOUTS)})."
        )
    return np.stack([joints[:, list(column), :].mean(axis=1) for column in columns], axis=1)


@lru_cache(maxsize=64)
def _columns_of(names: tuple[str, ...], wanted: tuple[str, ...]) -> tuple[tuple[int, ...], ...]:
    """Columns whose mean is each wanted joint; empty where the names cannot give it."""
    derived = default_columns(names)
    by_name: dict[str, tuple[int, ...]] = {_key(name): (at,) for at, name in enumerate(names)}
    return tuple(derived.get(name) or by_name.get(_key(name), ()) for name in wanted)
