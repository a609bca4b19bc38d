"""Recordings by the thousand: what each file shows becomes a row, on all cores of this machine."""

from __future__ import annotations

from collections.abc import Generator, Iterator
from contextlib import closing
from dataclasses import dataclass, field

from actioncli._version import __version__
from actioncli.archives.processes import ProcessKilledError, cores, in_processes
from actioncli.archives.results import Results, Row, file_named, storable
from actioncli.errors import ActionCliError, ClipError
from actioncli.pose import ReadOptions
from actioncli.pose.read import read_any
from actioncli.recognition.support import SupportSet

# Files whose names are in memory at once.
_WINDOW = 50_000


@dataclass(frozen=True, slots=True, eq=False)
class Task:
    """What decisions depend on; everything a worker needs.

    Attributes:
        support: what is enrolled.
        options: how to read files.
        version: of the actioncli that asks; one worker of another could decide otherwise.
    """

    support: SupportSet
    options: ReadOptions = field(default_factory=ReadOptions)
    version: str = __version__

    def row(self, source: str) -> Row:
        """What a file shows, or why that cannot be said; by the names of `results.COLUMNS`."""
        try:
            clip = read_any(file_named(source), self.options)
            decision = self.support.classify(clip)
        except ActionCliError as error:
            return failed(source, str(error), type(error))
        except Exception as error:  # noqa: BLE001 - one file, whatever it does, ends no archive
            return failed(source, f"{source}: {error} (this is a bug)", type(error))
        start, end = decision.part or (None, None)
        return {
            "source": source,
            "label": decision.label,
            "accepted": decision.accepted,
            "confidence": decision.confidence,
            "tau": decision.tau,
            "nearest": decision.nearest,
            "distance": decision.ranking[0].distance,
            "nearest_negative": decision.nearest_negative,
            "part_start": start,
            "part_end": end,
            "frames": len(clip),
            "seconds": clip.duration,
            "notes": [storable(each) for each in decision.notes],
        }


def failed(source: str, message: str, kind: type[Exception] = ClipError) -> Row:
    """The row of a file that cannot be used."""
    error = storable(" ".join(message.split()))
    return {"source": source, "error_type": kind.__name__, "error": error}


def decide(task: Task, results: Results) -> Generator[Row, None, None]:
    """Classify the files whose rows are missing; a file that kills its process gets a row too.

    Args:
        task: what to decide by.
        results: they are to be given each row before the next one is asked for.
    """
    left: list[str] = []

    def work(number: int) -> Row:
        return task.row(left[number])

    for window in windows(results):
        left = window
        while left:
            done = 0
            with closing(in_processes(work, len(left), cores(), pinned=True)) as rows:
                try:
                    for row in rows:
                        done += 1
                        yield row
                except ProcessKilledError:
                    yield failed(left[done], f"{left[done]}: the process that read it was killed.")
                    done += 1
            left = left[done:]


def windows(results: Results) -> Iterator[list[str]]:
    """The files whose rows are missing, many at a time."""
    after = ""
    while window := results.missing(_WINDOW, after):
        yield window
        after = window[-1]
