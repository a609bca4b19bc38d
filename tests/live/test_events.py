from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest

from actioncli.clips.active import active_part
from actioncli.clips.clip import Clip, FloatArray
from actioncli.clips.read import read_clip
from actioncli.clips.skeleton import DEFAULT_JOINTS
from actioncli.clips.view import faces_sensor
from actioncli.errors import SupportError
from actioncli.live.events import AGAIN, ODDS, STRIDE, Event, EventDetector
from actioncli.live.watching import watch
from actioncli.model.config import ModelConfig
from actioncli.model.weights import Weights
from actioncli.recognition.decision import Comparison
from actioncli.recognition.recognizer import Recognizer
from actioncli.recognition.support import SupportSet
from actioncli.recognition.threshold import Threshold

EXAMPLES = Path(__file__).parents[2] / "examples"
# Windows of 22, 32 and 45 frames between the first and the last.
FPS, LENGTHS = 16, (1.4, 1.4 * 2**0.5, 2.8)
SECONDS = 2.0


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


LINE = OnALine(Weights(ModelConfig(), {}, {}, "", Path()))


def at(*places: float) -> FloatArray:
    return np.array(places, np.float32).reshape(-1, 1, 1)


def support_of(
    places: Mapping[str, float], *negatives: float, tau: float = 0.5, seconds: float = SECONDS
) -> SupportSet:
    actions = {label: at(place) for label, place in places.items()}
    thresholds = Threshold(tau, "", {"bow": 0.9})
    durations = dict.fromkeys(actions, seconds)
    return SupportSet(LINE, actions, at(*negatives), durations, thresholds)


def moving(now: float, begins: float = -math.inf, ends: float = math.inf) -> Clip:
    """The last ten seconds of a stream in which somebody moves between two times."""
    times = now - np.arange(10 * FPS + 1)[::-1] / FPS
    swing = np.where((times >= begins) & (times <= ends), np.sin(8 * times), 0)
    joints = np.zeros((len(times), 15, 3), np.float32)
    joints[:] = np.random.default_rng(0).random((15, 3))
    joints[:, DEFAULT_JOINTS.index("lwri"), 1] += swing
    return Clip(joints, DEFAULT_JOINTS, FPS)


class Script:
    """A detector that is told what a look says."""

    def __init__(self, *labels: str, tau: float = 0.5) -> None:
        self.labels = labels
        self.detector = EventDetector(support_of(dict.fromkeys(labels, 0.0), tau=tau))
        assert self.detector.windows == pytest.approx(LENGTHS)
        self.now = 10.0

    def see(
        self,
        sure: Mapping[str, float],
        windows: Sequence[int] = (0, 1, 2),
        clip: Clip | None = None,
    ) -> list[Event]:
        """A look at which these windows have these confidences, and all else none."""
        odds = np.full((3, len(self.labels)), -12.0, np.float32)
        for label, confidence in sure.items():
            odds[list(windows), self.labels.index(label)] = math.log(confidence / (1 - confidence))
        self.now += STRIDE
        return self.detector.take(odds, clip or moving(self.now), self.now)

    def rest(self, looks: int) -> list[Event]:
        return [event for _ in range(looks) for event in self.see({})]


WAVE = {"wave": 0.99}


def test_a_match_is_told_when_it_has_stayed_the_best_for_a_while() -> None:
    script = Script("wave")
    assert script.see(WAVE) == []
    assert script.detector.current is not None
    begun = script.now
    assert script.see({}) == []
    (event,) = script.see({})
    assert script.now - begun == pytest.approx(0.4)
    assert event.label == "wave"
    assert event.end == pytest.approx(begun, abs=0.1)
    assert event.repetitions == 1
    assert script.detector.current is None
    assert script.rest(10) == []


def test_what_is_told_is_the_best_of_what_overlaps() -> None:
    script = Script("wave", "squat")
    for sure in (0.95, 0.97, 0.995, 0.97):
        assert script.see({"wave": sure}) == []
    best = script.now - STRIDE
    (event,) = script.see({"wave": 0.95})
    assert event.end == pytest.approx(best, abs=0.1)
    # Also if it is another action.
    script = Script("wave", "squat")
    script.see({"squat": 0.95})
    script.see({"wave": 0.995})
    assert [event.label for event in script.rest(4)] == ["wave"]


@pytest.mark.parametrize(("label", "tau"), [("wave", 0.5), ("bow", 0.9)])
def test_confidence_must_exceed_the_threshold_of_the_action(label: str, tau: float) -> None:
    odds = ODDS * tau / (1 - tau)
    for factor, count in ((0.99, 0), (1.01, 1)):
        script = Script(label)
        confidence = factor * odds / (1 + factor * odds)
        script.see({label: confidence})
        assert len(script.rest(4)) == count


def test_the_confidence_is_that_of_the_best_window() -> None:
    script = Script("wave")
    script.see({"wave": 0.6}, windows=[0, 2])
    script.see({"wave": 0.9}, windows=[1])
    (event,) = script.rest(3)
    # The price of many looks is in it.
    assert event.confidence == pytest.approx(9 / (9 + ODDS), abs=1e-4)


