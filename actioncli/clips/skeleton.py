"""The skeleton: layouts, the joints that models read, their bones, and the body's geometry.

Files name joints in many ways; the model asks for joints by the short names of MeTRAbs
(`lsho`, `rkne`). Two joints that sensors place differently, pelvis and neck, are defined alike
for all of them: the midpoint of the hips and the midpoint of the shoulders.
"""

from __future__ import annotations

import re
import string
from collections.abc import Iterable, Mapping, Sequence
from functools import lru_cache
from itertools import takewhile
from types import MappingProxyType
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from actioncli.errors import ClipError

FloatArray = NDArray[np.float32]

# The 15 joints that every sensor has, in the order in which the default model reads them.
_DEFAULT_15 = "pelv lhip rhip lkne rkne lank rank neck head lsho rsho lelb relb lwri rwri"
DEFAULT_JOINTS = tuple(_DEFAULT_15.split())
# Bones of the default joints from the pelvis outwards: joint, its parent, standard length in
# torso lengths (a rounded adult). A parent always stands before its children.
BONES: tuple[tuple[str, str, float], ...] = (
    ("lhip", "pelv", 0.2),
    ("rhip", "pelv", 0.2),
    ("neck", "pelv", 1.0),
    ("lkne", "lhip", 0.8),
    ("rkne", "rhip", 0.8),
    ("lank", "lkne", 0.78),
    ("rank", "rkne", 0.78),
    ("head", "neck", 0.45),
    ("lsho", "neck", 0.37),
    ("rsho", "neck", 0.37),
    ("lelb", "lsho", 0.58),
    ("relb", "rsho", 0.58),
    ("lwri", "lelb", 0.52),
    ("rwri", "relb", 0.52),
)

# The joints of each limb, from the trunk outwards.
LIMBS: Mapping[str, tuple[str, str, str]] = MappingProxyType(
    {
        "left arm": ("lsho", "lelb", "lwri"),
        "right arm": ("rsho", "relb", "rwri"),
        "left leg": ("lhip", "lkne", "lank"),
        "right leg": ("rhip", "rkne", "rank"),
    }
)
Side = Literal["left", "right", "middle"]

_SMPL_24 = (
    "pelv lhip rhip spi1 lkne rkne spi2 lank rank spi3 ltoe rtoe "
    "neck lcla rcla head lsho rsho lelb relb lwri rwri lhan rhan"
)
_BLAZEPOSE = (
    "nose leye_inner leye leye_outer reye_inner reye reye_outer lear rear lmouth rmouth lsho rsho "
    "lelb relb lwri rwri lpinky rpinky lindex rindex lthu rthu lhip rhip lkne rkne lank rank "
    "lheel rheel lfoo rfoo"
)
# The wrist, then four joints of each finger from the palm outwards, the thumb first.
HAND_JOINTS = tuple(f"{side}hand{joint}" for side in "lr" for joint in range(21))
# The joint before each of a hand's joints 1 to 20; every finger begins at the wrist.
HAND_PARENTS = tuple(0 if joint % 4 == 1 else joint - 1 for joint in range(1, 21))
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
            "blazepose_33": _BLAZEPOSE,
            "holistic_75": " ".join((_BLAZEPOSE, *HAND_JOINTS)),
            # OpenPose's 25, then 24 of data sets, as SPIN, VIBE and PyMAF give them.
            "spin_49": "nose neck rsho relb rwri lsho lelb lwri pelv rhip rkne rank lhip lkne lank "
            "reye leye rear lear lbigtoe llittletoe lheel rbigtoe rlittletoe rheel "
            "rank_lsp rkne_lsp rhip_lsp lhip_lsp lkne_lsp lank_lsp rwri_lsp relb_lsp rsho_lsp "
            "lsho_lsp lelb_lsp lwri_lsp neck_lsp htop pelv_mpii thor spin jaw head nose_coco "
            "leye_coco reye_coco lear_coco rear_coco",
            "default_15": _DEFAULT_15,
        }.items()
    }
)

