"""`enroll`: add clips to the support set."""

from __future__ import annotations

import math
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from actioncli.cli.answer import notes_of, short_names
from actioncli.cli.command import Settings, command
from actioncli.cli.options import ClipReading, WeightsOption, complete_label, file_named
from actioncli.cli.output import plural, printable, say, write_json
from actioncli.cli.reading import read_each, usable
from actioncli.errors import ClipError, UsageError, WeightsError
from actioncli.pose import ReadOptions, without_password
from actioncli.pose.read import find_any
from actioncli.store.names import NEGATIVES

if TYPE_CHECKING:
    from collections.abc import Iterable

    from actioncli.clips.clip import Clip


@command
def enroll(
    settings: Settings,
    label: Annotated[
        str,
        typer.Argument(
            help="Name of the action; left out with --negative.", autocompletion=complete_label
        ),
    ],
    clips: Annotated[
        list[Path] | None,
        typer.Argument(
            metavar="CLIP...",
            help="Clip files or videos, folders of them, or patterns such as 'day1/*.mp4'.",
            parser=file_named,
        ),
    ] = None,
    *,
    negative: Annotated[
        bool, typer.Option("--negative", help="Enrol what must never be accepted.")
    ] = False,
    either_side: Annotated[
        bool,
        typer.Option(
            "--either-side",
            help="The action counts with left and right exchanged, too: each clip's mirror image "
            "becomes an example beside it.",
        ),
    ] = False,
    keep_tau: Annotated[
        bool, typer.Option("--keep-tau", help="Leave the threshold as it is.")
    ] = False,
    note: Annotated[str, typer.Option(metavar="TEXT", help="Kept with the examples.")] = "",
    weights: WeightsOption = None,
    options: ClipReading,
    camera: Annotated[
        str | None,
        typer.Option(
            metavar="CAMERA",
            help="Record from this one: its number, its device (/dev/video0) or its address.",
        ),
    ] = None,
    seconds: Annotated[
        float, typer.Option(metavar="SECONDS", min=0.5, max=60, help="How long to record.")
    ] = 3.0,
) -> None:
    """Add clips of an action to the support set.

    One clip is enough; more make recognition surer. All clips of one call are added together.
    A clip that is there already is told and not added again. A clip that cannot be used is
    reported and left out, and the exit code is 3. A clip that is unlike the other examples of
    its action, or like another action, is added with a warning.

    Of a video, the part in which the person moves is taken, unless --start or --end say
    otherwise. Of several repetitions one is taken, also of a file. With --camera, a clip is
    recorded after a countdown, and refused if the body is not in view.

    With --negative, no label is given, and the clips are kept as `negatives`: what is nearer to
    one of them than to every action is rejected.

    From the second example of an action on, or where motions that are none of the actions are
    accepted, the threshold is chosen anew, 0.5 or above, and told; one that you set stays.

    \b
    Examples:
      actioncli enroll wave wave.mp4
      actioncli enroll wave --camera 0
      actioncli enroll kick kick.mp4 --either-side
      actioncli enroll wave recordings/wave/ --note "living room"
      actioncli enroll squat 'day1/squat_*.json' --unit mm --up y
      actioncli enroll --negative scratching.mp4 stretching.mp4

    \b
    JSON keys:
      label, negative, weights, clips, threshold, added, known, failed
      clips[]: source, example, added, frames, seconds, notes, warnings, error
      clips[].error: type, message, exit_code
    """
    from actioncli.calibration.enrolment import enrol
    from actioncli.clips.active import one_repetition
    from actioncli.recognition.recognizer import Recognizer
    from actioncli.store.names import check_label

    paths = [file_named(label), *(clips or [])] if negative else clips
    if camera is not None and paths:
        raise UsageError("--camera records the clip of a label; files are enrolled without it.")
    if math.isnan(seconds):  # neither less nor more than the option's bounds
        raise UsageError("--seconds must be a number from 0.5 to 60.")
    if camera is None and not paths and Path(label).exists():
        raise UsageError(
            f"{label} is a file, and the label is missing: actioncli enroll LABEL {label}"
        )
    if camera is None and not paths:
        raise UsageError("Missing argument 'CLIP...'. See 'actioncli enroll --help'.")
    label = NEGATIVES if negative else check_label(label)
    recognizer: Recognizer | None = None
    try:
        recognizer = Recognizer(weights)
    except WeightsError as error:
        if weights is not None:
            raise
        # Enrolment itself needs none.
        settings.tell(f"warning: the clips are not checked: {printable(error)}")
    # A clip that the model cannot use would fail every later classification.
    given = _given(settings, paths or [], options, camera, seconds)
    if camera is None and not options.whole:
        given = (
            (path, clip if isinstance(clip, ClipError) else one_repetition(clip))
            for path, clip in given
        )
    outcomes = list(usable(given, recognizer, negative=negative))
    examined = [found for _, found in outcomes if not isinstance(found, dict)]
    with settings.open_store() as store:
        enrolled = enrol(store, recognizer, label, examined, note, negative, either_side, keep_tau)

    entries: list[dict[str, object]] = []
    remaining = iter(enrolled)
    names = short_names(path for path, _ in outcomes)
    with notes_of(settings, names) as add_notes:
        for path, found in outcomes:
            if isinstance(found, dict):
                entries.append(found)
                continue
            clip, one = found.clip, next(remaining)
            described = {"frames": len(clip), "seconds": clip.duration, "notes": list(clip.notes)}
            entries.append({"source": str(path), **one.to_json(), **described})
            if not (settings.json or settings.quiet):
                add_notes(path, clip.notes)
                say(
                    f"{printable(label)}: {printable(names[path])} "
                    f"{'added' if one.added else 'already there'} as example {one.example} "
                    f"({plural(len(clip), 'frame')}, {clip.duration:.1f} s)"
                )
            for line in one.warnings:
                settings.tell(f"warning: {printable(names[path])}: {printable(line)}")
    images = list(remaining)
    if images:
        settings.tell(f"{plural(len(images), 'mirror image')} kept beside the clips")
    threshold = "".join(one.threshold for one in enrolled)
    if threshold:
        way_out = " (--keep-tau leaves it)" if threshold.startswith("tau is") else ""
        settings.tell(f"note: {printable(threshold)}{way_out}")
    failed = len(outcomes) - len(examined)
    if settings.json:
        added = sum(one.added for one in enrolled[: len(examined)])
        counts = {"added": added, "known": len(examined) - added, "failed": failed}
        used = {"weights": recognizer and recognizer.weights.checksum, "threshold": threshold}
        write_json({"label": label, "negative": negative, **used, "clips": entries, **counts})
    if failed:
        raise typer.Exit(ClipError.exit_code)


def _given(
    settings: Settings, paths: list[Path], options: ReadOptions, camera: str | None, seconds: float
) -> Iterable[tuple[Path | str, Clip | ClipError]]:
    """The clips of files, or the one that a camera records."""
    if camera is None:
        return read_each(find_any(paths), options, shown=not settings.quiet)
    from actioncli.cli.camera import record
    from actioncli.pose.video import DEFAULT_QUALITY

    name = f"camera {camera}" if camera.isdecimal() else without_password(camera)
    try:
        quality = options.quality or DEFAULT_QUALITY
        clip = record(settings, camera, seconds, quality, options.hands)
    except ClipError as unusable:
        return [(name, unusable)]
    return [(name, clip)]
