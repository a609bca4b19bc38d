"""What a recording cannot be: places that are none, bodies that are no body's, pictures that stand.

The limits come from about 12,000 recorded clips of sixteen collections, of which fewer than one
in two hundred is found fault with by each.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from actioncli.clips.clip import Clip
from actioncli.clips.skeleton import BONES, DEFAULT_JOINTS, FloatArray, default_columns, midpoints
from actioncli.clips.view import check_view
from actioncli.errors import ClipError

# Thickness of the body, and the least way of a joint that moves, in torso lengths; pose networks,
# which tell their confidence, see joints move by up to 0.071 in a still picture with noise.
_FLAT, _STILL, _STILL_PICTURE = 0.015, 0.04, 0.08
# A query in which no joint goes further shows no action: of 4,275 recorded actions 4 are so.
_NO_MOTION = 0.05
# White noise takes no smoothed joint further than this, in its own deviation; what moves goes
# further, however little that is.
_NOISE = 4.5
_USUAL_TORSO, _WIDE = 0.5, 1.2
# Seconds over which places are averaged before motion is looked for: it takes noise away.
_SMOOTHING = 0.3
_SHORTEST = 0.2
# Typical change of bones' lengths, and the share of their lengths that are half as long again.
_ELASTIC, _STRETCHED = 0.2, 0.15
# How far bones are from a grown person's proportions, and left ones from right ones, as logarithms
# of ratios: of 6,970 recorded clips 3 are further.
_MISSHAPEN, _LOPSIDED = 0.5, 0.25
# From this change of bones' lengths on, a coordinate that explains none of it is no place.
_UNEXPLAINED = 0.02
# Metres a second of a typical joint, and of the fastest in a frame; the share of such frames.
_TYPICAL_SPEED, _JUMP, _JUMPS = 5.0, 20.0, 0.1
_SWAPS = 0.03
_THROUGHOUT = 0.9
# The cosine from which a line counts as upright, and below which it does not.
_UPRIGHT, _LEVEL = 0.7, 0.6
_NEEDED = "actioncli needs places in space (3D); give it the video, or the 3D output of the tool"


@dataclass(frozen=True, slots=True)
class Finding:
    """What is odd about a recording.

    Attributes:
        text: what was seen, in which share of the frames, and what to do; no full stop.
        forbids_enrolment: whether nothing should be recognised by this recording.
    """

    text: str
    forbids_enrolment: bool = False


def findings(clip: Clip) -> list[Finding]:
    """What is odd about a clip, the worst first; joints that were not seen are left out."""
    body, names = _body(clip.joints, clip.joint_names)
    found = [*not_places(clip.joints, clip.joint_names)]
    if clip.confidence is not None and not clip.confidence.any():
        text = "confidence is 0 for every joint in every frame, so nothing was seen; save it anew"
        found.append(Finding(f"{text}, or without confidence", True))
    if clip.duration < _SHORTEST:
        text = f"lasts {clip.duration:.2g} s, which is no action"
        found.append(Finding(f"{text}; record it whole, or state the frame rate (--fps)", True))
    if not found and _stands(clip):
        found.append(Finding("nobody moves in it; record the action, not a posture", True))
    if len(names) == len(DEFAULT_JOINTS) and not any(each.forbids_enrolment for each in found):
        found.extend(_motion(body, clip.fps))
        found.extend(_posture(body))
        found.extend(_held(body))
    return sorted(found, key=lambda each: not each.forbids_enrolment)


def require_usable(clip: Clip) -> None:
    """Refuse what nothing should be recognised by.

    Raises:
        ClipError: says what was seen, or that what moves was not seen, and what to do.
    """
    for finding in findings(clip):
        if finding.forbids_enrolment:
            raise ClipError(f"{clip.source or 'the clip'}: {finding.text}.")
    check_view(clip)


def noted(clip: Clip) -> Clip:
    """The clip with what is odd about it among its notes."""
    texts = [each.text for each in findings(clip) if each.text not in clip.notes]
    if not texts:
        return clip
    return Clip(
        clip.joints, clip.joint_names, clip.fps, clip.confidence, clip.source,
        (*clip.notes, *texts), clip.start,
    )  # fmt: skip


def moves(clip: Clip) -> bool:
    """Whether any joint goes anywhere: a still picture, or its noise, shows no action."""
    return _goes(clip, _furthest(clip)[0])


def _goes(clip: Clip, way: float) -> bool:
    return way > (_STILL if clip.confidence is None else _STILL_PICTURE)


def _stands(clip: Clip) -> bool:
    """Whether it does not move or is still, for which its course is looked for once."""
    furthest = _furthest(clip)
    return not _goes(clip, furthest[0]) or _is_noise(clip, *furthest)


def is_still(clip: Clip) -> bool:
    """Whether a query is so still that it is rejected, whatever its score: strict on motion where
    `moves` is strict on examples. Without confidence, noise must account for all that moves; pose
    networks' noise is not white."""
    return _is_noise(clip, *_furthest(clip))


