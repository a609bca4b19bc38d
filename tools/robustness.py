"""How accuracy and OSCR fall when queries are recorded worse than the enrolled clips.

    python tools/robustness.py COLLECTION... --splits FILE [--weights FILE] [--episodes 100]

Enrolled clips stay as they are; every query is disturbed. Prints a Markdown table, mean over
collections of 5-way (or all-but-two), 1-shot, cross-person episodes.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable, Mapping, Sequence
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
from monocular import estimated
from numpy.typing import NDArray

from actioncli.clips.clip import Clip, FloatArray
from actioncli.clips.collection import read_collection
from actioncli.clips.prepare import sample
from actioncli.clips.skeleton import DEFAULT_JOINTS, mirrored_columns, select_joints
from actioncli.evaluation.protocol import evaluate
from actioncli.evaluation.splits import read_splits
from actioncli.recognition.decision import Comparison
from actioncli.recognition.recognizer import Recognizer

Disturb = Callable[[FloatArray, float, np.random.Generator], tuple[FloatArray, float]]
_AT = {name: column for column, name in enumerate(DEFAULT_JOINTS)}
_ARM, _LEG = ("sho", "elb", "wri"), ("hip", "kne", "ank")


class Disturbed:
    """A recogniser whose queries went through something; enrolled clips did not."""

    name = "disturbed"

    def __init__(self, recognizer: Recognizer, disturb: Disturb) -> None:
        self._recognizer, self._disturb = recognizer, disturb

    def embed(self, clips: Sequence[Clip]) -> NDArray[Any]:
        """(N, 2, F, E): the clip as it is, and disturbed."""
        views = [clips, [disturbed(clip, self._disturb) for clip in clips]]
        return np.stack([self._recognizer.embed(view) for view in views], axis=1)

    def compare(self, queries: NDArray[Any], support: Mapping[str, NDArray[Any]]) -> Comparison:
        """Disturbed queries against undisturbed actions."""
        clean = {label: examples[:, 0] for label, examples in support.items()}
        return self._recognizer.compare(queries[:, 1], clean)


def disturbed(clip: Clip, disturb: Disturb) -> Clip:
    """What became of a clip, the same at every call."""
    rng = np.random.default_rng(int(np.abs(clip.joints).sum() * 1e3) % 2**32)
    joints = select_joints(clip.joints, clip.joint_names, DEFAULT_JOINTS)
    moved, fps = disturb(joints, clip.fps, rng)
    return Clip(np.asarray(moved, np.float32), DEFAULT_JOINTS, fps)


def turned(degrees: float, axis: int) -> Disturb:
    """About the vertical (axis 1) or about the sensor's x axis (0): a camera high up."""
    angle = np.deg2rad(degrees)
    i, j = [k for k in range(3) if k != axis]
    turn = np.eye(3)
    turn[i, i] = turn[j, j] = np.cos(angle)
    turn[i, j], turn[j, i] = -np.sin(angle), np.sin(angle)
    return lambda joints, fps, rng: (np.asarray(joints @ turn.T, np.float32), fps)


def scaled(factor: float) -> Disturb:
    """Another body size."""
    return lambda joints, fps, rng: (joints * np.float32(factor), fps)


def child() -> Disturb:
    """A child's proportions: 65 % of the size, limbs 15 % shorter still, head larger."""

    def disturb(joints: FloatArray, fps: float, rng: np.random.Generator) -> Any:
        small = joints.copy()
        for side in "lr":
            for chain in (_ARM, _LEG):
                for near, far in pairwise(chain):
                    bone = joints[:, _AT[side + far]] - joints[:, _AT[side + near]]
                    small[:, _AT[side + far]] = small[:, _AT[side + near]] + 0.85 * bone
        head = joints[:, _AT["head"]] - joints[:, _AT["neck"]]
        small[:, _AT["head"]] = small[:, _AT["neck"]] + 1.3 * head
        return 0.65 * small, fps

    return disturb


def mirrored() -> Disturb:
    """The same action by a left-handed performer."""
    swap = mirrored_columns(DEFAULT_JOINTS)
    flip = np.array([-1, 1, 1], np.float32)
    return lambda joints, fps, rng: (joints[:, swap] * flip, fps)


def at_rate(rate: float) -> Disturb:
    """Recorded at another frame rate."""

    def disturb(joints: FloatArray, fps: float, rng: np.random.Generator) -> Any:
        frames = max(3, round((len(joints) - 1) / fps * rate) + 1)
        return sample(joints, frames), rate

    return disturb


