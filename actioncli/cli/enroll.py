"""`enroll`: add clips to the support set."""

from __future__ import annotations

from typing import Annotated

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
    with settings.open_store() as store:
        usable = []
        failures: list[tuple[str, ClipError]] = []
        for path in each_clip(settings, clips, "Reading"):
            try:
                clip = reading.read(path)
                # A clip that the model cannot use would fail every later classification.
                recognizer.embed([clip])
            except ClipError as unusable:
                report_bad_clip(unusable)
                failures.append((str(path), unusable))
            else:
                usable.append((path, clip))
        enrolled = store.enroll_all([(label, clip) for _, clip in usable], note=note)

    added = sum(one.added for one in enrolled)
    if settings.json:
        write_json(
            {
                "label": label,
                "clips": [
                    *(
                        {
                            "source": str(path),
                            "example": one.example,
                            "added": one.added,
                            "frames": len(clip),
                            "seconds": number(clip.duration),
                            "notes": list(clip.notes),
                        }
                        for (path, clip), one in zip(usable, enrolled, strict=True)
                    ),
                    *(
                        {"source": source, "error": error_entry(error, error.exit_code)}
                        for source, error in failures
                    ),
                ],
                "added": added,
                "known": len(enrolled) - added,
                "failed": len(failures),
            }
        )
    elif not settings.quiet:
        for (path, clip), one in zip(usable, enrolled, strict=True):
            tell_notes(settings, path, clip.notes)
            state = "added" if one.added else "already there"
            say(
                f"{printable(label)}: {printable(path)} {state} as example {one.example} "
                f"({plural(len(clip), 'frame')}, {clip.duration:.1f} s)"
            )
    if failures:
        raise typer.Exit(ClipError.exit_code)