def _is_noise(clip: Clip, way: float, course: NDArray[np.float64], width: int) -> bool:
    if way > _NO_MOTION or clip.confidence is not None:
        return way <= _NO_MOTION
    # The median size of the difference of two normal numbers is 0.954 of their deviation.
    steps = np.median(np.abs(np.diff(course, axis=0)), axis=0)
    return bool(way <= _NOISE * np.linalg.norm(steps) / 0.954 / np.sqrt(width))


def _furthest(clip: Clip) -> tuple[float, NDArray[np.float64], int]:
    """How far the joint that goes furthest goes, smoothed, and its course (T, 3) as recorded, both
    in torso lengths; and over how many frames was smoothed."""
    body, names = _body(clip.joints, clip.joint_names)
    places = np.concatenate([clip.joints, body], axis=1).astype(np.float64)
    size = _torso(body, names) or _USUAL_TORSO
    seen: NDArray[np.bool_] = np.isfinite(places[..., 0])
    places = np.where(seen[..., None], places, 0)
    width = min(max(1, round(_SMOOTHING * clip.fps)), len(places))

    def windows(values: NDArray[np.float64]) -> NDArray[np.float64]:
        sums = np.concatenate([np.zeros_like(values[:1]), values.cumsum(axis=0)])
        return np.asarray(sums[width:] - sums[:-width])

    # Only windows in which a joint is seen throughout say where it was.
    whole = windows(seen.astype(np.float64)) > width - 0.5
    mean = np.where(whole[..., None], windows(places) / width, np.nan)
    if len(mean) < 2:  # shorter than a window: from the first frame to the last
        mean, whole = places, seen
    kept = whole.any(axis=0)
    if not kept.any():
        return 0.0, np.zeros((2, 3)), width
    # Where a joint is for most of the time: single frames are noise.
    means = mean[:, kept]
    # numpy walks through every column by itself where NaN are to be left out.
    percentile = np.nanpercentile if np.isnan(means).any() else np.percentile
    low, high = percentile(means, (10, 90), axis=0)
    ways = np.linalg.norm(high - low, axis=1)
    furthest = int(ways.argmax())
    course = places[:, np.flatnonzero(kept)[furthest]] / size
    return float(ways[furthest] / size), course, width


def not_places(joints: FloatArray, names: tuple[str, ...]) -> Iterator[Finding]:
    """What shows that positions (T, J, 3), in any unit and axes, are not those of a body in space.

    Yields:
        One finding at most.
    """
    body, own = _body(joints, names)
    size = _torso(body, own)
    values = joints[np.isfinite(joints).all(axis=2)]
    if size <= 0 or len(own) < 5 or not len(values):
        return
    there = np.isfinite(body)
    centre = np.where(there, body, 0).sum(axis=1) / np.maximum(there.sum(axis=1), 1)
    about = (body - centre[:, None])[there.all(axis=2)].astype(np.float64) / size
    thickness = float(np.sqrt(max(np.linalg.eigvalsh(np.cov(about.T))[0], 0)))
    # Turning the axes may have changed signs.
    low: NDArray[np.bool_] = np.all((values >= 0) & (values <= 1), axis=0)
    within: NDArray[np.bool_] = low | np.all((values <= 0) & (values >= -1), axis=0)
    extreme = ((np.abs(values) >= 0.9) | (np.abs(values) <= 0.1)).mean(axis=0)
    lengths, bones = _bone_lengths(body, own)
    changes, stretched = _elasticity(lengths)
    misshapen, lopsided = _proportions(lengths, bones)
    if thickness < _FLAT:
        text = "has no depth: all joints lie in a plane in 100% of the frames"
    elif thickness > _WIDE:
        text = "the joints lie too far from each other for a body: these may be angles"
    elif (within & (extreme > 0.8)).any():
        text = (
            "one coordinate is a score or a visibility, between 0 and 1 "
            f"({float(extreme[within].max()):.0%} near 0 or 1), and no place"
        )
    elif changes > _UNEXPLAINED and any(
        changes >= _elasticity(_bone_lengths(body * (np.arange(3) != axis), own)[0])[0]
        for axis in np.flatnonzero(within)
    ):
        text = "one coordinate lies between 0 and 1 and is no depth, but a score or a visibility"
    elif within[:2].all() or _in_picture(body, own, size):
        text = "x and y are between 0 and 1, as in a picture, or about it"
    elif misshapen > _MISSHAPEN or lopsided > _LOPSIDED:
        text = "bones are as long as no body's: these may be angles, or joints under wrong names"
    elif changes > _ELASTIC:
        text = (
            f"bones change their length by {changes:.0%} from frame to frame, as no body's do: "
            "these may be angles, pixels or noise"
        )
    else:
        text = ""
    if text:
        yield Finding(f"{text}; {_NEEDED}", True)
    elif stretched > _STRETCHED:
        text = f"bones are half as long again, or half as long, in {stretched:.0%} of the frames"
        yield Finding(f"{text}: joints were mistaken, or two people for one; record it again")


