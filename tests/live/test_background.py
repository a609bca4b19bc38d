from __future__ import annotations

from pathlib import Path

import pytest

from actioncli import SupportSet, read_clip
from actioncli.errors import ClipError, SupportError
from actioncli.live.background import TAUS, Background, at_most, watch_background
from actioncli.live.events import Event
from actioncli.live.watching import watch
from tests.pose.videos import numbered, write_video

EXAMPLES = Path(__file__).parents[2] / "examples"


def of(*counts: int, hours: float = 1.0) -> Background:
    """With so many events at the lowest thresholds, and none above."""
    events = dict(zip(TAUS, [*counts, *[0] * (len(TAUS) - len(counts))], strict=True))
    return Background(3600 * hours, events, ())


# Garwood's intervals, as tables of the Poisson distribution have them.
@pytest.mark.parametrize(
    ("events", "high"), [(0, 3.6889), (1, 5.5716), (10, 18.3904), (100, 121.6270)]
)
def test_the_interval_is_that_of_the_tables(events: int, high: float) -> None:
    assert at_most(events) == pytest.approx(high, abs=1e-3)


def test_many_events_are_counted_too() -> None:
    assert at_most(5000) == pytest.approx(5000 + 1.96 * 5000**0.5, rel=1e-3)


def test_the_lowest_threshold_from_which_on_few_are_told_is_chosen() -> None:
    assert of().tau(0.5) == 0.5
    assert of(3, 1).tau(0.5) == 0.6
    assert of(3, 1).tau(1) == 0.55
    assert of(0, 3).tau(0.5) == 0.6  # what falls below it by chance is no reason
    assert of(3, 1, hours=4).tau(0.5) == 0.55
    assert of(*[1] * len(TAUS)).tau(0.5) is None


def test_what_the_figures_cannot_tell_is_said() -> None:
    assert of(hours=8).notes(0.5) == []
    (few,) = of(hours=0.5).notes(0.5)
    assert "30.0 minutes are few: it may be up to 7.4 events an hour. 7.4 hours" in few
    (none,) = of(*[1] * len(TAUS)).notes(0.5)
    assert none.startswith("No threshold up to 0.95 holds 0.5 false events an hour.")


def test_it_counts_what_watch_tells() -> None:
    actions = {name: [read_clip(EXAMPLES / name / "ada.npz")] for name in ("squat", "kick_right")}
    support = SupportSet.from_clips(actions)
    clip = read_clip(EXAMPLES / "squat" / "ben.npz")
    found = watch_background(clip, support)
    for tau in TAUS:
        assert found.events[tau] == len(list(watch(clip, support, tau)))
    expected = list(watch(clip, support, TAUS[0]))
    assert [event for event, _ in found.nearest] == expected
    assert [event.label for event in expected] == ["squat"]
    (event, part), seconds = found.nearest[0], found.seconds
    assert isinstance(event, Event)
    assert part.duration == pytest.approx(event.end - event.start, abs=0.1)
    assert seconds == pytest.approx(clip.duration, abs=0.3)
    with pytest.raises(SupportError):
        watch_background(clip, SupportSet.from_clips({}))


def test_where_nobody_is_seen_nothing_can_be_counted(tmp_path: Path) -> None:
    video = write_video(tmp_path / "empty.mp4", numbered(20), 10)
    support = SupportSet.from_clips({"squat": [read_clip(EXAMPLES / "squat" / "ada.npz")]})
    with pytest.raises(ClipError, match=r"empty.mp4: nobody was seen"):
        watch_background(str(video), support)
