from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
import pytest

from actioncli.clips.checks import findings, is_still, moves, noted, require_usable
from actioncli.clips.clip import Clip
from actioncli.clips.read import read_clip
from actioncli.clips.skeleton import DEFAULT_JOINTS
from actioncli.errors import ClipError
from actioncli.recognition.support import SupportSet

from .bodies import waving

ROOT = Path(__file__).parents[2]
EXAMPLES = sorted((ROOT / "examples").rglob("*.npz"))
Change = Callable[[np.ndarray], np.ndarray]
RNG = np.random.default_rng(0)


def example() -> Clip:
    return read_clip(ROOT / "examples" / "squat" / "ada.npz")


def changed(change: Change, fps: float | None = None) -> Clip:
    clip = example()
    return Clip(change(clip.joints.copy()), clip.joint_names, fps or clip.fps, source="a.npz")


def exchanged(joints: np.ndarray, frames: slice) -> np.ndarray:
    names = example().joint_names
    mirror = [names.index({"l": "r", "r": "l"}.get(n[0], "") + n[1:])
              if {"l": "r", "r": "l"}.get(n[0], "") + n[1:] in names else at
              for at, n in enumerate(names)]  # fmt: skip
    joints[frames] = joints[frames][:, mirror]
    return joints


def about(
    joints: np.ndarray, signs: tuple[int, int, int], order: tuple[int, int, int]
) -> np.ndarray:
    middle = joints.mean(axis=(0, 1))
    return (joints - middle)[..., order] * np.array(signs) + middle


def with_score(joints: np.ndarray, scores: Sequence[float]) -> np.ndarray:
    joints[..., 2] = RNG.choice(scores, joints.shape[:2])
    return joints


def angles(joints: np.ndarray) -> np.ndarray:
    """Between the bones, or what else joins the columns, and the axes."""
    lines = joints - np.roll(joints, 1, axis=1)
    lines /= np.maximum(np.linalg.norm(lines, axis=2, keepdims=True), 1e-6)
    return np.degrees(np.arccos(lines))


def in_picture(joints: np.ndarray, height: float) -> np.ndarray:
    """As a camera sees it, x and y from the upper left corner, z from the hips."""
    return (joints - joints[:, :1]) * [0.75 * height, -height, height] + [0.45, 0.6, 0]


def away(joints: np.ndarray) -> np.ndarray:
    joints[::7] += [3, 0, 0]
    return joints


def held(joints: np.ndarray) -> np.ndarray:
    at = example().joint_names.index("rwri")
    joints[:, at] = joints[0, at]
    return joints


@pytest.mark.parametrize("file", EXAMPLES, ids=lambda file: f"{file.parent.name}-{file.stem}")
def test_recorded_actions_are_what_they_are(file: Path) -> None:
    clip = read_clip(file)
    assert findings(clip) == []
    assert moves(clip)
    assert noted(clip) is clip


@pytest.mark.parametrize(
    ("change", "text", "forbids"),
    [
        (lambda p: p * [1, 1, 0], "no depth", True),
        (lambda p: with_score(p, [0.01, 0.95, 0.99]), "a score or a visibility", True),
        (lambda p: with_score(p, [0.3, 0.5, 0.7, 0.8]), "a score or a visibility", True),
        (lambda p: p * 0.2 + [0.5, 0.5, 3], "as in a picture", True),
        (lambda p: in_picture(p, 0.3), "as in a picture", True),
        (lambda p: in_picture(p, 0.7), "as in a picture", True),
        (angles, "angles", True),
        (lambda p: np.radians(angles(p)), "angles", True),
        (lambda p: p[:, ::-1], "joints under wrong names", True),
        (lambda p: RNG.normal(0, 0.5, p.shape), "bones change their length by", True),
        (lambda p: p[:4], "lasts 0.1 s", True),
        (lambda p: p[:1] + RNG.normal(0, 0.003, p.shape), "nobody moves", True),
        (lambda p: p[:1] + RNG.normal(0, 0.01, p.shape), "nobody moves", True),
        (lambda p: about(p, (-1, -1, 1), (0, 1, 2)), "head is below the feet in 100%", False),
        (lambda p: about(p, (-1, 1, 1), (1, 0, 2)), "lies on its side in 100%", False),
        (lambda p: exchanged(p, slice(None, None, 4)), "are swapped in 2", False),
        (lambda p: exchanged(p, slice(50, None)), "left and right are swapped in", False),
        (away, "joints jump", False),
        (held, "rwri at exactly one place", False),
    ],
)
def test_what_a_recording_cannot_be(change: Change, text: str, forbids: bool) -> None:
    clip = changed(change)
    found = findings(clip)
    assert [each.forbids_enrolment for each in found if text in each.text] == [forbids]
    assert noted(clip).notes == tuple(each.text for each in found)
    assert noted(noted(clip)).notes == noted(clip).notes
    if forbids:
        with pytest.raises(ClipError, match=rf"a\.npz: .*{text}"):
            require_usable(clip)
    else:
        require_usable(clip)


def test_frame_rates_at_which_nobody_moves_so() -> None:
    clip = changed(lambda p: p, fps=3000)
    assert any("m/s: at 3000 frames a second" in each.text for each in findings(clip)) or any(
        "lasts" in each.text for each in findings(clip)
    )
    with pytest.raises(ClipError):
        require_usable(clip)


def test_confidence_of_nothing() -> None:
    clip = example()
    nothing = Clip(clip.joints, clip.joint_names, clip.fps, np.zeros(clip.joints.shape[:2]))
    assert "confidence is 0 for every joint" in findings(nothing)[0].text


def test_a_still_picture_does_not_move_however_long() -> None:
    # Noise of its own: what other tests drew before must not decide.
    noise = np.random.default_rng(0)
    for frames in (8, 60, 600):
        joints = np.repeat(waving()[:1], frames, axis=0)
        joints += noise.normal(0, 0.004, joints.shape)
        assert not moves(Clip(joints, DEFAULT_JOINTS))
    assert moves(Clip(waving(), DEFAULT_JOINTS))


@pytest.mark.parametrize("noise", [0.001, 0.004, 0.008])
def test_a_still_query_is_rejected_whatever_its_score(noise: float) -> None:
    squat = example()
    support = SupportSet.from_clips({"squat": [squat]}, tau=0.0)
    held = np.repeat(squat.joints[:1], 60, axis=0)
    held = held + np.random.default_rng(0).normal(0, noise, held.shape)
    still = Clip(held, squat.joint_names, squat.fps)
    decision = support.classify(still)
    assert is_still(still)
    assert (decision.accepted, decision.notes[-1]) == (False, "nobody moves, so it shows no action")
    assert not is_still(squat)
    assert support.classify(squat).accepted
    # What moves a little, and is seen without noise, moves.
    little = squat.joints.mean(axis=0) + 0.02 * (squat.joints - squat.joints.mean(axis=0))
    assert not is_still(Clip(little, squat.joint_names, squat.fps))


def test_what_was_not_seen_is_no_fault() -> None:
    clip = example()
    joints, confidence = clip.joints.copy(), np.ones(clip.joints.shape[:2], np.float32)
    legs = [at for at, name in enumerate(clip.joint_names) if name[1:] in ("kne", "ank", "hip")]
    joints[:, legs], confidence[:, legs] = np.nan, 0
    unseen = Clip(joints, clip.joint_names, clip.fps, confidence)
    assert [each for each in findings(unseen) if each.forbids_enrolment] == []
    assert moves(unseen)