# What a joint may be called elsewhere, best first; `{s}` stands for either side's spelling and
# all is compared in lower case without separators. Rigs name a joint by the bone that it moves
# (`LeftArm` turns about the shoulder, `LeftLeg` about the knee), so the bone comes before the
# body part that some of them use for the collarbone (`LeftShoulder`). Where several columns are
# listed, their midpoint is the joint. A hand stands in for a missing wrist, a foot for a missing
# ankle (OpenNI), markers at the front of the pelvis for the hips.
_SIDED: Mapping[str, tuple[str, ...]] = {
    "hip": ("{s}hjc", "{s}hip", "hip{s}", "{s}upleg", "upleg{s}", "upperleg{s}", "{s}upperleg",
            "thigh{s}", "{s}thigh", "{s}thighbend", "{s}hipjoint", "hipjoint{s}", "{s}asis",
            "{s}asi", "{s}ias"),
    "kne": ("{s}kjc", "{s}kne", "{s}knee", "knee{s}", "{s}leg", "leg{s}", "lowerleg{s}",
            "{s}lowerleg", "{s}lowleg", "calf{s}", "{s}calf", "shin{s}", "{s}shin",
            "{s}kneelat {s}kneemed", "{s}kneelat", "{s}lfc {s}mfc", "{s}fle {s}fme", "{s}fle"),
    "ank": ("{s}ajc", "{s}ank", "{s}ankle", "ankle{s}", "{s}anklelat {s}anklemed", "{s}anklelat",
            "{s}lmal {s}mmal", "{s}fal {s}tam", "{s}fal", "{s}foot", "foot{s}", "{s}foo"),
    "sho": ("{s}sjc", "{s}sho", "{s}arm", "arm{s}", "upperarm{s}", "{s}upperarm", "{s}uparm",
            "{s}shldr", "{s}shldrbend", "{s}shoulder", "shoulder{s}", "{s}acromium",
            "{s}acromion", "{s}acr", "{s}sae"),
    "elb": ("{s}ejc", "{s}elb", "{s}elbow", "elbow{s}", "{s}forearm", "forearm{s}",
            "lowerarm{s}", "{s}lowerarm", "{s}lowarm", "{s}forearmbend",
            "{s}elbowlat {s}elbowmed", "{s}elbowlat", "{s}lel {s}mel", "{s}hle {s}hme", "{s}hle"),
    "wri": ("{s}wjc", "{s}wri", "{s}wrist", "wrist{s}", "{s}wra {s}wrb", "{s}wra",
            "{s}wristlat {s}wristmed", "{s}wristlat", "{s}faradius {s}faulna", "{s}rsp {s}usp",
            "{s}hand", "hand{s}", "{s}han"),
}  # fmt: skip
_HEAD = ("head", "headcenter", "lear rear", "leftear rightear", "earleft earright", "leye reye",
         "lefteye righteye", "lfhd rfhd lbhd rbhd", "nose", "htop", "headtop", "tophead",
         "sgl")  # fmt: skip
_SIDES = {"l": ("left", "l"), "r": ("right", "r")}
# What modelling programs put before every joint of a rig.
_RIG_PREFIX = re.compile(r"^(?:mixamorig|bip|ccbase|character)\d*(?=\D)")


@lru_cache(maxsize=4096)
def _key(name: str) -> str:
    """Fold case and separators, and drop a rig's prefix (`mixamorig:LeftArm`)."""
    folded = "".join(c for c in name.rpartition(":")[2].lower() if c.isalnum())
    return _RIG_PREFIX.sub("", folded)


def _without_shared_prefix(names: Sequence[str]) -> list[str]:
    """Drop what all joints begin with (`Model_Hips`, `Model_Head`), up to its last separator."""
    if len(names) < 2:
        return list(names)
    pairs = zip(min(names), max(names), strict=False)
    alike = "".join(one for one, _ in takewhile(lambda pair: pair[0] == pair[1], pairs))
    length = len(alike.rstrip(string.ascii_letters + string.digits))
    return [name[length:] for name in names]


def _find(columns: Mapping[str, int], spellings: Iterable[str]) -> tuple[int, ...] | None:
    for spelling in spellings:
        words = spelling.split()
        if all(word in columns for word in words):
            return tuple(columns[word] for word in words)
    return None


@lru_cache(maxsize=256)
def _default_columns(names: tuple[str, ...]) -> Mapping[str, tuple[int, ...]]:
    bare = _without_shared_prefix(names)
    columns = {_key(name): column for column, name in reversed(list(enumerate(bare)))}
    found: dict[str, tuple[int, ...]] = {}
    for joint, spellings in _SIDED.items():
        for side, words in _SIDES.items():
            tried = (spelling.format(s=word) for spelling in spellings for word in words)
            column = _find(columns, tried)
            if column is not None:
                found[side + joint] = column
    for middle, part in (("pelv", "hip"), ("neck", "sho")):
        if f"l{part}" in found and f"r{part}" in found:
            found[middle] = found[f"l{part}"] + found[f"r{part}"]
    head = _find(columns, _HEAD)
    if head is not None:
        found["head"] = head
    return MappingProxyType(found)


def default_columns(names: Sequence[str]) -> Mapping[str, tuple[int, ...]]:
    """Columns whose mean is each default joint that `names` can give.

    Returns:
        Short joint name to one column, or to those whose midpoint it is. Joints that the
        names cannot give are absent.
    """
    return _default_columns(tuple(names))


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
    return midpoints(joints, columns)


def midpoints(joints: FloatArray, columns: Sequence[tuple[int, ...]]) -> FloatArray:
    """The mean of each group of columns: (T, J, 3) to (T, K, 3)."""
    # Most groups are one column: all are taken at once, and the few others follow.
    means = joints[:, [group[0] for group in columns]]
    for at, group in enumerate(columns):
        if len(group) > 1:
            means[:, at] = sum(joints[:, column] for column in group) / len(group)
    return means


