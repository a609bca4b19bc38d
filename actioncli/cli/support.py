"""`list-support`, `show`, `remove`, `rename`, `clear`: look at the support set and tidy it."""

from __future__ import annotations

import shutil
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from actioncli.cli.command import Settings, command
from actioncli.cli.common import check_output
from actioncli.cli.options import ForceOption, complete_label
from actioncli.cli.output import (
    colours,
    plural,
    printable,
    progress,
    say,
    showable,
    table,
    write_json,
)
from actioncli.errors import SupportError, UsageError

if TYPE_CHECKING:
    from actioncli.clips.clip import Clip
    from actioncli.clips.drawing import Theme

LabelArgument = Annotated[
    str, typer.Argument(help="Name of an enrolled action.", autocompletion=complete_label)
]
YesOption = Annotated[bool, typer.Option("--yes", "-y", help="Do not ask.")]


@command
def list_support(settings: Settings) -> None:
    """List the enrolled actions, and the negatives.

    `list` is a short name of this command.

    \b
    Examples:
      actioncli list-support
      actioncli list-support --json

    \b
    JSON keys:
      store, actions
      actions[]: label, negative, examples, seconds, last_added
    """
    with settings.open_store() as store:
        actions = store.actions()
        where = store.path
    if settings.json:
        write_json({"store": str(where), "actions": [action.to_json() for action in actions]})
        return
    for title, negative in (("action", False), ("never accepted", True)):
        rows = [
            (action.label, action.examples, action.seconds, action.last_added)
            for action in actions
            if action.negative == negative
        ]
        if rows:
            say(table((title, "examples", "seconds", "last added"), rows))
    if all(action.negative for action in actions):
        settings.tell("The support set is empty; enrol an action: actioncli enroll LABEL CLIP")


@command
def show(
    settings: Settings,
    label: LabelArgument,
    example: Annotated[
        int | None,
        typer.Option(
            metavar="ID", help="Show only this example.  [default: all]", show_default=False
        ),
    ] = None,
    out: Annotated[
        Path | None,
        typer.Option(
            "--out",
            "-o",
            metavar="FILE",
            help="Draw into a file: .png or .svg, or in motion, up to a minute, .gif or .mp4.",
            show_default=False,
        ),
    ] = None,
    force: ForceOption = False,
    dark: Annotated[
        bool, typer.Option("--dark", help="Draw on dark paper; .svg follows its reader without.")
    ] = False,
) -> None:
    """Show the examples of one action, listed and drawn over time.

    The body's left side is blue, its right side orange. Joints that the source had to guess are
    hollow, and bones between them dotted. Pixels need the extra: pip install 'actioncli[report]'.

    \b
    Examples:
      actioncli show wave
      actioncli show wave -o wave.png
      actioncli show wave --example 3 -o wave.gif --dark

    \b
    JSON keys:
      label, examples, drawn
      examples[]: id, source, frames, joints, fps, seconds, added, note, checksum
    """
    if out is not None:
        from actioncli.report.pictures import check_picture

        check_picture(out)
        check_output(out, force=force)
    with settings.open_store() as store:
        examples = store.examples(label)
        if example is not None:
            examples = [each for each in examples if each.id == example]
            if not examples:
                raise SupportError(
                    f"`{label}` has no example {example}; `actioncli show` lists those it has."
                )
        drawn = out is not None or not (settings.json or settings.quiet)
        clips = [store.clip(each.id) for each in examples] if drawn else []
    if out is not None:
        from actioncli.report.pictures import write_picture

        captions = [f"{each.id}: {printable(each.source)}" for each in examples]
        theme: Theme | None = "dark" if dark else None
        write_picture(
            out,
            printable(label),
            list(zip(captions, clips, strict=True)),
            theme,
            lambda drawings, total: progress(
                drawings, "Drawing", total=total, shown=not settings.quiet
            ),
        )
    if settings.json:
        listed = [each.to_json() for each in examples]
        drawn_in = None if out is None else str(out)
        write_json({"label": label, "examples": listed, "drawn": drawn_in})
        return
    say(f"{printable(label)}: {plural(len(examples), 'example')}")
    columns = ("id", "source", "frames", "joints", "fps", "seconds", "added", "note")
    say(table(columns, [[getattr(each, name) for name in columns] for each in examples]))
    if out is not None:
        settings.tell(f"drawn in {printable(out)}")
        return
    for each, clip in zip(examples, clips, strict=True):
        say()
        say(f"example {each.id}")
        draw(clip)


def draw(clip: Clip) -> None:
    """Print poses of a clip, as wide as the terminal."""
    from actioncli.report.figure import figure
    from actioncli.report.terminal import strip_lines

    columns = shutil.get_terminal_size().columns
    braille = showable("\u28ff\u2594", "") != ""
    for line in strip_lines(figure(clip), columns, colours(), braille):
        say(line)


@command
def remove(
    settings: Settings,
    label: LabelArgument,
    example: Annotated[
        int | None,
        typer.Option(metavar="ID", help="Remove only this example; `show` tells the ids."),
    ] = None,
    yes: YesOption = False,
) -> None:
    """Remove an action, or one of its examples.

    \b
    Examples:
      actioncli remove wave
      actioncli remove wave --example 3 --yes

    \b
    JSON keys:
      label, removed
    """
    with settings.open_store() as store:
        count = len(store.examples(label))
        what = plural(count, "example") if example is None else f"example {example}"
        if not _agreed(settings, yes, f"Remove {what} of {printable(label)}?"):
            return
        removed = store.remove(label, example)
    line = f"{printable(label)}: {plural(removed, 'example')} removed"
    settings.answer({"label": label, "removed": removed}, line)


@command
def rename(
    settings: Settings,
    old: LabelArgument,
    new: Annotated[str, typer.Argument(help="Its new name.")],
) -> None:
    """Give an action another name.

    \b
    Examples:
      actioncli rename wave "wave with the right hand"

    \b
    JSON keys:
      old, new, examples
    """
    from actioncli.recognition.threshold import rename_action

    with settings.open_store() as store:
        examples = rename_action(store, old, new)
    line = f"{printable(old)} is now {printable(new)}"
    settings.answer({"old": old, "new": new, "examples": examples}, line)


@command
def clear(settings: Settings, yes: YesOption = False) -> None:
    """Remove everything from the support set.

    The threshold that `calibrate` kept is forgotten too.

    \b
    Examples:
      actioncli clear
      actioncli clear --yes

    \b
    JSON keys:
      removed
    """
    with settings.open_store() as store:
        count = len(store.examples())
        if not _agreed(settings, yes, f"Remove {plural(count, 'example')}, all there are?"):
            return
        removed = store.clear(settings=True)
    settings.answer({"removed": removed}, f"{plural(removed, 'example')} removed")


def _agreed(settings: Settings, yes: bool, question: str) -> bool:
    """Whether the user wants it; asked only where someone can answer.

    Raises:
        UsageError: nobody can answer and --yes is not given.
    """
    if yes:
        return True
    if settings.json or not sys.stdin.isatty():
        raise UsageError("nobody can be asked here; give --yes to go ahead.")
    if typer.confirm(question, err=True):
        return True
    settings.tell("Nothing was removed.")
    return False
