"""A clip as a figure that can be drawn: points, the bones between them, and where the ground is."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from actioncli.clips.clip import Clip, FloatArray
from actioncli.clips.skeleton import (
    BONES,
    HAND_JOINTS,
    HAND_PARENTS,
    Side,
    default_columns,
    side_of,
    turn_to_front,
)

Bone = tuple[int, int, Side]

# Below this confidence a joint is marked as a guess; filled gaps have 0.
SURE = 0.5
# How wide fingers are drawn.
_FINGER = 0.4
# A pelvis that moves less than this (metres) has been taken as the origin of every frame.
_PINNED = 1e-3

_L_R = {"left": "left", "l": "left", "right": "right", "r": "right"}
_FOOT = r"foot|foo|toebase|toes|toe|heel"
_HAND = r"handtip|hand|han|fin|thu|index|pinky"
_TIP = re.compile(
    rf"(?P<before>left|right|l|r)(?:(?P<foot>{_FOOT})|{_HAND})$"
    rf"|(?:(?P<foot2>{_FOOT})|{_HAND})(?P<after>left|right|l|r)$"
)


@dataclass(frozen=True, slots=True, eq=False)
class Figure:
    """A body in motion, turned to the viewer and put on the ground.

    Attributes:
        points: (T, P, 3) float32 metres, y up with the ground at 0, z away from the viewer.
        sure: (T, P) bool, False where the source had to guess the point.
        names: P names; those of the default joints are first.
        bones: indices of two points, and the side of the body that they belong to.
        fps: frames per second.
    """

    points: FloatArray
    sure: NDArray[np.bool_]
    names: tuple[str, ...]
    bones: tuple[Bone, ...]
    fps: float

    def stroke(self, bone: Bone) -> float:
        """How wide a bone is drawn: 1, but for a finger's."""
        return _FINGER if self.names[bone[1]] in HAND_JOINTS else 1.0

    @property
    def duration(self) -> float:
        """Seconds from the first frame to the last."""
        return (len(self.points) - 1) / self.fps

    @property
    def head(self) -> int | None:
        """Index of the head, if there is one."""
        return self.names.index("head") if "head" in self.names else None

    @property
    def telling(self) -> int:
        """Index of the frame that shows most of the action: the farthest, wherever the body went,
        from the first and the last, in which most people stand."""
        body = self.points.copy()
        body[..., [0, 2]] -= body[..., [0, 2]].mean(axis=1, keepdims=True)
        away = [np.linalg.norm(body - body[end], axis=2).mean(axis=1) for end in (0, -1)]
        return int(np.sum(away, axis=0).argmax())

    def at(self, seconds: float) -> int:
        """Frame that is shown `seconds` after the start; the last one from the end on."""
        return min(round(seconds * self.fps), len(self.points) - 1)


