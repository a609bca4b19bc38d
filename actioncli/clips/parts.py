"""Body parts over time: the bones that the part transformer reads, and which parts were seen.

Limbs that the sensor took for each other are put back. What was not seen gives no numbers: joints
below `UNSEEN` are interpolated over short gaps, and beyond them take a place that follows from the
joints that were seen.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from actioncli.clips.clip import Clip, FloatArray
from actioncli.clips.gaps import LONGEST_GAP, interpolated
from actioncli.clips.prepare import Preparation, frames_at, sample_places
from actioncli.clips.skeleton import (
    BONES,
    DEFAULT_JOINTS,
    HAND_JOINTS,
    HAND_PARENTS,
    LIMBS,
    bone_columns,
    centred,
    default_columns,
    select_joints,
    standard_body,
    turn_to_front,
    unit,
)
from actioncli.clips.swaps import limb_swaps

PARTS = ("torso", "left arm", "right arm", "left leg", "right leg", "left hand", "right hand")
# Confidence below which a joint counts as not seen. Legs under a desk have at most 0.05; of
# people who stand in full view a hidden knee or wrist has 0.1 to 0.5.
UNSEEN = 0.1

_JOINT = {name: at for at, name in enumerate(DEFAULT_JOINTS)}
_CHILDREN, _PARENTS = bone_columns(DEFAULT_JOINTS)

BoolArray = NDArray[np.bool_]


class PartFrames(NamedTuple):
    """N clips as the part transformer reads them.

    Attributes:
        bones: (N, frames, 14, 3) unit vectors along `BONES`.
        hands: (N, frames, 40, 3) unit vectors along the bones of the left hand, then of the
            right one; zero where no hand was seen.
        missing: (N, frames, 7) which of `PARTS` were not seen.
    """

    bones: FloatArray
    hands: FloatArray
    missing: BoolArray


def prepare_parts(clips: Sequence[Clip], preparation: Preparation) -> PartFrames:
    """Bones of body and hands at the frames that `preparation` samples, in the common heading.

    Raises:
        ClipError: a clip lacks the shoulders, or every limb.
    """
    n = preparation.frames
    prepared = PartFrames(
        np.zeros((len(clips), n, len(BONES), 3), np.float32),
        np.zeros((len(clips), n, 40, 3), np.float32),
        np.ones((len(clips), n, len(PARTS)), np.bool_),
    )
    for row, clip in enumerate(clips):
        body, hands, missing = _filled(clip)
        joints = centred(np.concatenate([body, hands], axis=1), DEFAULT_JOINTS)
        joints = turn_to_front(joints, DEFAULT_JOINTS)
        body = standard_body(joints[:, : len(DEFAULT_JOINTS)], DEFAULT_JOINTS)
        at = sample_places(body, n, preparation.motion)
        body = frames_at(body, at)
        prepared.bones[row] = unit(body[:, _CHILDREN] - body[:, _PARENTS])
        prepared.missing[row] = missing[np.round(at).astype(int)]
        hands = frames_at(joints[:, len(DEFAULT_JOINTS) :], at)
        for side in (0, 1):
            seen = ~prepared.missing[row, :, 5 + side]
            hand = hands[seen, 21 * side : 21 * side + 21]
            bones = unit(hand[:, 1:] - hand[:, HAND_PARENTS])
            prepared.hands[row, seen, 20 * side : 20 * side + 20] = bones
    return prepared


def _filled(clip: Clip) -> tuple[FloatArray, FloatArray, BoolArray]:
    """Default joints (T, 15, 3), hands (T, 42, 3) and missing parts (T, 7) of a clip, no number
    of which comes from a joint that was not seen."""
    joints, columns = clip.filled(), default_columns(clip.joint_names)
    wanted = [name for name in DEFAULT_JOINTS if columns.get(name)]
    if not {"lsho", "rsho"} <= set(wanted) or not any(
        set(limb) <= set(wanted) for limb in LIMBS.values()
    ):
        wanted = list(DEFAULT_JOINTS)  # which raises, with the names that are missing
    body = np.zeros((len(clip), len(DEFAULT_JOINTS), 3), np.float32)
    there = [_JOINT[name] for name in wanted]
    body[:, there] = select_joints(joints, clip.joint_names, wanted, clip.source)
    unseen = np.ones(body.shape[:2], np.bool_)
    unseen[:, there] = False
    if clip.confidence is not None:
        for name, at in zip(wanted, there, strict=True):
            group = list(columns[name])
            unseen[:, at] = clip.confidence[:, group].min(axis=1) < UNSEEN
    swaps = limb_swaps(body)
    body = np.take_along_axis(body, swaps[..., None], axis=1)
    unseen = np.take_along_axis(unseen, swaps, axis=1)
    lost = np.zeros_like(unseen)
    if unseen.any():
        body, lost = _without_unseen(body, unseen, clip.fps)
    missing = np.zeros((len(clip), len(PARTS)), np.bool_)
    for part, (_, middle, end) in enumerate(LIMBS.values(), 1):
        missing[:, part] = lost[:, _JOINT[middle]] | lost[:, _JOINT[end]]
    hands = np.zeros((len(clip), 42, 3), np.float32)
    missing[:, 5:] = True
    place = {name: at for at, name in enumerate(clip.joint_names)}
    for side in (0, 1):
        names = HAND_JOINTS[21 * side : 21 * side + 21]
        if not all(name in place for name in names):
            continue
        group = [place[name] for name in names]
        none = np.zeros(len(clip), np.bool_)
        if clip.confidence is not None:
            none = clip.confidence[:, group].min(axis=1) < UNSEEN
        if not none.all():
            gone = np.repeat(none[:, None], 21, axis=1)
            hand, lost = interpolated(joints[:, group], gone, LONGEST_GAP * clip.fps)
            hands[:, 21 * side : 21 * side + 21], missing[:, 5 + side] = hand, lost[:, 0]
    return body, hands, missing


def _without_unseen(
    body: FloatArray, unseen: BoolArray, fps: float
) -> tuple[FloatArray, BoolArray]:
    """The body without what was not seen, and which joints (T, 15) are lost for longer."""
    body, lost = body.copy(), np.zeros_like(unseen)
    down = np.array([0, -1, 0], np.float32)
    for names in (("lsho", "rsho"), ("lhip", "rhip"), ("head",)):
        at = [_JOINT[name] for name in names]
        none: BoolArray = np.any(unseen[:, at], axis=1)
        if none.mean() <= 0.5:
            gone = np.repeat(none[:, None], len(at), axis=1)
            body[:, at], lost[:, at] = interpolated(body[:, at], gone, LONGEST_GAP * fps)
        elif names[0] == "lsho":
            left, right = body[:, _JOINT["lhip"]], body[:, _JOINT["rhip"]]
            wide = np.median(np.linalg.norm(left - right, axis=-1))
            above = (left + right) / 2 - 2.5 * wide * down
            body[:, at] = np.stack([above + left - right, above + right - left], axis=1)
        elif names[0] == "lhip":
            left, right = body[:, _JOINT["lsho"]], body[:, _JOINT["rsho"]]
            across = (left - right) / 4
            wide = np.median(np.linalg.norm(across, axis=-1))
            middle = (left + right) / 2 + 6 * wide * down
            body[:, at] = np.stack([middle + across, middle - across], axis=1)
        elif names[0] == "head":
            middle = (body[:, _JOINT["lsho"]] + body[:, _JOINT["rsho"]]) / 2
            body[:, at[0]] = middle - down
    for pair, middle in ((("lhip", "rhip"), "pelv"), (("lsho", "rsho"), "neck")):
        body[:, _JOINT[middle]] = body[:, [_JOINT[name] for name in pair]].mean(axis=1)
    for limb in LIMBS.values():
        root, *outer = (_JOINT[name] for name in limb)
        for before, joint in zip((root, *outer), outer, strict=False):
            none, at = unseen[:, [joint]], [joint]
            if none.mean() <= 0.5:
                body[:, at], lost[:, at] = interpolated(body[:, at], none, LONGEST_GAP * fps)
            else:
                body[:, joint], lost[:, joint] = body[:, before] + down, True
    return body, lost
