"""What a recorder keeps of a stream, and how it is found again."""

import json
from pathlib import Path

import numpy as np
import pytest
from report.test_figure import standing

from actioncli import Clip, ClipError, UsageError
from actioncli.clips.skeleton import LAYOUTS
from actioncli.live.events import Candidate, Event
from actioncli.live.recorder import Kept, Recorder, kept_clips
from actioncli.recognition.threshold import Threshold
from tests.forking import files_up_to

NAMES = LAYOUTS["default_15"]
RATE = 10.0
STRIDE = 0.25


def stream(now: float, seconds: float = 5) -> Clip:
    """The last seconds of a stream in which a hand moves 0.1 m a second."""
    times = np.arange(max(0.0, now - seconds), now + 1e-6, 1 / RATE)
    times += now - times[-1]
    joints = standing(len(times))
    joints[:, NAMES.index("rwri"), 1] = 0.1 * times
    return Clip(joints, NAMES, RATE, np.full(joints.shape[:2], 0.9))


def run(recorder: Recorder, looks: list[tuple[float | None, bool, list[Event]]]) -> None:
    """Feed looks: confidence of `wave` (None: nobody), whether an event goes on, what ended."""
    for number, (confidence, busy, events) in enumerate(looks):
        now = 2 + number * STRIDE
        seen = [] if confidence is None else [Candidate("wave", confidence, now - 1)]
        clip = None if confidence is None else stream(now)
        recorder.update(clip, now, seen, events, busy)
    recorder.finish([])


def recorder(folder: Path) -> Recorder:
    return Recorder(folder, Threshold(0.5, "", {"jump": 0.9}), "camera 0")


def keep(folder: Path, label: str = "wave", confidence: float = 0.9) -> None:
    """Record an event."""
    recorder(folder).update(stream(2), 2, [], [Event(label, 1, 2, confidence)], False)


def told(kept: Kept) -> tuple[float, float]:
    """When the clip begins and ends."""
    heights = 10 * kept.clip().joints[:, NAMES.index("rwri"), 1]
    return float(heights[0]), float(heights[-1])


def test_an_event_is_kept_from_beginning_to_end(tmp_path: Path) -> None:
    event = Event("wave", 2.5, 4.0, 0.93)
    quiet = [(0.1, True, [])] * 10
    run(recorder(tmp_path), [*quiet, (0.1, False, [event]), (0.1, False, [])])
    [kept] = kept_clips(tmp_path)
    assert (kept.label, kept.event, kept.tau, kept.source) == ("wave", True, 0.5, "camera 0")
    assert kept.confidence == pytest.approx(0.93)
    assert told(kept) == (pytest.approx(2.5, abs=0.06), pytest.approx(4.0, abs=0.06))
    assert kept.clip().confidence is not None


def test_a_stretch_near_tau_is_one_near_miss_of_its_nearest_window(tmp_path: Path) -> None:
    far = (0.1, False, [])
    looks = [far, (0.42, False, []), (0.47, False, []), (0.2, False, []), (0.41, False, [])]
    run(recorder(tmp_path), [*looks, far, far, far, far, (0.45, False, [])])
    first, second = kept_clips(tmp_path)
    assert (first.event, first.confidence) == (False, pytest.approx(0.47))
    assert told(first) == (pytest.approx(1.5, abs=0.06), pytest.approx(2.5, abs=0.06))
    # The end of the stream ends the second one.
    assert second.confidence == pytest.approx(0.45)


def test_what_leads_to_an_event_or_follows_it_is_no_near_miss(tmp_path: Path) -> None:
    event = Event("wave", 1.5, 2.75, 0.8)
    looks = [(0.45, False, []), (0.8, False, []), (0.8, True, []), (0.8, True, [])]
    run(recorder(tmp_path), [*looks, (0.45, False, [event]), *[(0.45, False, [])] * 2])
    assert [kept.event for kept in kept_clips(tmp_path)] == [True]


def test_neither_far_misses_nor_an_empty_room_are_kept(tmp_path: Path) -> None:
    run(recorder(tmp_path), [(0.3, False, []), (None, False, []), (0.7, False, [])] * 3)
    assert kept_clips(tmp_path) == []


def test_the_threshold_of_the_action_counts(tmp_path: Path) -> None:
    kept = recorder(tmp_path)
    kept.update(stream(2), 2, [Candidate("jump", 0.85, 1)], [], False)
    kept.finish([])
    [found] = kept_clips(tmp_path)
    assert (found.tau, found.label) == (0.9, "jump")


def test_later_recordings_go_beside_earlier_ones(tmp_path: Path) -> None:
    for label in ("wave", "../../évil name"):
        keep(tmp_path / "deep" / "folder", label)
    found = kept_clips(tmp_path / "deep" / "folder")
    assert [kept.label for kept in found] == ["wave", "../../évil name"]
    assert {path.parent for path in tmp_path.rglob("*.npz")} == {tmp_path / "deep" / "folder"}
    found[0].forget()
    assert len(kept_clips(tmp_path / "deep" / "folder")) == 1
    assert len(list((tmp_path / "deep" / "folder").iterdir())) == 2


def test_nothing_is_written_over_after_ten_thousand_clips(tmp_path: Path) -> None:
    (tmp_path / "9999_wave.npz").touch()
    for _ in range(3):
        keep(tmp_path)
    names = [kept.file.name for kept in kept_clips(tmp_path)]
    assert names == ["10000_wave.npz", "10001_wave.npz", "10002_wave.npz"]


def test_two_may_record_into_one_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    with monkeypatch.context() as patch:
        # As where the other one's clip appears after this one has looked.
        patch.setattr("actioncli.live.recorder._number", lambda _: 0)
        for confidence in (0.8, 0.9):
            keep(tmp_path, confidence=confidence)
    assert [kept.confidence for kept in kept_clips(tmp_path)] == [0.8, 0.9]


@pytest.mark.parametrize("most", [0, 1500])
def test_a_full_disk_is_told_and_leaves_nothing(tmp_path: Path, most: int) -> None:
    with files_up_to(most), pytest.raises(ClipError, match="cannot be written"):
        keep(tmp_path, "wave" * 400)
    assert list(tmp_path.iterdir()) == []
    keep(tmp_path)
    assert len(kept_clips(tmp_path)) == 1


@pytest.mark.parametrize("number", ["NaN", "Infinity", "1e999"])
def test_a_confidence_that_is_no_number_is_damage(tmp_path: Path, number: str) -> None:
    keep(tmp_path)
    [description] = tmp_path.glob("*.json")
    description.write_text(description.read_text().replace("0.9", number))
    with pytest.raises(UsageError, match=r"damaged \(ValueError: (nan|inf) is no finite number"):
        kept_clips(tmp_path)


def test_damage_and_absence_are_told(tmp_path: Path) -> None:
    with pytest.raises(UsageError, match="no such folder"):
        kept_clips(tmp_path / "none")
    (tmp_path / "0001_wave.npz").touch()
    (tmp_path / "0001_wave.json").write_text(json.dumps({"label": "wave"}))
    with pytest.raises(UsageError, match=r"0001_wave\.json: damaged"):
        kept_clips(tmp_path)
    (tmp_path / "file").touch()
    with pytest.raises(UsageError, match="cannot be made"):
        recorder(tmp_path / "file")
