"""`enroll`: add clips to the support set."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from actioncli.cli.common import (
    ClipArguments,
    FpsOption,
    LayoutOption,
    Reading,
    Settings,
    UnitOption,
    UpOption,
    WeightsOption,
    command,
    complete_label,
    each_clip,
    report_bad_clip,
    tell_notes,
)
from actioncli.cli.output import error_entry, number, plural, printable, say, write_json
from actioncli.errors import ClipError

if TYPE_CHECKING:
    from actioncli.clips.clip import Clip


@command
def enroll(
    settings: Settings,
    label: Annotated[
        str, typer.Argument(help="Name of the action.", autocompletion=complete_label)
    ],
    clips: ClipArguments,
    note: Annotated[str, typer.Option(metavar="TEXT", help="Kept with the examples.")] = "",
    weights: WeightsOption = None,
    layout: LayoutOption = None,
    unit: UnitOption = None,
    up: UpOption = None,
    fps: FpsOption = None,
) -> None:
    """Add clips of an action to the support set.

    One clip is enough; more make recognition surer. All clips of one call are added together.
    A clip that is there already is told and not added again. A clip that cannot be used is
    reported and left out, and the exit code is 3.

    \b
    Examples:
      actioncli enroll wave wave.npy
      actioncli enroll wave recordings/wave/ --note "living room"
      actioncli enroll squat 'day1/squat_*.json' --unit mm --up y

    \b
    JSON keys:
      label, clips, added, known, failed
      clips[]: source, example, added, frames, seconds, notes, error
      clips[].error: type, message, exit_code
    """
    from actioncli.recognizer import Recognizer
    from actioncli.store.names import check_label

    label = check_label(label)
    reading = Reading(layout, unit, up, fps)
    recognizer = Recognizer(weights)
    outcomes: list[tuple[Path, Clip | ClipError]] = []
    for path in each_clip(settings, clips, "Reading"):
        try:
            clip = reading.read(path)
            # A clip that the model cannot use would fail every later classification.
            recognizer.embed([clip])
        except ClipError as error:
            report_bad_clip(error)
            outcomes.append((path, error))
        else:
            outcomes.append((path, clip))
    usable = [clip for _, clip in outcomes if not isinstance(clip, ClipError)]
    with settings.open_store() as store:
        enrolled = store.enroll_all([(label, clip) for clip in usable], note=note)

    entries: list[dict[str, object]] = []
    remaining = iter(enrolled)
    for path, clip_or_error in outcomes:
        if isinstance(clip_or_error, ClipError):
            entries.append(
                {
                    "source": str(path),
                    "error": error_entry(clip_or_error, clip_or_error.exit_code),
                }
            )
            continue
        one = next(remaining)
        entries.append(
            {
                "source": str(path),
                "example": one.example,
                "added": one.added,
                "frames": len(clip_or_error),
                "seconds": number(clip_or_error.duration),
                "notes": list(clip_or_error.notes),
            }
        )
        if not (settings.json or settings.quiet):
            tell_notes(settings, path, clip_or_error.notes)
            say(
                f"{printable(label)}: {printable(path)} "
                f"{'added' if one.added else 'already there'} as example {one.example} "
                f"({plural(len(clip_or_error), 'frame')}, {clip_or_error.duration:.1f} s)"
            )
    failed = len(outcomes) - len(usable)
    if settings.json:
        added = sum(one.added for one in enrolled)
        write_json(
            {
                "label": label,
                "clips": entries,
                "added": added,
                "known": len(enrolled) - added,
                "failed": failed,
            }
        )
    if failed:
        raise typer.Exit(ClipError.exit_code)
