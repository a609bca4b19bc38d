"""`cameras`: what can be watched, and what it shows."""

from __future__ import annotations

import shutil
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from actioncli.cli.command import Settings, command
from actioncli.cli.output import colours, printable, say, write_json
from actioncli.cli.reading import report_bad_clip
from actioncli.errors import ClipError, UsageError
from actioncli.files import replacing
from actioncli.pose import without_password

if TYPE_CHECKING:
    from actioncli.pose.region import Image

# Characters across a picture.
_COLUMNS = 48


@command
def cameras(
    settings: Settings,
    sources: Annotated[
        list[str] | None,
        typer.Argument(
            metavar="SOURCE...",
            help="What `watch` takes, to try it.  [default: this machine's cameras]",
            show_default=False,
        ),
    ] = None,
    stills: Annotated[
        Path | None,
        typer.Option(metavar="FOLDER", help="Write what each shows there, as JPEG for you alone."),
    ] = None,
) -> None:
    """List the cameras, each with a picture of what it shows.

    The picture is drawn where standard output is a terminal with colours, and is written nowhere
    but to the folder of --stills. What gives no picture is reported, and the exit code is 3 where
    it was named.

    \b
    Examples:
      actioncli cameras
      actioncli cameras rtsp://192.168.1.20/stream
      actioncli cameras --stills pictures --json

    \b
    JSON keys:
      cameras
      cameras[]: source, name, width, height, still, error
      cameras[].error: type, message, exit_code
    """
    from actioncli.pose.camera import cameras as of_this_machine
    from actioncli.pose.camera import jpeg, still

    if stills is not None and not stills.is_dir():
        raise UsageError(f"{stills}: there is no such folder; make it first.")
    listed = [(str(number), name) for number, name in of_this_machine()] if not sources else []
    given = [(source, without_password(source)) for source in sources or []]
    entries: list[dict[str, object]] = []
    failed = 0
    for number, (source, name) in enumerate([*given, *listed]):
        entry: dict[str, object] = {"source": without_password(source), "name": name}
        try:
            image = still(source)
        except ClipError as error:
            failed += 1
            entry["error"] = report_bad_clip(name, error)["error"]
        else:
            height, width = image.shape[:2]
            file = None if stills is None else stills / f"still_{number}.jpg"
            if file is not None:
                with replacing(file, private=True, failure=UsageError) as part:
                    part.write_bytes(jpeg(image))
            entry |= {"width": width, "height": height, "still": file and str(file)}
            if not settings.json:
                called = "" if sources else f"{source}  "
                say(f"{called}{printable(name)}  {width} x {height}")
                _draw(settings, image)
        entries.append(entry)
    if settings.json:
        write_json({"cameras": entries})
    elif not entries:
        settings.tell("note: no camera was found; `watch` also takes an address or a video.")
    if failed and sources:
        raise typer.Exit(ClipError.exit_code)


def _draw(settings: Settings, image: Image) -> None:
    if settings.quiet or not colours():
        return
    from actioncli.report.terminal import picture_lines

    for line in picture_lines(image, min(_COLUMNS, shutil.get_terminal_size().columns)):
        say(line)