@lru_cache(maxsize=64)
def _columns_of(names: tuple[str, ...], wanted: tuple[str, ...]) -> tuple[tuple[int, ...], ...]:
    """Columns whose mean is each wanted joint; empty where the names cannot give it."""
    derived = default_columns(names)
    by_name: dict[str, tuple[int, ...]] = {_key(name): (at,) for at, name in enumerate(names)}
    return tuple(derived.get(name) or by_name.get(_key(name), ()) for name in wanted)


def side_of(joint: str) -> Side:
    """The side of the body that a joint with a short name belongs to."""
    return "left" if joint[0] == "l" else "right" if joint[0] == "r" else "middle"


def mirrored_columns(names: Sequence[str]) -> list[int]:
    """For each joint with a short name the column of its counterpart on the other side.

    A joint without one is its own: `lwri` is `rwri` in the mirror, `head` stays.
    """
    other = {"l": "r", "r": "l"}
    column = {name: at for at, name in enumerate(names)}
    return [column.get(other.get(name[0], "") + name[1:], at) for name, at in column.items()]


def bone_columns(names: Sequence[str]) -> tuple[list[int], list[int]]:
    """The columns of the outer and of the inner ends of `BONES`, where `names` are the joints."""
    ends = [(names.index(child), names.index(parent)) for child, parent, _ in BONES]
    return [child for child, _ in ends], [parent for _, parent in ends]


def lengths_of(vectors: FloatArray) -> FloatArray:
    """Lengths of vectors, (..., 3) to (...); numpy's own sums three numbers in a slow way."""
    return np.asarray(np.sqrt(np.einsum("...i,...i->...", vectors, vectors)))


def unit(vectors: FloatArray) -> FloatArray:
    """Vectors of length one, (..., 3); the zero vector stays."""
    return np.asarray(vectors / np.maximum(lengths_of(vectors), 1e-6)[..., None], np.float32)


def centred(joints: FloatArray, names: Sequence[str]) -> FloatArray:
    """(T, J, 3) relative to the pelvis in each frame."""
    return joints - joints[:, [names.index("pelv")]]


def turn_to_front(
    joints: FloatArray, names: Sequence[str], lengths: NDArray[np.intp] | None = None
) -> FloatArray:
    """Turn about the vertical until the mean left-to-right axis of hips and shoulders is +x.

    One turn for a whole clip: what the person turns during the action stays visible.

    Args:
        joints: (T, J, 3).
        names: J names.
        lengths: of the clips that stand one after another in `joints`; one clip without it.
    """
    counts = np.array([len(joints)]) if lengths is None else lengths
    angle = np.repeat(headings(joints, names, counts), counts)[:, None]
    cos, sin = np.cos(angle), np.sin(angle)
    x, y, z = joints[..., 0], joints[..., 1], joints[..., 2]
    return np.asarray(np.stack([x * cos + z * sin, y, z * cos - x * sin], axis=-1), np.float32)


def headings(joints: FloatArray, names: Sequence[str], lengths: NDArray[np.intp]) -> FloatArray:
    """How far the mean left-to-right axis of hips and shoulders is turned from +x, radians (N,).

    The arguments are those of `turn_to_front`.
    """
    right = joints[:, names.index("rhip")] + joints[:, names.index("rsho")]
    left = joints[:, names.index("lhip")] + joints[:, names.index("lsho")]
    # Only the direction of the sum matters, so there is no need for the mean.
    across = np.add.reduceat(right - left, np.cumsum(lengths) - lengths, axis=0)
    return np.asarray(np.arctan2(across[:, 2], across[:, 0]), np.float32)


def torso_length(joints: FloatArray, names: Sequence[str]) -> np.float32:
    """Median distance from pelvis to neck, metres; the median, since single frames jump."""
    torso = joints[:, names.index("neck")] - joints[:, names.index("pelv")]
    return np.float32(max(np.median(np.linalg.norm(torso, axis=1)), 1e-3))


def standard_body(joints: FloatArray, names: Sequence[str]) -> FloatArray:
    """The same pose on a body of standard proportions: bone directions kept, lengths replaced.

    Args:
        joints: (T, J, 3) with the pelvis at the origin.
        names: J names, the default joints in any order.

    Returns:
        (T, J, 3) in torso lengths.
    """
    children, parents = bone_columns(names)
    length = np.array([length for _, _, length in BONES], np.float32)
    bones = joints[:, children] - joints[:, parents]
    # A bone of no length has no direction and stays a point.
    bones *= (length / (lengths_of(bones) + np.float32(1e-6)))[..., None]
    standard = np.zeros_like(joints)
    for bone, (child, parent) in enumerate(zip(children, parents, strict=True)):
        standard[:, child] = standard[:, parent] + bones[:, bone]
    return standard
