from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
import pytest

from actioncli.clips.clip import Clip, FloatArray
from actioncli.clips.read import read_clip
from actioncli.clips.skeleton import DEFAULT_JOINTS
from actioncli.errors import SupportError
from actioncli.live.events import STRIDE, Candidate, Event, EventDetector
from actioncli.live.watching import watch
from actioncli.model.config import ModelConfig
from actioncli.model.weights import Weights
from actioncli.recognition.decision import Comparison
from actioncli.recognition.recognizer import Recognizer
from actioncli.recognition.support import SupportSet
from actioncli.recognition.threshold import Threshold

EXAMPLES = Path(__file__).parents[2] / "examples"


class Scripted(EventDetector):
    """Sees what it is told to see, so that hysteresis can be tested by itself."""

    def __init__(self, tau: float = 0.5) -> None:
        self.windows = (1.0,)
        self._threshold = Threshold(tau, "", {"bow": 0.9})

    def _candidates(self, clip: Clip | None, now: float) -> tuple[Candidate, ...]:
        return self.script

    def run(self, *looks: Sequence[tuple[str, float]]) -> list[Event]:
        found = []
        for n, look in enumerate(looks):
            now = n * STRIDE
            self.script = tuple(Candidate(label, sure, now - 1) for label, sure in look)
            found += self.update(CLIP, now)
        return found + self.finish()

    def see(self, now: float, *sightings: Candidate) -> list[Event]:
        self.script = sightings
        return self.update(CLIP, now)


CLIP = Clip(np.random.default_rng(0).random((5, 15, 3)), DEFAULT_JOINTS)
NOTHING: list[tuple[str, float]] = []


def test_one_performance_is_one_event() -> None:
    wave = [("wave", 0.9)]
    (event,) = Scripted().run(NOTHING, wave, wave, [("wave", 0.45)], wave, *[NOTHING] * 5)
    assert event.label == "wave"
    assert event.confidence == 0.9
    assert event.start == 0  # no earlier than the stream
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


def test_an_event_begins_with_the_second_look_in_a_row() -> None:
    detector = Scripted()
    assert (detector.current, detector.finish()) == (None, [])
    assert detector.see(3.0, Candidate("wave", 0.8, 2.0)) == []
    assert detector.current is None
    assert detector.see(3.25, Candidate("wave", 0.7, 1.5), Candidate("squat", 0.6, 2.0)) == []
    assert detector.current == Event("wave", 1.5, 3.25, 0.8)
    assert detector.finish() == [Event("wave", 1.5, 3.25, 0.8)]
    assert detector.current is None


def test_looks_at_different_actions_are_not_in_a_row() -> None:
    wave, squat = [("wave", 0.9)], [("squat", 0.9)]
    assert Scripted().run(wave, squat, wave, squat, NOTHING, wave, NOTHING, wave) == []


def test_confidence_must_exceed_the_threshold_of_the_action() -> None:
    assert Scripted().run(*[[("wave", 0.5)]] * 6) == []
    assert Scripted().run(*[[("wave", 0.51)]] * 6) != []
    assert Scripted().run(*[[("bow", 0.9)]] * 6) == []
    assert Scripted().run(*[[("bow", 0.91)]] * 6) != []


@pytest.mark.parametrize(("label", "tau"), [("wave", 0.5), ("bow", 0.9)])
def test_an_event_ends_with_the_third_look_that_does_not_hold_it(label: str, tau: float) -> None:
    detector = Scripted()
    high, low = Candidate(label, tau + 0.05, 0), Candidate(label, 0.8 * tau, 0)
    holding = Candidate(label, 0.81 * tau, 0)
    for look in range(5):
        assert detector.see(look, high) == []
    # Every look that holds it starts the count anew, and the end is when it was held last.
    looks = [low, holding, low, low, holding, Candidate(label, tau + 0.08, 0), low, low]
    for look, seen in enumerate(looks, 5):
        assert detector.see(look, seen) == []
    assert detector.current == Event(label, 0, 10, tau + 0.08)
    assert detector.see(20, low) == [Event(label, 0, 10, tau + 0.08)]
    assert detector.current is None
    # The next one begins after it, whatever its window says.
    assert detector.see(21, high) == []
    assert detector.see(22, high) == []
    assert detector.current == Event(label, 10, 22, tau + 0.05)