def _motion(body: FloatArray, fps: float) -> Iterator[Finding]:
    # The pelvis, or what is seen most.
    root = int(np.isfinite(body[..., 0]).mean(axis=0).argmax())
    centred = body - body[:, [root]]
    speed = np.linalg.norm(np.diff(centred, axis=0), axis=2) * fps
    seen = speed[np.isfinite(speed)]
    if not seen.size:
        return
    # What the whole body does.
    speed[:, root] = np.linalg.norm(np.diff(body[:, root], axis=0), axis=1) * fps
    typical, jumps = (
        float(np.median(seen)),
        float((np.nan_to_num(speed).max(axis=1) > _JUMP).mean()),
    )
    if typical > _TYPICAL_SPEED:
        text = (
            f"joints move at {typical:.0f} m/s: at {fps:g} frames a second nobody moves like this"
        )
        yield Finding(f"{text}; state the frame rate (--fps), or record it again", True)
    elif jumps > _JUMPS:
        text = f"joints jump (more than {_JUMP:.0f} m/s) in {jumps:.0%} of the frames"
        yield Finding(f"{text}; record it again, or state the frame rate (--fps)", jumps > 0.5)
    left = [at for at, name in enumerate(DEFAULT_JOINTS) if name[0] == "l"]
    right = [at for at, name in enumerate(DEFAULT_JOINTS) if name[0] == "r"]
    ways = [
        sum(np.nan_to_num(np.linalg.norm(centred[1:, to] - centred[:-1, of], axis=2)).sum(axis=1)
            for of, to in pairs)
        for pairs in (((left, left), (right, right)), ((left, right), (right, left)))
    ]  # fmt: skip
    # Each exchange is one from there on; which of the two sides is right nobody knows.
    other = float(np.mean(np.cumsum(ways[1] < 0.5 * ways[0]) % 2))
    if (swapped := min(other, 1 - other)) > _SWAPS:
        text = f"left and right are swapped in {swapped:.0%} of the frames"
        yield Finding(f"{text}; record it again, facing the camera")


def _posture(body: FloatArray) -> Iterator[Finding]:
    at = {name: body[:, column] for column, name in enumerate(DEFAULT_JOINTS)}
    with np.errstate(invalid="ignore", divide="ignore"):
        trunk, whole, across = (
            line[:, 1] / np.linalg.norm(line, axis=1)
            for line in (
                at["neck"] - at["pelv"],
                at["head"] - (at["lank"] + at["rank"]) / 2,
                at["lhip"] - at["rhip"] + at["lsho"] - at["rsho"],
            )
        )
    down = float(((whole < -_UPRIGHT) & (trunk < 0)).mean())
    side = float(((np.abs(across) > _UPRIGHT) & (np.abs(trunk) < _LEVEL)).mean())
    turn = "is the video rotated, or the up axis another (--up)?"
    if down > _THROUGHOUT:
        yield Finding(f"the head is below the feet in {down:.0%} of the frames; {turn}")
    elif side > _THROUGHOUT:
        yield Finding(f"the body lies on its side in {side:.0%} of the frames; {turn}")


