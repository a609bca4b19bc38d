"""What a recording shows of the body: its front, parts out of view, motion that nobody saw.

A pose network gives a place to legs under a desk, too, and moves them as it sees fit.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from actioncli.clips.clip import Clip
from actioncli.clips.parts import UNSEEN
from actioncli.clips.skeleton import (
    DEFAULT_JOINTS,
    LIMBS,
    default_columns,
    headings,
    select_joints,
    torso_length,
)
from actioncli.errors import ClipError

# A part that is seen in a smaller share of the frames is out of view.
LEAST_SEEN = 0.5
# Torso lengths that the middle and the end of a limb go from their mean places: below the first
# a guess trembles; what is seen and goes less than the second may go along (a kick's arms), unless
# it goes twice as far as the guess.
_LEAST_GUESS, _LEAST_SEEN_MOTION = 0.1, 0.3
# Degrees by which who faces the sensor may be turned from it.
FACING = 45.0


def faces_sensor(clip: Clip) -> bool:
    """Whether shoulders and hips are turned to the sensor, on the mean of the clip."""
    names = ("lsho", "rsho", "lhip", "rhip")
    joints = select_joints(clip.filled(), clip.joint_names, names, clip.source)
    heading = float(headings(joints, names, np.array([len(clip)]))[0])
    return abs(heading) <= math.radians(FACING)


def seen_parts(clip: Clip) -> dict[str, float]:
    """The share of the frames in which each limb was seen, by its name in `clips.parts.PARTS`.

    Limbs whose joints the layout lacks are left out.
    """
    columns = default_columns(clip.joint_names)
    return {
        part: _share_seen(clip, (middle, end))
        for part, (_, middle, end) in LIMBS.items()
        if columns.get(middle) and columns.get(end)
    }


def _share_seen(clip: Clip, joints: Sequence[str]) -> float:
    """The share of the frames in which all of some default joints were seen."""
    columns = default_columns(clip.joint_names)
    group = [column for joint in joints for column in columns[joint]]
    seen = np.isfinite(clip.joints[:, group]).all(axis=(1, 2))
    if clip.confidence is not None:
        seen &= clip.confidence[:, group].min(axis=1) >= UNSEEN
    return float(seen.mean())


def view_notes(clip: Clip) -> tuple[str, ...]:
    """What to tell about limbs that are out of view: one sentence, or none."""
    hidden = [part for part, share in seen_parts(clip).items() if share < LEAST_SEEN]
    said = []
    for limb in ("arm", "leg"):
        sides = [part for part in hidden if part.endswith(limb)]
        if len(sides) == 2:
            said.append((f"{limb}s are", f"{limb}s"))
        elif sides:
            said.append((f"{sides[0]} is", sides[0]))
    return tuple(
        f"{what} not in view: actions of the {which} cannot be told apart here"
        for what, which in said
    )


def check_view(clip: Clip) -> None:
    """Refuse a clip in which little moves but what was not seen.

    Raises:
        ClipError: it would be an example of a guess.
    """
    shares = seen_parts(clip)
    hidden = [part for part, share in shares.items() if share < LEAST_SEEN]
    if not hidden:
        return
    motion = _motion(clip)
    most = max(moved for part, moved in motion.items() if part not in hidden)
    bound = max(_LEAST_GUESS, most / 2) if most < _LEAST_SEEN_MOTION else most
    guessed = [part for part in hidden if motion[part] > bound]
    if guessed:
        raise ClipError(
            f"{clip.source}: what moves is guessed: the {' and the '.join(guessed)} "
            f"{'is' if len(guessed) == 1 else 'are'} not in view. Record so that all of the "
            "body that takes part is in the picture."
        )


def _motion(clip: Clip) -> dict[str, float]:
    """How far each limb goes from its mean place about its root, and the neck from its own about
    the pelvis (torso) where the hips were seen: the root of the mean square, torso lengths."""
    names = [name for name in DEFAULT_JOINTS if default_columns(clip.joint_names).get(name)]
    joints = select_joints(clip.filled(), clip.joint_names, names, clip.source)
    ends = {part: limb for part, limb in LIMBS.items() if set(limb) <= set(names)}
    whole = {"pelv", "neck"} <= set(names)
    scale = torso_length(joints, names) if whole else np.float32(0.5)

    def away(root: str, *outer: str) -> float:
        about = joints[:, [names.index(joint) for joint in outer]] - joints[:, [names.index(root)]]
        steps = np.linalg.norm(about - about.mean(axis=0), axis=-1)
        return float(np.sqrt((steps**2).mean()) / scale)

    torso = (
        away("pelv", "neck") if whole and _share_seen(clip, ("lhip", "rhip")) >= LEAST_SEEN else 0.0
    )
    return {"torso": torso, **{part: away(*limb) for part, limb in ends.items()}}