def test_an_event_is_held_by_its_own_action_only() -> None:
    detector = Scripted()
    wave, squat = Candidate("wave", 0.9, 0), Candidate("squat", 0.6, 0)
    for look in range(3):
        detector.see(look, wave)
    # Not the surest, but sure enough.
    assert detector.see(3, Candidate("bow", 0.89, 0), wave) == []
    assert detector.current == Event("wave", 0, 3, 0.9)
    assert detector.see(4, squat) == []
    assert detector.current == Event("wave", 0, 3, 0.9)
    assert detector.see(5, squat, wave) == [Event("wave", 0, 3, 0.9)]
    assert detector.current == Event("squat", 3, 5, 0.6)


class OnALine(Recognizer):
    """Clips and embeddings are places on a line, and the distance is how far apart they are."""

    def compare(
        self,
        queries: Sequence[Clip] | FloatArray,
        support: Mapping[str, Sequence[Clip] | FloatArray],
    ) -> Comparison:
        places = np.array([clip.joints[0, 0, 0] + clip.duration / 2 for clip in queries])
        distance = abs(places[:, None] - np.array([each.mean() for each in support.values()]))
        confidence = 1 / (1 + distance)
        return Comparison(np.array(list(support)), distance, confidence, confidence)


# Windows of 22, 32 and 45 frames between the first and the last.
FPS, LENGTHS = 16, (1.4, 1.4 * 2**0.5, 2.8)
LINE = OnALine(Weights(ModelConfig(), {}, {}, "", Path()))


def until(now: float, frames: int = 160) -> Clip:
    """Joints that are at x metres at x seconds; the middle of a window is its place."""
    joints = np.zeros((frames, 1, 3))
    joints[:, 0, 0] = now - np.arange(frames)[::-1] / FPS
    return Clip(joints, ["nose"], FPS)


def at(*places: float) -> FloatArray:
    return np.array(places, np.float32).reshape(-1, 1, 1)


def enrolled(
    support: dict[str, FloatArray], tau: float, seconds: float, *negatives: float
) -> SupportSet:
    durations = dict.fromkeys(support, seconds)
    return SupportSet(LINE, support, at(*negatives), durations, Threshold(tau, ""))


def detector_of(
    support: dict[str, FloatArray], tau: float, seconds: float, *negatives: float
) -> EventDetector:
    return EventDetector(enrolled(support, tau, seconds, *negatives))


def spot(actions: dict[str, float], *negatives: float, clip: Clip) -> tuple[Candidate, ...]:
    support = {label: at(place) for label, place in actions.items()}
    detector = detector_of(support, 0.5, 2.0, *negatives)
    assert detector.windows == pytest.approx(LENGTHS)
    assert detector.ranking == ()
    detector.update(clip, 10.0)
    return detector.ranking


def test_a_look_tells_the_best_window_of_each_action_surest_first() -> None:
    # The first and the second window are equally near to bowing, the third is a squat.
    near = (22 + 32) / 4 / FPS
    found = spot({"squat": 10 - 45 / 2 / FPS, "bow": 10 - near, "jump": 2.0}, clip=until(10))
    assert [each.label for each in found] == ["squat", "bow"]
    assert [each.start for each in found] == pytest.approx([10 - LENGTHS[2], 10 - LENGTHS[0]])
    assert [each.confidence for each in found] == pytest.approx([1, 1 / (1 + 10 / 4 / FPS)])
    # A little nearer to the second.
    (bow,) = spot({"bow": 10 - near - 0.01}, clip=until(10))
    assert bow.start == pytest.approx(10 - LENGTHS[1])