def _held(body: FloatArray) -> Iterator[Finding]:
    stands = (np.diff(body, axis=0) == 0).all(axis=2).mean(axis=0) > _THROUGHOUT
    held = [name for name, at_rest in zip(DEFAULT_JOINTS, stands, strict=True) if at_rest]
    # What carries the body may stand.
    if held := [name for name in held if name[1:] in ("kne", "elb", "wri") or name == "head"]:
        text = f"{', '.join(held)} at exactly one place in over {_THROUGHOUT:.0%} of the frames"
        yield Finding(f"{text}: if the tool lost it there, leave it out (NaN)")


def _body(joints: FloatArray, names: tuple[str, ...]) -> tuple[FloatArray, list[str]]:
    """The default joints (T, K, 3) that the names give, and which they are."""
    columns = default_columns(names)
    own = [name for name in DEFAULT_JOINTS if name in columns]
    return midpoints(joints, [columns[name] for name in own]), own


def _torso(body: FloatArray, names: list[str]) -> float:
    """From pelvis to neck, in the unit of the joints; 0 where it is not seen."""
    if "pelv" not in names or "neck" not in names:
        return 0.0
    lengths = np.linalg.norm(body[:, names.index("neck")] - body[:, names.index("pelv")], axis=1)
    lengths = lengths[np.isfinite(lengths)]
    return float(np.median(lengths)) if lengths.size else 0.0


def _in_picture(body: FloatArray, names: list[str], size: float) -> bool:
    """Whether joints are where a picture shows them, from its upper left corner (0, 0) to (1, 1),
    with a depth from the pelvis: who is near reaches beyond. Turning the axes may have changed
    signs."""
    seen = np.any(np.all(np.isfinite(body), axis=2), axis=0)
    at = {name: np.nanmedian(body[:, k], axis=0) for k, name in enumerate(names) if seen[k]}
    if not {"pelv", "neck"} <= at.keys():
        return False
    across, down, depth = at["pelv"]
    head, foot = at.get("head", at["neck"]), at.get("lank", at.get("rank", at["pelv"]))
    return bool(
        size < 1
        and across * down > 0
        and 0.1 < abs(across) < 0.9
        and 0.1 < abs(down) < 1.5
        and abs(depth) < 0.02
        and head[1] / down < foot[1] / down
    )


def _bone_lengths(
    body: FloatArray, names: list[str]
) -> tuple[FloatArray, list[tuple[str, str, float]]]:
    """Lengths (T, B) of the bones that were seen, and which these are."""
    bones = [bone for bone in BONES if bone[0] in names and bone[1] in names]
    ends = [(names.index(child), names.index(parent)) for child, parent, _ in bones]
    lengths = np.linalg.norm(body[:, [a for a, _ in ends]] - body[:, [b for _, b in ends]], axis=2)
    seen = np.isfinite(lengths).any(axis=0)
    return lengths[:, seen], [bone for bone, there in zip(bones, seen, strict=True) if there]


def _elasticity(lengths: FloatArray) -> tuple[float, float]:
    """How much bones typically change their length, and how often they are far from it."""
    usual = np.nanmedian(lengths, axis=0)
    with np.errstate(invalid="ignore", divide="ignore"):
        change = np.abs(lengths / usual - 1)
    change = change[:, usual > 0]
    if not change.size:
        return 0.0, 0.0
    return float(np.median(np.nanmedian(change, axis=0))), float(np.nanmean(change > 0.5))


def _proportions(lengths: FloatArray, bones: list[tuple[str, str, float]]) -> tuple[float, float]:
    """How far bones are from a grown person's proportions, in the mean, and typically the left ones
    from the right ones: logarithms of ratios."""
    usual = {
        child: float(np.log(length / whole))
        for (child, _, whole), length in zip(bones, np.nanmedian(lengths, axis=0), strict=True)
        if length > 0 and child != "head"
    }
    if len(usual) < 4:
        return 0.0, 0.0
    ratios = np.array([*usual.values()])
    sides = [
        abs(usual[n] - usual["r" + n[1:]]) for n in usual if n[0] == "l" and "r" + n[1:] in usual
    ]
    return float(np.abs(ratios - np.median(ratios)).mean()), float(np.median(sides or [0.0]))
