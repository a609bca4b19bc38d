from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from actioncli.calibration.enrolment import enrol
from actioncli.clips.clip import Clip
from actioncli.clips.read import read_clip
from actioncli.clips.view import check_view, seen_parts, view_notes
from actioncli.errors import ClipError
from actioncli.recognition.recognizer import Recognizer
from actioncli.recognition.support import SupportSet
from actioncli.store.store import SupportStore

EXAMPLES = Path(__file__).parents[2] / "examples"


def at_a_desk(name: str, moved: float) -> Clip:
    """An example with the legs out of the picture, their guessed motion a share of the real one."""
    clip = read_clip(EXAMPLES / f"{name}.npz")
    legs = [i for i, joint in enumerate(clip.joint_names) if joint[1:] in {"kne", "ank"}]
    joints = clip.joints.copy()
    hips = joints[:, [clip.joint_names.index("lhip")]]
    about = joints[:, legs] - hips
    joints[:, legs] = hips + about.mean(axis=0) + moved * (about - about.mean(axis=0))
    confidence = np.ones(joints.shape[:2], np.float32)
    confidence[:, legs] = 0.02
    return Clip(joints, clip.joint_names, clip.fps, confidence, name)


def test_who_stands_in_full_view_gets_no_word() -> None:
    clip = read_clip(EXAMPLES / "kick_right" / "ada.npz")
    assert set(seen_parts(clip).values()) == {1.0}
    assert view_notes(clip) == ()
    check_view(clip)


def test_one_leg_out_of_view_is_named() -> None:
    clip = at_a_desk("wave_right/ada", 1.0)
    confidence = np.array(clip.confidence)
    confidence[:, [clip.joint_names.index(joint) for joint in ("lkne", "lank")]] = 1
    clip = Clip(clip.joints, clip.joint_names, clip.fps, confidence)
    assert view_notes(clip) == (
        "right leg is not in view: actions of the right leg cannot be told apart here",
    )


def test_a_kick_at_a_desk_is_refused_and_a_wave_is_not(tmp_path: Path) -> None:
    store, recognizer = SupportStore(tmp_path / "support.db"), Recognizer()
    kick, wave = at_a_desk("kick_right/ada", 1.0), at_a_desk("wave_right/ada", 1.0)
    with pytest.raises(ClipError, match="what moves is guessed: the right leg is not in view"):
        enrol(store, recognizer, "kick", [kick])
    (enrolled,) = enrol(store, recognizer, "wave", [wave])
    told = "legs are not in view: actions of the legs cannot be told apart here"
    assert enrolled.warnings == (told,)
    assert told in SupportSet.load(store, recognizer).classify(kick).notes
    enrol(store, recognizer, "", [kick], negative=True)


def test_what_moves_beside_the_guess_decides() -> None:
    check_view(at_a_desk("kick_right/ada", 0.1))
    check_view(at_a_desk("jumping_jack/ada", 1.0))
