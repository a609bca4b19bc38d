from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest

from actioncli.clips.clip import Clip
from actioncli.clips.layouts import DEFAULT_JOINTS
from actioncli.clips.read import read_clip
from actioncli.events import STRIDE, Event, Sighting, Spotter
from actioncli.recognizer import Recognizer
from actioncli.threshold import Threshold

EXAMPLES = Path(__file__).parents[1] / "examples"


class Scripted(Spotter):
    """Sees what it is told to see, so that hysteresis can be tested by itself."""

    def __init__(self, tau: float = 0.5) -> None:
        self.windows = (1.0,)
        self.ranking = ()
        self._threshold = Threshold(tau, "")
        self._event = None
        self._rising = []
        self._quiet = 0
        self._last_end = -np.inf

    def _sightings(self, clip: Clip | None, now: float) -> tuple[Sighting, ...]:
        return self.script

    def run(self, *looks: Sequence[tuple[str, float]]) -> list[Event]:
        found = []
        for n, look in enumerate(looks):
            now = n * STRIDE
            self.script = tuple(Sighting(label, sure, now - 1) for label, sure in look)
            found += self.look(CLIP, now)
        return found + self.finish()


CLIP = Clip(np.random.default_rng(0).random((5, 15, 3)), DEFAULT_JOINTS)
NOTHING: list[tuple[str, float]] = []


def test_one_performance_is_one_event() -> None:
    wave = [("wave", 0.9)]
    (event,) = Scripted().run(NOTHING, wave, wave, [("wave", 0.45)], wave, *[NOTHING] * 5)
    assert event.label == "wave"
    assert event.confidence == 0.9
    assert event.start == pytest.approx(0.25 - 1)
    assert event.end == pytest.approx(1.0)


def test_a_single_look_is_no_event() -> None:
    assert Scripted().run([("wave", 0.9)], NOTHING, [("wave", 0.9)], NOTHING) == []


def test_the_threshold_counts() -> None:
    assert Scripted(0.95).run(*[[("wave", 0.9)]] * 6) == []


def test_a_rest_separates_two_performances() -> None:
    wave = [("wave", 0.9)]
    events = Scripted().run(wave, wave, *[NOTHING] * 4, wave, wave, wave)
    assert [event.label for event in events] == ["wave", "wave"]
    assert events[1].start >= events[0].end


def test_another_action_ends_the_first() -> None:
    wave, squat = [("wave", 0.9), ("squat", 0.2)], [("squat", 0.8), ("wave", 0.6)]
    events = Scripted().run(wave, wave, wave, squat, squat, squat)
    assert [event.label for event in events] == ["wave", "squat"]
    assert events[1].start >= events[0].end


def test_a_short_doubt_does_not_end_it() -> None:
    wave, squat = [("wave", 0.9)], [("squat", 0.95), ("wave", 0.6)]
    events = Scripted().run(wave, wave, squat, wave, wave)
    assert [event.label for event in events] == ["wave"]


def test_with_the_shipped_model() -> None:
    """A squat between rests is found where it is, and nothing else is."""
    recognizer = Recognizer()
    squat = read_clip(EXAMPLES / "squat" / "ada.npz")
    support = {
        label: recognizer.embed([read_clip(EXAMPLES / label / "ada.npz")])
        for label in ("squat", "jumping_jack", "kick_right")
    }
    fps = squat.fps
    rest = round(1.5 * fps)
    rng = np.random.default_rng(0)
    still = [np.repeat(squat.joints[at : at + 1], rest, axis=0) for at in (0, -1)]
    joints = np.concatenate([still[0], squat.joints, still[1]])
    joints = joints + rng.normal(0, 1e-4, joints.shape)
    spotter = Spotter(recognizer, support, Threshold(0.5, ""), [squat.duration])
    events: list[Event] = []
    for end in range(round(fps * STRIDE), len(joints), round(fps * STRIDE)):
        clip = Clip(joints[max(0, end - round(6 * fps)) : end], squat.joint_names, fps)
        events += spotter.look(clip, end / fps)
    events += spotter.finish()
    squats = [event for event in events if event.label == "squat"]
    assert len(squats) == 1, events
    assert squats[0].start < 1.5 + squat.duration
    assert squats[0].end > 1.5