def test_windows_are_looked_at_from_when_they_fit() -> None:
    support = {"bow": 10.0, "squat": 8.0}
    assert spot(support, clip=until(10, frames=22)) == ()
    (bow,) = spot(support, clip=until(10, frames=23))
    assert (bow.label, bow.start) == ("bow", pytest.approx(10 - LENGTHS[0]))
    assert bow.confidence == pytest.approx(1 / (1 + 11 / FPS))


def test_windows_without_motion_are_passed_over() -> None:
    moving = until(10).joints.copy()
    moving[-24:] = moving[-24]
    (bow,) = spot({"bow": 0.0}, clip=Clip(moving, ["nose"], FPS))
    assert bow.start == pytest.approx(10 - LENGTHS[2])


def test_windows_that_are_nearest_to_a_negative_show_no_action() -> None:
    first, last = 10 - 11 / FPS, 10 - 45 / 2 / FPS
    found = spot({"bow": first + 0.1, "squat": last}, first, 0.0, clip=until(10))
    assert [each.label for each in found] == ["squat"]


def test_nobody_to_be_seen_is_nothing_to_be_found() -> None:
    detector = detector_of({"bow": at(9.0)}, 0.1, 2.0)
    assert detector.update(until(10), 10.0) == detector.update(until(10.25), 10.25) == []
    assert detector.current is not None
    assert [detector.update(None, 10.5 + look) for look in range(2)] == [[], []]
    assert detector.ranking == ()
    assert detector.update(None, 13.0) != []


def test_what_is_enrolled_meanwhile_is_followed() -> None:
    bow, squat = {"bow": at(9.0)}, {"squat": at(9.0)}
    for later, goes_on in ((bow, True), ({**bow, **squat}, True), (squat, False), ({}, False)):
        detector = detector_of(bow, 0.1, 2.0)
        detector.update(until(10), 10.0)
        detector.follow(enrolled(later, 0.1, 2.0))
        # The first of two looks that begin an event counts where its action is still there.
        detector.update(until(10.25) if later else None, 10.25)
        assert (detector.current is not None) is goes_on
        if goes_on:
            detector.follow(enrolled(later, 0.1, 4.0))
            assert detector.current is not None
            assert detector.windows[-1] == pytest.approx(2 * LENGTHS[2])
            detector.follow(enrolled({}, 0.1, 2.0))
            assert detector.current is None
            assert detector.windows[-1] == pytest.approx(2 * LENGTHS[2])
            assert detector.finish() == []


def test_the_stream_is_kept_for_eight_seconds() -> None:
    assert detector_of({"bow": at(9.0)}, 0.5, 600.0).windows[-1] == 8


def test_a_clip_is_watched_as_a_recorded_stream() -> None:
    """A squat between rests is found where it is, and nothing else is."""
    actions = ("squat", "jumping_jack", "kick_right")
    clips = {label: read_clip(EXAMPLES / label / "ada.npz") for label in actions}
    squat = clips["squat"]
    rest = round(1.5 * squat.fps)
    still = [np.repeat(squat.joints[at : at + 1], rest, axis=0) for at in (0, -1)]
    joints = np.concatenate([still[0], squat.joints, still[1]])
    joints = joints + np.random.default_rng(0).normal(0, 1e-4, joints.shape)
    stream = Clip(joints, squat.joint_names, squat.fps)
    support = SupportSet.from_clips({label: [clip] for label, clip in clips.items()})
    events = list(watch(stream, support))
    assert events == list(watch(stream, support))
    assert [event.label for event in events] == ["squat"]
    assert events[0].start < 1.5 + squat.duration
    assert events[0].end > 1.5
    assert list(watch(stream, support, tau=1.0)) == []
    notes: list[str] = []
    assert list(watch(Clip(joints[:12], squat.joint_names, 30), support, note=notes.append)) == []
    assert "less than" in notes[0]
    with pytest.raises(SupportError, match="empty"):
        list(watch(stream, SupportSet.from_clips({})))
