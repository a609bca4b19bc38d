"""What is enrolled while a stream is watched counts at once; so does what is removed."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from actioncli import Clip, SupportStore, enrol, read_clip, watch
from actioncli.clips.edit import cut
from actioncli.live.events import EventDetector
from actioncli.live.recorder import Recorder
from actioncli.recognition.followed import FollowedSupport
from actioncli.recognition.recognizer import Recognizer
from actioncli.recognition.support import SupportSet
from actioncli.recognition.threshold import Threshold, keep_threshold

EXAMPLES = Path(__file__).parents[2] / "examples"
WAVE, SQUAT = EXAMPLES / "wave_right" / "ada.npz", EXAMPLES / "squat" / "ada.npz"
# Seconds after which the store is changed.
CHANGED = 9.0


@pytest.fixture(scope="module")
def recognizer() -> Recognizer:
    return Recognizer()


@pytest.fixture
def store(tmp_path: Path) -> SupportStore:
    return SupportStore(tmp_path / "support.db")


@pytest.fixture(scope="module")
def waving() -> Clip:
    """Somebody waves for a quarter of a minute."""
    clip = read_clip(EXAMPLES / "wave_right" / "cleo.npz")
    there_and_back = np.concatenate([clip.joints, clip.joints[::-1]])
    times = int(15 * clip.fps / len(there_and_back)) + 1
    return Clip(np.concatenate([there_and_back] * times), clip.joint_names, clip.fps)


def told(
    waving: Clip, store: SupportStore, recognizer: Recognizer, change: Callable[[], object]
) -> tuple[list[str], set[str], list[str]]:
    """The events before a change of the store, what is ranked one second after it, and the events
    from then on."""
    now, ranked = 0.0, set[str]()
    changed: list[float] = []

    def on_frame(time: float, _: object, detector: EventDetector) -> None:
        nonlocal now, ranked
        now = time
        if now >= CHANGED and not changed:
            change()
            changed.append(now)
        if changed and now <= changed[0] + 1:
            ranked = {seen.label for seen in detector.ranking}

    events = watch(waving, FollowedSupport(store, recognizer), on_frame=on_frame)
    found = [(event.label, now) for event in events]
    before = [label for label, when in found if when < CHANGED]
    return before, ranked, [label for label, when in found if when > CHANGED + 1]


def test_an_action_that_is_enrolled(
    waving: Clip, store: SupportStore, recognizer: Recognizer
) -> None:
    enrol(store, recognizer, "squat", [read_clip(SQUAT)])

    def change() -> None:
        enrol(SupportStore(store.path), recognizer, "wave", [read_clip(WAVE)])

    before, ranked, after = told(waving, store, recognizer, change)
    assert before == []
    assert "wave" in ranked
    assert after.count("wave") >= 3


@pytest.mark.parametrize("what", ["nothing", "removed", "negative", "threshold", "nothing is left"])
def test_what_speaks_against_an_action(
    waving: Clip, store: SupportStore, recognizer: Recognizer, what: str
) -> None:
    if what != "nothing is left":
        enrol(store, recognizer, "squat", [read_clip(SQUAT)])
    enrol(store, recognizer, "wave", [read_clip(WAVE)])
    # Of every phase of it, as long as windows are.
    lengths = EventDetector(SupportSet.load(store, recognizer)).windows
    parts = [cut(waving, 3 + n / 5, 3 + n / 5 + long) for n in range(6) for long in lengths]
    changes: dict[str, Callable[[], object]] = {
        "nothing": lambda: None,
        "removed": lambda: store.remove("wave"),
        "negative": lambda: enrol(store, recognizer, "", parts, negative=True),
        "threshold": lambda: keep_threshold(store, Threshold(1.0, recognizer.weights.checksum)),
        "nothing is left": store.clear,
    }
    before, ranked, after = told(waving, store, recognizer, changes[what])
    assert "wave" in before
    if what == "nothing":
        assert after.count("wave") >= 3
    else:
        # A negative speaks against what is nearer to it than to the action, which is most.
        assert after.count("wave") <= (2 if what == "negative" else 0)
    assert ("wave" in ranked) == (what in {"nothing", "threshold"})


def test_a_recorder_goes_by_the_threshold_in_use(
    waving: Clip, store: SupportStore, recognizer: Recognizer, tmp_path: Path
) -> None:
    enrol(store, recognizer, "wave", [read_clip(WAVE)])
    recorder = Recorder(tmp_path / "seen", Threshold(0.5, ""), "a clip")

    def on_frame(now: float, *_: object) -> None:
        if now == 1:
            keep_threshold(store, Threshold(0.25, recognizer.weights.checksum))

    list(watch(waving, FollowedSupport(store, recognizer), recorder=recorder, on_frame=on_frame))
    assert recorder.threshold.tau == 0.25


def test_nothing_is_read_where_nothing_has_changed(
    store: SupportStore, recognizer: Recognizer
) -> None:
    followed = FollowedSupport(store, recognizer)
    assert not followed().actions  # though there is no file yet
    assert followed() is followed()
    enrol(store, recognizer, "wave", [read_clip(WAVE)])
    assert set(followed().actions) == {"wave"}