def test_the_bounds_are_those_of_the_motion() -> None:
    script = Script("wave")
    clip = moving(10.2, 8.6, 9.8)
    script.see(WAVE, windows=[2], clip=clip)
    script.see(WAVE, windows=[2], clip=clip)
    (event,) = script.detector.finish()
    assert (event.start, event.end) == pytest.approx((8.6, 9.8), abs=0.35)


def test_every_repetition_is_an_event_and_counted() -> None:
    script = Script("wave", "squat")
    found = []
    for sure in (WAVE, WAVE, WAVE, {"squat": 0.99}):
        found += script.see(sure, windows=[0])
        found += script.rest(6)
    assert [(event.label, event.repetitions) for event in found] == [
        ("wave", 1), ("wave", 2), ("wave", 3), ("squat", 1),
    ]  # fmt: skip
    assert all(one.end <= other.start for one, other in pairwise(found))
    found = script.see(WAVE, windows=[0]) + script.rest(30)
    found += script.see(WAVE, windows=[0]) + script.rest(6)
    assert [event.repetitions for event in found] == [1, 1]  # too long a rest


def test_a_repetition_needs_less_than_the_first() -> None:
    odds = 0.5 * (AGAIN + ODDS)
    found = []
    script = Script("wave", "squat")
    for sure, rest in ((odds, 6), (0.99 / 0.01, 6), (odds, 20), (odds, 6)):
        found.append(len(script.see({"wave": sure / (1 + sure)}, windows=[0]) + script.rest(rest)))
    assert found == [0, 1, 1, 0]  # the last comes too late
    script.see(WAVE, windows=[0])
    script.rest(6)
    assert script.see({"squat": odds / (1 + odds)}, windows=[0]) + script.rest(6) == []


def test_the_next_event_begins_where_the_last_one_ended() -> None:
    script = Script("wave")
    found = [event for _ in range(30) for event in script.see(WAVE)] + script.detector.finish()
    assert 2 <= len(found) <= 5
    for one, other in pairwise(found):
        assert other.start >= one.end


def test_a_match_that_does_not_overlap_tells_the_one_before() -> None:
    script = Script("wave", "squat")
    script.see(WAVE, windows=[0])
    script.detector._matched = math.inf  # as if looks were that close
    for _ in range(6):
        assert script.see({}) == []
    (event,) = script.see({"squat": 0.99}, windows=[0])
    assert event.label == "wave"
    assert script.detector.current is not None
    assert script.detector.current.label == "squat"
    assert [event.label for event in script.detector.finish()] == ["squat"]
    assert script.detector.finish() == []


def test_nobody_to_be_seen_is_nothing_to_be_found() -> None:
    script = Script("wave")
    script.see(WAVE)
    found = []
    for _ in range(3):
        script.now += STRIDE
        found += script.detector.update(None, script.now)
    assert [event.label for event in found] == ["wave"]
    assert script.detector.ranking == ()


def look(actions: Mapping[str, float], *negatives: float, frames: int = 160) -> FloatArray:
    """At joints that are at x metres at x seconds; the middle of a window is its place."""
    joints = np.zeros((frames, 1, 3))
    joints[:, 0, 0] = 10 - np.arange(frames)[::-1] / FPS
    detector = EventDetector(support_of(actions, *negatives))
    return detector.look(Clip(joints, ["nose"], FPS))


def test_a_look_compares_every_window_with_every_action_and_negative() -> None:
    places = [10 - frames / 2 / FPS for frames in (22, 32, 45)]
    odds = look({"bow": 2.0, "squat": 4.0}, 8.1)
    assert odds.shape == (3, 3)
    for row, place in enumerate(places):
        distance = np.abs(place - np.array([2.0, 4.0, 8.1]))
        assert odds[row] == pytest.approx(-np.log(distance), abs=1e-4)
    exactly = look({"bow": places[0]})
    assert exactly[0, 0] == pytest.approx(math.log(1e6), abs=0.2)


def test_windows_are_looked_at_from_when_they_fit() -> None:
    assert (look({"bow": 10.0}, frames=22) == -12).all()
    odds = look({"bow": 10.0}, frames=23)
    assert (odds[0] > -12).all()
    assert (odds[1:] == -12).all()


def test_windows_without_motion_are_passed_over() -> None:
    joints = np.zeros((160, 1, 3))
    joints[:, 0, 0] = np.minimum(np.arange(160), 136)
    odds = EventDetector(support_of({"bow": 0.0})).look(Clip(joints, ["nose"], FPS))
    assert (odds[:, 0] > -12).tolist() == [False, True, True]


def test_windows_that_are_nearest_to_a_negative_show_no_action() -> None:
    detector = EventDetector(support_of({"bow": 0.0}, 1.0, tau=0.1))
    odds = np.array([[3.0, 4.0]] * 3, np.float32)
    assert detector.take(odds, moving(10), 10.0) == []
    assert detector.ranking == ()
    detector.take(odds[:, ::-1], moving(10.2), 10.2)
    detector.take(odds[:, ::-1], moving(10.4), 10.4)
    assert [seen.label for seen in detector.ranking] == ["bow"]


