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
CHANGED = 6.0


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


def current(
    waving: Clip, store: SupportStore, recognizer: Recognizer, change: Callable[[], object]
) -> tuple[list[str | None], list[str | None]]:
    """What is going on in the two seconds before a change of the store, and from one second after
    it on."""
    before: list[str | None] = []
    after: list[str | None] = []
    changed: list[float] = []

    def on_frame(now: float, _: object, detector: EventDetector) -> None:
        if now >= CHANGED and not changed:
            change()
            changed.append(now)
        label = detector.current and detector.current.label
        if CHANGED - 2 < now < CHANGED:
            before.append(label)
        elif changed and now > changed[0] + 1:
            after.append(label)

    list(watch(waving, FollowedSupport(store, recognizer), on_frame=on_frame))
    return before, after


def test_an_action_that_is_enrolled(
    waving: Clip, store: SupportStore, recognizer: Recognizer
) -> None:
    enrol(store, recognizer, "squat", [read_clip(SQUAT)])

    def change() -> None:
        enrol(SupportStore(store.path), recognizer, "wave", [read_clip(WAVE)])

    before, after = current(waving, store, recognizer, change)
    assert set(before) == {None}
    assert "wave" in after[: round(waving.fps)]


@pytest.mark.parametrize("what", ["removed", "negative", "threshold", "nothing is left"])
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
        "removed": lambda: store.remove("wave"),
        "negative": lambda: enrol(store, recognizer, "", parts, negative=True),
        "threshold": lambda: keep_threshold(store, Threshold(1.0, recognizer.weights.checksum)),
        "nothing is left": store.clear,
    }
    before, after = current(waving, store, recognizer, changes[what])
    assert before.count("wave") > 0.5 * len(before)
    # A negative speaks against what is nearer to it than to the action, which is most.
    assert after.count("wave") <= (0.3 if what == "negative" else 0) * len(after)


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
