"""`list-support`, `show`, `remove`, `rename`, `clear`: look at the support set and tidy it."""

from __future__ import annotations

import sys
from typing import Annotated

import typer

from actioncli.cli.common import Settings, command, complete_label
from actioncli.cli.output import number, plural, printable, say, table, write_json
from actioncli.errors import UsageError

LabelArgument = Annotated[
    str, typer.Argument(help="Name of an enrolled action.", autocompletion=complete_label)
]
YesOption = Annotated[bool, typer.Option("--yes", "-y", help="Do not ask.")]


@command
def list_support(settings: Settings) -> None:
    """List the enrolled actions, and the negatives.

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
        write_json(
            {
                "store": str(where),
                "actions": [
                    {
                        "label": action.label,
                        "negative": action.negative,
                        "examples": action.examples,
                        "seconds": number(action.seconds),
                        "last_added": action.last_added,
                    }
                    for action in actions
                ],
            }
        )
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
def show(settings: Settings, label: LabelArgument) -> None:
    """Show the examples of one action.

    \b
    Examples:
      actioncli show wave

    \b
    JSON keys:
      label, examples
      examples[]: id, source, frames, joints, fps, seconds, added, note, checksum
    """
    with settings.open_store() as store:
        examples = store.examples(label)
    seconds = [(example.frames - 1) / example.fps for example in examples]
    if settings.json:
        write_json(
            {
                "label": label,
                "examples": [
                    {
                        "id": example.id,
                        "source": example.source,
                        "frames": example.frames,
                        "joints": example.joints,
                        "fps": number(example.fps),
                        "seconds": number(length),
                        "added": example.added,
                        "note": example.note,
                        "checksum": example.checksum,
                    }
                    for example, length in zip(examples, seconds, strict=True)
                ],
            }
        )
        return
    say(f"{printable(label)}: {plural(len(examples), 'example')}")
    say(
        table(
            ("id", "source", "frames", "joints", "fps", "seconds", "added", "note"),
            [
                (
                    example.id,
                    example.source,
                    example.frames,
                    example.joints,
                    example.fps,
                    length,
                    example.added,
                    example.note,
                )
                for example, length in zip(examples, seconds, strict=True)
            ],
        )
    )


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
    if settings.json:
        write_json({"label": label, "removed": removed})
    elif not settings.quiet:
        say(f"{printable(label)}: {plural(removed, 'example')} removed")


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
    with settings.open_store() as store:
        examples = store.rename(old, new)
    if settings.json:
        write_json({"old": old, "new": new, "examples": examples})
    elif not settings.quiet:
        say(f"{printable(old)} is now {printable(new)}")


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
    from actioncli.threshold import keep_threshold

    with settings.open_store() as store:
        count = len(store.examples())
        if not _agreed(settings, yes, f"Remove {plural(count, 'example')}, all there are?"):
            return
        removed = store.clear()
        keep_threshold(store, None)
    if settings.json:
        write_json({"removed": removed})
    elif not settings.quiet:
        say(f"{plural(removed, 'example')} removed")


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
