"""`review`: walk through what `watch --record` kept, and enrol it."""

from __future__ import annotations

import os
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from actioncli.cli.command import Settings, command
from actioncli.cli.output import note, plural, printable, say, write_json
from actioncli.cli.studio import OpenOption, PortOption, review_page
from actioncli.cli.support import draw
from actioncli.errors import ClipError, UsageError

if TYPE_CHECKING:
    from actioncli.live.recorder import Kept

_KEYS = "e enrol, o enrol as another action, n negative, d delete, s skip, q quit"


@command
def review(
    settings: Settings,
    folder: Annotated[Path, typer.Argument(metavar="FOLDER", help="What `watch --record` filled.")],
    page: Annotated[
        bool, typer.Option("--page", help="Walk through them on a page in the browser.")
    ] = False,
    port: PortOption = 0,
    open_page: OpenOption = True,
) -> None:
    """Look through what watch recorded, and enrol it.

    Each event and near miss is drawn with the action that it was taken for, and one key decides.
    What is enrolled or deleted leaves the folder; what is skipped stays. With --json the clips
    are listed, and nothing is asked.

    \b
    e  enrol as another example of the action it was taken for
    o  enrol under another name, which is asked for
    n  enrol as a negative: what looks like this must never be accepted
    d  delete            s  skip            q  quit

    With --page, the clips play on a page that is served on this machine alone, to who has the
    token in its address; the same keys decide, or buttons. Ctrl-C ends it. It needs the extra:
    pip install 'actioncli[studio]'.

    \b
    Examples:
      actioncli review seen          (after: actioncli watch 0 --record seen)
      actioncli review seen --page
      actioncli review seen --json

    \b
    JSON keys:
      clips
      clips[]: file, label, confidence, tau, event, start, end, source
    With --page: address
    """
    if page:
        counted = review_page(settings, folder, port, open_page)
        if not settings.json:
            _summarize(counted)
        return
    if port or not open_page:
        raise UsageError("--port and --no-open belong to --page.")
    from actioncli.live.recorder import kept_clips

    waiting = kept_clips(folder)
    if settings.json:
        write_json({"clips": [kept.to_json() for kept in waiting]})
        return
    if not waiting:
        settings.tell("Nothing waits for review.")
        return
    if not sys.stdin.isatty():
        raise UsageError("nobody can be asked here; --json lists what waits.")
    _summarize(_walk(settings, waiting))


_DONE = {"enroll": "enrolled", "negative": "enrolled as negatives", "delete": "deleted"}
_OF_KEY = {"e": "enroll", "n": "negative", "d": "delete"}


def _summarize(done: Mapping[str, int]) -> None:
    parts = [plural(done[each], "clip") + f" {word}" for each, word in _DONE.items() if done[each]]
    say(", ".join(parts) or "nothing was changed")


def _walk(settings: Settings, waiting: Sequence[Kept]) -> dict[str, int]:
    """Ask about each clip; how many were enrolled, made negatives, and deleted."""
    from actioncli.actions import decide_on, open

    done = dict.fromkeys(_DONE, 0)
    actions = open(settings.store)
    for place, kept in enumerate(waiting, 1):
        try:
            clip = kept.clip()
        except ClipError as unusable:
            note(f"error: {printable(str(unusable))}")
            continue
        what = "event" if kept.event else "near miss"
        say()
        say(
            f"{place} of {len(waiting)}: {what}, {printable(kept.label)}, confidence "
            f"{kept.confidence:.2f}, tau {kept.tau:.2f}, {printable(kept.origin)}"
        )
        draw(clip)
        key = _pressed()
        if key == "q":
            break
        if key == "s":
            continue
        label = kept.label
        if key == "o":
            label, key = typer.prompt("Name of the action", err=True).strip(), "e"
        try:
            told = decide_on(actions, kept, _OF_KEY[key], label)
        except (ClipError, UsageError) as refused:
            note(f"error: {printable(str(refused))}")
            continue
        for line in told:
            settings.tell(f"warning: {printable(line)}")
        done[_OF_KEY[key]] += 1
        if key == "e":
            settings.tell(f"enrolled as {printable(label)}")
    return done


def _pressed() -> str:
    """One of the keys; Escape and the end of input quit."""
    while True:
        typer.echo(f"{_KEYS}: ", nl=False, err=True)
        key = _key().lower()
        typer.echo(key if key.isprintable() else "", err=True)
        if key and key in "eondsq":
            return key
        if key in {"", "\x04", "\x1b"}:
            return "q"


def _key() -> str:
    """The next key, without waiting for the end of a line."""
    try:
        import termios
        import tty
    except ImportError:  # Windows
        return typer.getchar()
    terminal = sys.stdin.fileno()
    before = termios.tcgetattr(terminal)
    try:
        # Now: what was typed ahead counts.
        tty.setcbreak(terminal, termios.TCSANOW)
        return os.read(terminal, 1).decode("ascii", "replace")
    finally:
        termios.tcsetattr(terminal, termios.TCSANOW, before)
