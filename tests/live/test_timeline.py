from __future__ import annotations

import csv
from pathlib import Path

import pytest

from actioncli.errors import UsageError
from actioncli.live.events import Event, Sets
from actioncli.live.timeline import subtitles, table

WAVE = Event("wave, left", 1.0, 2.5, 0.912345)
AGAIN = Event("wave, left", 3.0, 4.5, 0.8, repetitions=2)


def test_a_table_has_a_row_for_each_event(tmp_path: Path) -> None:
    file = tmp_path / "events.csv"
    told = table(file)
    assert file.read_text() == "label,start,end,confidence,repetitions\n"
    told(WAVE)
    told(AGAIN)
    with file.open(newline="") as text:
        rows = list(csv.DictReader(text))
    assert rows[0] == {
        "label": "wave, left", "start": "1.00", "end": "2.50", "confidence": "0.912",
        "repetitions": "1",
    }  # fmt: skip
    assert rows[1]["repetitions"] == "2"


def test_no_label_is_a_formula(tmp_path: Path) -> None:
    table(tmp_path / "events.csv")(Event("=HYPERLINK(A1)", 0.0, 1.0, 0.9))
    assert "\n'=HYPERLINK(A1),0.00" in (tmp_path / "events.csv").read_text()


def test_subtitles_are_those_of_players(tmp_path: Path) -> None:
    file = tmp_path / "events.srt"
    told = subtitles(file)
    told(Event("bow", 3661.0625, 3662.9996, 0.9))
    told(AGAIN)
    first, second = file.read_text().strip().split("\n\n")
    assert first.splitlines() == ["1", "01:01:01,062 --> 01:01:03,000", "bow (0.90)"]
    assert second.splitlines()[0::2] == ["2", "wave, left x2 (0.80)"]


def test_every_event_is_there_once_it_is_told(tmp_path: Path) -> None:
    told = table(tmp_path / "events.csv")
    told(WAVE)
    assert "0.912" in (tmp_path / "events.csv").read_text()
    with pytest.raises(UsageError, match="cannot be written"):
        table(tmp_path / "none" / "events.csv")


def test_repetitions_are_counted() -> None:
    assert (WAVE.counted, AGAIN.counted) == ("wave, left", "wave, left x2")


def test_a_set_is_told_when_it_is_over() -> None:
    sets = Sets()
    assert sets.update([WAVE], 2.9) == []
    assert sets.update([AGAIN], 4.9) == []
    assert sets.update([], 6.0) == []
    (both,) = sets.update([], 12.0)
    assert both == Event("wave, left", 1.0, 4.5, 0.912345, 2)
    assert sets.update([], 30.0) == []


def test_another_action_or_the_end_ends_a_set() -> None:
    sets = Sets()
    bow = Event("bow", 5.0, 6.0, 0.7)
    assert sets.update([WAVE, bow], 6.4) == [WAVE]
    assert sets.finish() == [bow]
    assert sets.finish() == []