def idling(seconds: float) -> Disturb:
    """Standing still before and after, with a little sway."""

    def disturb(joints: FloatArray, fps: float, rng: np.random.Generator) -> Any:
        count = round(seconds * fps)
        sway = 0.005 * np.sin(np.linspace(0, np.pi, count))[:, None, None]
        before = joints[:1] + sway * rng.normal(size=(1, 1, 3))
        after = joints[-1:] + sway * rng.normal(size=(1, 1, 3))
        return np.concatenate([before, joints, after]).astype(np.float32), fps

    return disturb


def missing(share: float) -> Disturb:
    """Joints lost for stretches of about ten frames, then interpolated as the readers do."""

    def disturb(joints: FloatArray, fps: float, rng: np.random.Generator) -> Any:
        filled, time = joints.copy(), np.arange(len(joints))
        for joint in range(joints.shape[1]):
            starts = rng.random(len(joints)) < share / 10
            lost = np.convolve(starts, np.ones(10))[: len(joints)] > 0
            lost[[0, -1]] = False
            for axis in range(3):
                line = np.interp(time[lost], time[~lost], joints[~lost, joint, axis])
                filled[lost, joint, axis] = line
        return filled, fps

    return disturb


def noisy(metres: float) -> Disturb:
    """White noise on every joint of every frame."""
    return lambda joints, fps, rng: (
        (joints + rng.normal(0, metres, joints.shape)).astype(np.float32),
        fps,
    )


def swapped(share: float) -> Disturb:
    """Left and right arm, or leg, exchanged for one stretch of the clip."""

    def disturb(joints: FloatArray, fps: float, rng: np.random.Generator) -> Any:
        count = round(share * len(joints))
        first = int(rng.integers(len(joints) - count + 1))
        chain = (_ARM, _LEG)[int(rng.integers(2))]
        left, right = ([_AT[side + joint] for joint in chain] for side in "lr")
        wrong = joints.copy()
        span = slice(first, first + count)
        wrong[span, left], wrong[span, right] = joints[span, right], joints[span, left]
        return wrong, fps

    return disturb


def unseen(*joints: str, sides: int = 2) -> Disturb:
    """Joints of both sides, or of one side by chance, never seen."""

    def disturb(whole: FloatArray, fps: float, rng: np.random.Generator) -> Any:
        lost = whole.copy()
        for side in rng.permutation(["l", "r"])[:sides]:
            lost[:, [_AT[side + joint] for joint in joints]] = np.nan
        return lost, fps

    return disturb


STUDY: Sequence[tuple[str, Disturb]] = (
    ("as recorded", noisy(0.0)),
    *((f"heading {d}°", turned(d, 1)) for d in (45, 90, 180)),
    *((f"camera {d}° above", turned(d, 0)) for d in (10, 20, 30)),
    ("size 0.6", scaled(0.6)),
    ("size 1.3", scaled(1.3)),
    ("child's proportions", child()),
    ("left-handed (mirrored)", mirrored()),
    *((f"{r} fps", at_rate(r)) for r in (10, 15, 60)),
    *((f"idle {s:g} s before and after", idling(s)) for s in (0.5, 1.0, 2.0)),
    *((f"{round(100 * s)} % of joints missing", missing(s)) for s in (0.05, 0.1, 0.2)),
    *((f"noise of {round(100 * m)} cm", noisy(m)) for m in (0.01, 0.03, 0.05)),
    *((f"limb swapped in {round(100 * s)} % of frames", swapped(s)) for s in (0.1, 0.2, 0.4)),
    ("legs not in view", unseen("kne", "ank")),
    ("one arm hidden", unseen("elb", "wri", sides=1)),
    ("found by a simulated camera", estimated),
)


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("collections", nargs="+", type=Path)
    parser.add_argument("--splits", type=Path, required=True)
    parser.add_argument("--weights", type=Path)
    parser.add_argument("--episodes", type=int, default=100)
    asked = parser.parse_args()
    recognizer = Recognizer(asked.weights)
    collections = [read_collection(path) for path in asked.collections]
    splits = read_splits(asked.splits)
    print("| queries | closed accuracy | AUROC | OSCR |\n| --- | --- | --- | --- |")
    for name, disturb in STUDY:
        scorer = Disturbed(recognizer, disturb)
        mean = evaluate(scorer, collections, episodes=asked.episodes, splits=splits).means[0]
        figures = (mean[key].mean for key in ("closed_set_accuracy", "auroc", "oscr"))
        print(f"| {name} | " + " | ".join(f"{figure:.3f}" for figure in figures) + " |", flush=True)


if __name__ == "__main__":
    main()
