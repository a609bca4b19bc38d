"""What commands write: results and JSON on standard output, notes and progress on standard error.

rich is imported only when a progress bar is drawn: importing it takes longer than most commands.
"""

from __future__ import annotations

import contextlib
import errno
import os
import sys
import time
import unicodedata
from collections.abc import Callable, Iterable, Iterator, Sequence, Sized
from typing import TYPE_CHECKING, TypeVar

import typer

from actioncli.errors import ActionCliError
from actioncli.files import json_text

if TYPE_CHECKING:
    from rich.progress import Progress

T = TypeVar("T")

# Also where a file or a user may grow no further; SQLite has codes of its own.
_FULL = {errno.ENOSPC, errno.EDQUOT, errno.EFBIG}
_SQLITE_UNWRITTEN = {13, 778}  # SQLITE_FULL, SQLITE_IOERR_WRITE
# Work that ends sooner needs no progress bar.
_PATIENCE_SECONDS = 2.0


def printable(text: object) -> str:
    """`text` on one line with everything escaped that could steer a terminal.

    File names and labels come from anywhere: escape sequences, line breaks, marks that turn the
    writing direction and bytes that are no UTF-8 are shown as `\\x1b`, `\\u202e` and the like.
    """
    return "".join(c if c.isprintable() else repr(c)[1:-1] for c in str(text))


class OutputError(ActionCliError):
    """The output cannot be written, because a disk is full for example."""

    exit_code = 74


def disk_is_full(error: BaseException | None) -> bool:
    """Whether that is what is behind an error, whatever was to be written."""
    while error is not None:
        if isinstance(error, OSError) and error.errno in _FULL:
            return True
        if getattr(error, "sqlite_errorcode", None) in _SQLITE_UNWRITTEN:
            return True
        error = error.__cause__
    return False


def say(line: str = "", err: bool = False) -> None:
    """Write a line of the result to standard output, or to standard error.

    Raises:
        BrokenPipeError: nobody reads it any more.
        OutputError: it cannot be written.
    """
    try:
        typer.echo(line, err=err)
    except BrokenPipeError:
        raise
    except OSError as error:
        raise OutputError(f"the output cannot be written: {error.strerror}.") from error


def note(line: str) -> None:
    """Write a line that is not the result (a note, a hint, an error) to standard error.

    Raises:
        BrokenPipeError, OutputError: as `say`.
    """
    say(line, err=True)


def write_json(document: object) -> None:
    """Write one JSON document to standard output, as `json_text` has it.

    Only ASCII is written, so that nothing in a label reaches the terminal raw.
    """
    say(json_text(document))


def error_entry(error: BaseException, exit_code: int) -> dict[str, object]:
    """What JSON says about an error; the keys stand in the help of `actioncli`."""
    return {
        "type": type(error).__name__,
        "message": str(error).replace("\n", " "),
        "exit_code": exit_code,
    }


# Colours of a terminal.
GREEN, GREY, BOLD = "32", "90", "1"


def colours() -> bool:
    """Whether standard output shows colours, and the user wants them."""
    dumb = os.environ.get("TERM") == "dumb"
    return sys.stdout.isatty() and "NO_COLOR" not in os.environ and not dumb


def coloured(text: str, colour: str) -> str:
    """Text in a colour, where there are colours."""
    return f"\x1b[{colour}m{text}\x1b[0m" if text and colours() else text


def showable(text: str, otherwise: str) -> str:
    """The first of two texts, if standard output has signs for it."""
    try:
        text.encode(sys.stdout.encoding or "ascii")
    except UnicodeEncodeError:
        return otherwise
    return text


def padded(text: str, width: int) -> str:
    """With spaces behind it, so many columns wide."""
    return text + " " * (width - width_of(text))


def plural(count: int, noun: str) -> str:
    """`1 clip`, `2 clips`."""
    return f"{count} {noun}" if count == 1 else f"{count} {noun}s"


def table(header: Sequence[str], rows: Sequence[Sequence[object]], indent: str = "") -> str:
    """Columns under a header; a column that holds only numbers is flush right.

    Cells go through `printable`; floats are given two decimals.
    """
    right = [
        bool(rows) and all(isinstance(cell, int | float) for cell in column)
        for column in zip(*rows, strict=True)
    ] or [False] * len(header)
    texts = [[f"{c:.2f}" if isinstance(c, float) else printable(c) for c in row] for row in rows]
    lines = [list(header), *texts]
    widths = [max(map(width_of, column)) for column in zip(*lines, strict=True)]
    return "\n".join(
        indent
        + "  ".join(
            " " * (width - width_of(cell)) + cell if flush else padded(cell, width)
            for cell, width, flush in zip(line, widths, right, strict=True)
        ).rstrip()
        for line in lines
    )


def width_of(text: str) -> int:
    """Terminal columns that `text` takes: East Asian wide characters two, combining marks none."""
    return sum(
        0 if unicodedata.combining(c) else 2 if unicodedata.east_asian_width(c) in "WF" else 1
        for c in text
    )


def progress(
    items: Iterable[T], what: str, *, total: int | None = None, shown: bool = True
) -> Iterator[T]:
    """Iterate with a progress bar on standard error, if someone is there to see it.

    It appears when standard error is a terminal and the work has lasted for two seconds, and it
    goes away at the end.

    Args:
        items: what to iterate over.
        what: a word for what is done, shown beside the bar.
        total: how many there are, where `items` has no length.
        shown: False where the results themselves tell how far the work is.
    """
    size = len(items) if isinstance(items, Sized) else total
    with steps(shown=shown) as step:
        for done, item in enumerate(items):
            if step is not None:
                step(what, done, size)
            yield item


@contextlib.contextmanager
def steps(*, shown: bool) -> Iterator[Callable[[str, float, float | None], None] | None]:
    """A progress bar as `progress` has it, for work that tells how far it is.

    Yields:
        What takes a word for what is done, and how much of how much (None: nobody knows); None
        where nobody sees it.
    """
    if not (shown and sys.stderr.isatty()):
        yield None
        return
    begun = time.monotonic()
    bar: Progress | None = None
    task = None

    def step(what: str, done: float, total: float | None) -> None:
        nonlocal bar, task
        if bar is None and time.monotonic() - begun > _PATIENCE_SECONDS:
            from rich.console import Console
            from rich.progress import Progress

            # Standard output is left alone: it may be a file.
            bar = Progress(console=Console(stderr=True), transient=True, redirect_stdout=False)
            task = bar.add_task("", total=None)
        if bar is not None and task is not None:
            from rich.markup import escape

            # A file's name may look like markup.
            bar.update(task, description=escape(printable(what)), completed=done, total=total)
            bar.start()  # once

    try:
        yield step
    finally:
        if bar is not None:
            bar.stop()