def figure(clip: Clip) -> Figure:
    """The figure of a clip: its default joints, and hands and feet where the layout has them.

    A hand with fingers lies in the wrist while it is not seen.

    Whichever way the person faced, the figure faces the viewer; who lies, or leans on the hands as
    in a push-up, is seen from the side. A clip whose pelvis never moves was centred by its source;
    its figure stands on the lowest point of each frame, any other on the lowest of the whole clip.
    """
    columns = dict(default_columns(clip.joint_names))
    body = tuple(columns)
    bones = [
        (body.index(parent), body.index(child), side_of(child))
        for child, parent, _ in BONES
        if child in columns and parent in columns
    ]
    hands = _hands(clip)
    for name, joint, side in _tips(clip.joint_names):
        column = clip.joint_names.index(name)
        if joint in columns and column not in columns[joint] and joint not in hands:
            bones.append((body.index(joint), len(columns), side))
            columns[name] = (column,)
    for wrist, own in hands.items():
        first = len(columns)
        columns |= {clip.joint_names[column]: (column,) for column in own}
        bones += [
            (first + parent, first + joint, side_of(wrist))
            for joint, parent in enumerate(HAND_PARENTS, 1)
        ]
    if not columns:
        columns = {name: (column,) for column, name in enumerate(clip.joint_names)}
    names = tuple(columns)
    joints = clip.filled()
    points = np.stack([joints[:, list(c)].mean(axis=1) for c in columns.values()], axis=1)
    sure = np.ones(points.shape[:2], np.bool_)
    if clip.confidence is not None:
        sure = np.stack(
            [clip.confidence[:, list(c)].min(axis=1) >= SURE for c in columns.values()], axis=1
        )
    for wrist, own in hands.items():
        first = names.index(clip.joint_names[own[0]])
        gone = np.isnan(clip.joints[:, own[0], 0])
        points[gone, first : first + len(own)] = points[gone, None, names.index(wrist)]
        sure[:, first : first + len(own)] = True
    if {"lhip", "rhip", "lsho", "rsho"} <= columns.keys():
        points = turn_to_front(points, names)
        trunk = np.abs(points[:, names.index("lsho")] - points[:, names.index("lhip")])
        if np.median(trunk[:, 1] - trunk[:, 2]) < 0:
            points = points[..., [2, 1, 0]] * np.array([-1, 1, 1], np.float32)
    return Figure(_grounded(points, names), sure, names, tuple(bones), clip.fps)


def project(points: FloatArray, yaw: float = 0.35, pitch: float = 0.12) -> FloatArray:
    """Orthographic view of points (..., 3), as (..., 2): right and up in the picture.

    Args:
        points: metres, y up, z away from the viewer.
        yaw: radians that the figure is turned to its right about the vertical.
        pitch: radians from which the viewer looks down.
    """
    x, y, z = points[..., 0], points[..., 1], points[..., 2]
    # With y up and z away from the viewer, x points to the left of the picture.
    right = -x * np.cos(yaw) - z * np.sin(yaw)
    away = z * np.cos(yaw) - x * np.sin(yaw)
    up = y * np.cos(pitch) + away * np.sin(pitch)
    return np.stack([right, up], axis=-1)


def _grounded(points: FloatArray, names: Sequence[str]) -> FloatArray:
    lowest = points[..., 1].min(axis=1)
    ground = np.full(len(points), lowest.min(), np.float32)
    centre = points.mean(axis=1)
    if "pelv" in names:
        pelvis = points[:, names.index("pelv")]
        centre = pelvis
        if np.ptp(pelvis, axis=0).max() < _PINNED:
            ground = lowest
    middle = (centre.min(axis=0) + centre.max(axis=0)) / 2
    moved = points - middle
    moved[..., 1] = points[..., 1] - ground[:, None]
    return np.asarray(moved, np.float32)


def _hands(clip: Clip) -> dict[str, list[int]]:
    """The columns of each hand that is ever seen, by the wrist that it hangs on."""
    found, columns = {}, default_columns(clip.joint_names)
    for wrist, own in (("lwri", HAND_JOINTS[:21]), ("rwri", HAND_JOINTS[21:])):
        if wrist in columns and set(own) <= set(clip.joint_names):
            hand = [clip.joint_names.index(name) for name in own]
            if np.isfinite(clip.joints[:, hand]).any():
                found[wrist] = hand
    return found


def _tips(names: Sequence[str]) -> list[tuple[str, str, Side]]:
    """Hands, fingers and feet: name, the default joint that they hang on, side."""
    found: list[tuple[str, str, Side]] = []
    for name in names:
        folded = "".join(c for c in name.rpartition(":")[2].lower() if c.isalnum())
        match = _TIP.search(folded)
        if match:
            side: Side = "left" if _L_R[match["before"] or match["after"]] == "left" else "right"
            limb = "ank" if match["foot"] or match["foot2"] else "wri"
            found.append((name, side[0] + limb, side))
    return found
