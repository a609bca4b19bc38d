"""Clips made of an enrolled clip that show nearly its action, but not the action: how many of them
are accepted.

Where the change leaves the motion as it was, a wave played backwards for instance, it is no other
action, and the clip is not counted: its time warping distance to the original must be more than
half of what performances of one action are apart.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from actioncli.clips.clip import Clip
from actioncli.clips.edit import mirrored
from actioncli.clips.skeleton import LIMBS, default_columns
from actioncli.errors import ClipError
from actioncli.evaluation.baselines import Dtw
from actioncli.evaluation.splits import Splits
from actioncli.evaluation.task import measured
from actioncli.recognition.recognizer import Recognizer

if TYPE_CHECKING:
    from actioncli.clips.collection import Collection

Change = Callable[[Clip, np.random.Generator], Clip]


@dataclass(frozen=True, slots=True)
class Accepted:
    """Of `of` clips of a kind, asked against the one that each was made of or belongs to, the share
    that is accepted."""

    kind: str
    share: float
    of: int


def _frames(clip: Clip, at: NDArray[np.intp]) -> Clip:
    confidence = None if clip.confidence is None else clip.confidence[at]
    return Clip(clip.joints[at], clip.joint_names, clip.fps, confidence, clip.source)


def _blocks(clip: Clip, rng: np.random.Generator) -> Clip:
    blocks, order = np.array_split(np.arange(len(clip)), 4), rng.permutation(4)
    while (order == np.arange(4)).all():
        order = rng.permutation(4)
    return _frames(clip, np.concatenate([blocks[block] for block in order]))


def _standing(clip: Clip, rng: np.random.Generator) -> Clip:
    noise = rng.normal(0, 0.005, clip.joints.shape)
    return Clip(clip.joints[:1] + noise, clip.joint_names, clip.fps, source=clip.source)


def _limb_frozen(clip: Clip, rng: np.random.Generator) -> Clip:
    """The limb that moves most keeps its mean place about the joint that it hangs on."""
    columns = default_columns(clip.joint_names)
    joints = clip.filled().copy()
    relative = {}
    for name, (root, *outer) in LIMBS.items():
        hands = [
            at
            for at, joint in enumerate(clip.joint_names)
            if name.endswith("arm") and joint.startswith(f"{name[0]}hand") and joint[5:].isdigit()
        ]
        moved = [at for joint in outer for at in columns[joint]] + hands
        relative[name] = moved, joints[:, moved] - joints[:, [columns[root][0]]]
    most = max(relative, key=lambda name: float(relative[name][1][:, :2].var(axis=0).sum()))
    moved, about = relative[most]
    joints[:, moved] += about.mean(axis=0) - about
    return Clip(joints, clip.joint_names, clip.fps, clip.confidence, clip.source)


def _flattened(clip: Clip, rng: np.random.Generator) -> Clip:
    joints = clip.joints.copy()
    joints[..., 2] = np.nanmean(joints[..., 2])
    return Clip(joints, clip.joint_names, clip.fps, clip.confidence, clip.source)


CHANGES: Mapping[str, Change] = {
    "played backwards": lambda clip, rng: _frames(clip, np.arange(len(clip))[::-1]),
    "most moving limb frozen": _limb_frozen,
    "standing in the first pose": _standing,
    "four blocks shuffled": _blocks,
    "first quarter": lambda clip, rng: _frames(clip, np.arange(max(3, len(clip) // 4))),
    "left and right exchanged": lambda clip, rng: mirrored(clip),
    "without depth": _flattened,
}


def changed(
    recognizer: Recognizer,
    collections: Sequence[Collection],
    splits: Splits | None = None,
    tau: float = 0.5,
    clips: int = 40,
    seed: int = 0,
) -> list[Accepted]:
    """How many changed clips are accepted as what they were made of, and beside them how many true
    performances are, mean over collections.

    Args:
        splits: ask about its benchmark classes and people only.
        tau: accept means confidence > tau.
        clips: of each collection, at most.
        seed: of the choice of clips and of the changes.
    """
    found: dict[str, list[tuple[float, int]]] = {}
    for collection in collections:
        rng = np.random.default_rng(seed)
        kept = set(measured(collection, splits)[0])
        rows = [row for row in rng.permutation(len(collection)).tolist() if row in kept][:clips]
        for kind, confidence in _asked(recognizer, collection, rows, rng).items():
            if len(confidence):
                share = float((confidence > tau).mean())
                found.setdefault(kind, []).append((share, len(confidence)))
    return [
        Accepted(kind, float(np.mean([share for share, _ in each])), sum(of for _, of in each))
        for kind, each in found.items()
    ]


def _asked(
    recognizer: Recognizer, collection: Collection, rows: Sequence[int], rng: np.random.Generator
) -> dict[str, NDArray[np.float32]]:
    """Confidences of all queries of each kind."""
    clips = [collection.clips[row] for row in rows]
    labels = np.array([collection.labels[row] for row in rows])
    people = np.array([collection.subjects[row] for row in rows])
    warping = Dtw(recognizer.weights.config.preparation)
    frames, embedded = warping.embed(clips), recognizer.embed(clips)
    alone = {str(place): embedded[[place]] for place in range(len(rows))}
    confidence = recognizer.compare(embedded, alone).confidence
    one, other = np.array([*combinations(range(len(rows)), 2)]).T
    same = labels[one] == labels[other]
    apart = warping.compare(frames, {str(k): frames[[k]] for k in range(len(rows))}).distance
    typical = float(np.median(apart[one, other][same])) if same.any() else 0.0
    pairs = confidence[one, other]
    again = same & (people[one] == people[other])
    found = {
        "the same person again": pairs[again],
        "another person": pairs[same & ~again],
        "something else": pairs[~same],
    }
    for kind, change in CHANGES.items():
        asked = []
        for place, clip in enumerate(clips):
            try:
                made = change(clip, rng)
            except ClipError:  # nothing moves in what is left
                continue
            far = warping.compare(warping.embed([made]), {"": frames[[place]]}).distance[0, 0]
            if far > typical / 2:
                example = {"": embedded[[place]]}
                asked.append(recognizer.classify(made, example, durations=()).confidence)
        found[kind] = np.array(asked, np.float32)
    return found
