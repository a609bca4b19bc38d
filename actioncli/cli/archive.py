"""`export` and `import`: carry a support set to another machine."""

from __future__ import annotations

from contextlib import suppress
from pathlib import Path
from typing import Annotated

import typer

from actioncli.cli.command import Settings, command
from actioncli.cli.output import plural, printable
from actioncli.errors import ActionCliError


@command
def export(
    settings: Settings,
    file: Annotated[Path, typer.Argument(metavar="FILE", help="Where to write it.")],
) -> None:
    """Write the support set to one portable file.

    The threshold that `calibrate` kept travels with it.

    \b
    Examples:
      actioncli export actions.safetensors

    \b
    JSON keys:
      file, examples
    """
    with settings.open_store() as store:
        examples = store.export(file)
    line = f"{printable(file)}: {plural(examples, 'example')} written"
    settings.answer({"file": str(file), "examples": examples}, line)


@command
def import_(
    settings: Settings,
    file: Annotated[Path, typer.Argument(metavar="FILE", help="What `export` wrote.")],
) -> None:
    """Add what an exported file holds.

    Examples that are there already are skipped. A file that is damaged in any place is refused
    as a whole. A calibrated threshold in it is taken over by an empty support set only, which then
    decides as the exported one did: on other examples it would have to be measured again.

    \b
    Examples:
      actioncli import actions.safetensors

    \b
    JSON keys:
      file, added, skipped, threshold_taken
    """
    from actioncli.calibration.enrolment import embed_missing
    from actioncli.recognition.recognizer import Recognizer
    from actioncli.store.archive import carried_settings

    with settings.open_store() as store:
        added, skipped = store.import_(file)
        # So that queries need not compute them; the import stands without.
        with suppress(ActionCliError):
            embed_missing(store, Recognizer())
        carried = carried_settings(file)
        taken = bool(carried) and all(store.setting(name) == carried[name] for name in carried)
    settings.answer(
        {"file": str(file), "added": added, "skipped": skipped, "threshold_taken": taken},
        f"{printable(file)}: {plural(added, 'example')} added, {skipped} already there",
    )
    if carried and not taken:
        settings.tell(
            f"note: {printable(file)}: its calibrated threshold was left, for it was measured on "
            "other examples than are here now; see `actioncli calibrate`."
        )