def test_an_action_is_looked_for_in_windows_of_about_its_length() -> None:
    support = support_of({"bow": 0.0, "squat": 0.0}, tau=0.1)
    short = SupportSet(LINE, support.actions, at(), {"bow": 1.5, "squat": 6.0}, Threshold(0.1, ""))
    detector = EventDetector(short)
    odds = np.full((len(detector.windows), 2), -12.0, np.float32)
    odds[:, 0] = 4
    detector.take(odds, moving(10), 10.0)
    starts = [10 - seen.start for seen in detector.ranking]
    assert 0.7 * 1.5 <= starts[0] <= 1.4 * 1.5
    odds[[0, 1, 2]] = -12
    for look_at in range(4):
        detector.take(odds, moving(10 + look_at), 10.0 + look_at)
    assert detector.ranking == ()


def test_the_ranking_has_the_best_window_of_each_action_surest_first() -> None:
    detector = EventDetector(support_of({"bow": 0.0, "squat": 0.0}))
    odds = np.array([[3, 0], [5, 0], [0, 4]], np.float32)
    for _ in range(3):
        detector.take(odds, moving(10), 10.0)
    bow, squat = detector.ranking
    assert (bow.label, bow.start) == ("bow", pytest.approx(10 - LENGTHS[1]))
    assert (squat.label, squat.start) == ("squat", pytest.approx(10 - LENGTHS[2]))
    assert bow.confidence > squat.confidence


def test_the_stream_is_kept_for_eight_seconds() -> None:
    assert EventDetector(support_of({"bow": 9.0}, seconds=600.0)).windows[-1] == 8


def test_what_is_enrolled_may_change() -> None:
    script = Script("wave", "squat")
    script.see(WAVE)
    script.detector.follow(support_of({"wave": 0.0}))
    assert script.detector.current is not None
    script.detector.follow(support_of({"squat": 0.0}))
    assert script.detector.current is None
    script.labels = ("squat",)
    script.see({"squat": 0.99})
    assert [event.label for event in script.rest(3)] == ["squat"]
    script.detector.follow(support_of({}))
    assert script.detector.update(None, script.now + 1) == []
    assert script.detector.ranking == ()


def turned(clip: Clip, degrees: float) -> Clip:
    """The same, about the vertical."""
    cos, sin = math.cos(math.radians(degrees)), math.sin(math.radians(degrees))
    about = np.array([[cos, 0, sin], [0, 1, 0], [-sin, 0, cos]], np.float32)
    return Clip(clip.joints @ about, clip.joint_names, clip.fps, clip.confidence)


@pytest.mark.parametrize("degrees", [0, 30, -30, 60, -60, 90, 180])
def test_only_what_is_done_while_facing_the_camera_counts_where_that_is_asked(degrees: int) -> None:
    squat = read_clip(EXAMPLES / "squat" / "ada.npz")
    stream = turned(squat, degrees)
    assert faces_sensor(stream) == (abs(degrees) <= 45)
    support = SupportSet.from_clips({"squat": [squat]})
    assert [event.label for event in watch(stream, support)] == ["squat"]
    assert len(list(watch(stream, support, facing=True))) == (abs(degrees) <= 45)


def test_a_clip_is_watched_as_a_recorded_stream() -> None:
    """Two squats between rests are found where they are, and nothing else is."""
    actions = ("squat", "jumping_jack", "kick_right")
    clips = {label: read_clip(EXAMPLES / label / "ada.npz") for label in actions}
    squat = clips["squat"]
    rest = round(1.5 * squat.fps)
    still = [np.repeat(squat.joints[[at]], rest, axis=0) for at in (0, -1)]
    joints = np.concatenate([still[0], squat.joints, still[1], squat.joints, still[1]])
    joints = joints + np.random.default_rng(0).normal(0, 1e-4, joints.shape)
    stream = Clip(joints, squat.joint_names, squat.fps)
    support = SupportSet.from_clips({label: [clip] for label, clip in clips.items()})
    now = 0.0

    def frame(time: float, *_: object) -> None:
        nonlocal now
        now = time

    told = [(event, now) for event in watch(stream, support, on_frame=frame)]
    events = [event for event, _ in told]
    assert [(event.label, event.repetitions) for event in events] == [("squat", 1), ("squat", 2)]
    first, last = active_part(squat)
    for (event, when), begin in zip(told, (1.5, 3 + squat.duration), strict=True):
        assert event.start == pytest.approx(begin + first, abs=0.5)
        assert event.end == pytest.approx(begin + last, abs=0.5)
        assert when - event.end < 1.0
    # Also where the stream begins with the motion.
    moving = watch(Clip(joints[rest:], squat.joint_names, squat.fps), support)
    assert [event.start < 0.5 for event in moving] == [True, False]
    assert list(watch(squat, support, tau=1.0)) == []
    notes: list[str] = []
    assert list(watch(Clip(joints[:12], squat.joint_names, 30), support, note=notes.append)) == []
    assert "less than" in notes[0]
    with pytest.raises(SupportError, match="empty"):
        list(watch(stream, SupportSet.from_clips({})))
