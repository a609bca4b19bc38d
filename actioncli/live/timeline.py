"""Events as they come, in a table or as subtitles. Every event is in the file once it is told."""

from __future__ import annotations

import csv
import io
from collections.abc import Callable
from pathlib import Path

from actioncli.errors import UsageError
from actioncli.files import csv_cell
from actioncli.live.events import Event
from actioncli.live.reactions import Reaction


class Timeline(Reaction):
    """A file that grows by an event at a time."""

    def __init__(self, file: Path, text: Callable[[Event, int], str], head: str = "") -> None:
        """Begin the file, in place of one that stands there.

        Args:
            text: what stands in the file of the event with a number, from 1.
            head: what stands before them.

        Raises:
            UsageError: it cannot be written.
        """
        self._file, self._text, self._count = file, text, 0
        self._write(head, "w")

    def __call__(self, event: Event) -> None:
        """Add it.

        Raises:
            UsageError: the file cannot be written.
        """
        self._count += 1
        self._write(self._text(event, self._count), "a")

    def _write(self, text: str, mode: str) -> None:
        try:
            with self._file.open(mode, encoding="utf-8", newline="") as file:
                file.write(text)
        except OSError as error:
            raise UsageError(f"{self._file}: cannot be written: {error.strerror}.") from error


def table(file: Path) -> Timeline:
    """Comma-separated values, a row an event, with seconds to the hundredth."""

    def text(event: Event, number: int) -> str:
        row = io.StringIO()
        times = (f"{event.start:.2f}", f"{event.end:.2f}")
        columns = (csv_cell(event.label), *times, f"{event.confidence:.3f}", event.repetitions)
        csv.writer(row).writerow(columns)
        return row.getvalue()

    return Timeline(file, text, "label,start,end,confidence,repetitions\r\n")


def subtitles(file: Path) -> Timeline:
    """SubRip, which players show over the video."""

    def text(event: Event, number: int) -> str:
        span = f"{_clock(event.start)} --> {_clock(event.end)}"
        return f"{number}\r\n{span}\r\n{event.counted} ({event.confidence:.2f})\r\n\r\n"

    return Timeline(file, text)


def _clock(seconds: float) -> str:
    whole = max(round(seconds * 1000), 0)
    hours, minutes = divmod(whole // 60_000, 60)
    return f"{hours:02}:{minutes:02}:{whole // 1000 % 60:02},{whole % 1000:03}"
