"""Answers for a glance: a decision on one line, short names of files, notes said once."""

from __future__ import annotations

import contextlib
import shutil
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from actioncli.cli.output import (
    BOLD,
    GREEN,
    GREY,
    coloured,
    padded,
    plural,
    printable,
    showable,
    width_of,
)

if TYPE_CHECKING:
    from actioncli.cli.command import Settings
    from actioncli.live.events import Event
    from actioncli.recognition.decision import Decision

# Cells of the bar that shows how sure a decision is.
_CELLS = 12
# Of a decision's threshold: where another action comes nearer to it, the ranking is worth a look.
_CLOSE = 0.5
_REJECTED = "rejected"
# Columns of what stands beside a label in a line; lines with longer labels do not stand below the
# others, so that these fit into the terminal. One of fewer columns than this shows no bar.
_OTHERS = 56
# Names of files that a note lists; of more it tells how many.
_NAMED = 3


def short_names(paths: Iterable[Path | str]) -> dict[Path | str, str]:
    """Of each path as many of its last parts as tell it from the others; other names whole."""
    names = {path: path if isinstance(path, str) else path.name for path in paths}
    files = [path for path in names if isinstance(path, Path)]
    for length in range(2, 1 + max((len(path.parts) for path in files), default=0)):
        count = Counter(names.values())
        for path in files:
            if count[names[path]] > 1:
                names[path] = str(Path(*path.parts[-length:]))
    return names


def verdict_width(labels: Iterable[str]) -> int:
    """Columns that every verdict on these actions fits into, but for very long labels."""
    widest = max(width_of(printable(label)) for label in (_REJECTED, *labels))
    return min(widest, max(_columns() - _OTHERS, len(_REJECTED)))


def _columns() -> int:
    return shutil.get_terminal_size().columns


def line_of(decision: Decision, name: str, width: int) -> str:
    """`✓ wave   ━━━━━━│━━━━━─  0.95 > 0.50  0.0 to 4.2 s  ada.npz`: the verdict, how sure it is
    beside the threshold, where in the clip, and whose.

    Args:
        width: of the verdict, so that lines stand below each other.
    """
    yes = decision.accepted
    verdict = decision.label if yes and decision.label is not None else _REJECTED
    tick, cross, full, rest, mark = list(showable("✓✗━─│", "+x=-|"))
    colour = GREEN if yes else GREY
    filled = round(_CELLS * decision.confidence)
    at = round(_CELLS * decision.tau)
    cells = full * filled + rest * (_CELLS - filled)
    named = padded(printable(verdict), width)
    said = [f"{coloured(tick if yes else cross, colour)} {coloured(named, BOLD if yes else GREY)}"]
    if _columns() >= _OTHERS:
        said.append(coloured(cells[:at], colour) + mark + coloured(cells[at:], colour))
    said.append(decision.comparison.replace("confidence ", "").replace("tau ", ""))
    if decision.part is not None:
        said.append("{:.1f} to {:.1f} s".format(*decision.part))
    said.append(printable(name))
    if decision.negative_is_nearer:
        said.append("(a negative is nearer)")
    elif not yes:
        said.append(f"(nearest {printable(decision.nearest)})")
    return "  ".join(said)


def event_line(event: Event) -> str:
    """`   2.1 s  to    4.2 s  wave x2  (confidence 0.84)`."""
    return (
        f"{event.start:8.1f} s  to {event.end:8.1f} s  {printable(event.counted)}  "
        f"(confidence {event.confidence:.2f})"
    )


def is_close(decision: Decision) -> bool:
    """Whether another action came near to being accepted too."""
    return any(each.confidence > _CLOSE * decision.tau for each in decision.ranking[1:])


@contextlib.contextmanager
def notes_of(
    settings: Settings, names: Mapping[Path | str, str]
) -> Iterator[Callable[[Path | str, Sequence[str]], None]]:
    """At the end, tell what reading clips decided on the way: each thing once, and of which.

    Yields:
        What takes a path and its notes.
    """
    found: dict[str, list[str]] = {}

    def add(path: Path | str, notes: Sequence[str]) -> None:
        for note in notes:
            found.setdefault(note, []).append(names.get(path, str(path)))

    try:
        yield add
    finally:
        for note, clips in found.items():
            of = ", ".join(clips) if len(clips) <= _NAMED else plural(len(clips), "clip")
            settings.tell(f"note: {printable(of)}: {printable(note)}")
