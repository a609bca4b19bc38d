"""`export` and `import`: carry a support set to another machine."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from actioncli.cli.common import Settings, command
from actioncli.cli.output import plural, printable, say, write_json


@command
def export(
    settings: Settings,
    file: Annotated[Path, typer.Argument(metavar="FILE", help="Where to write it.")],
) -> None:
    """Write the support set to one portable file.

    \b
    Examples:
      actioncli export actions.safetensors

    \b
    JSON keys:
      file, examples
    """
    with settings.open_store() as store:
        examples = store.export(file)
    if settings.json:
        write_json({"file": str(file), "examples": examples})
    elif not settings.quiet:
        say(f"{printable(file)}: {plural(examples, 'example')} written")


@command
def import_(
    settings: Settings,
    file: Annotated[Path, typer.Argument(metavar="FILE", help="What `export` wrote.")],
) -> None:
    """Add what an exported file holds.

    Examples that are there already are skipped. A file that is damaged in any place is refused
    as a whole.

    \b
    Examples:
      actioncli import actions.safetensors

    \b
    JSON keys:
      file, added, skipped
    """
    with settings.open_store() as store:
        added, skipped = store.import_(file)
    if settings.json:
        write_json({"file": str(file), "added": added, "skipped": skipped})
    elif not settings.quiet:
        say(f"{printable(file)}: {plural(added, 'example')} added, {skipped} already there")
