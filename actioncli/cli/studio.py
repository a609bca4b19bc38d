"""`studio`: a local page, for those who would rather click."""

from __future__ import annotations

import contextlib
import importlib.util
import json
import threading
from collections import Counter
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from actioncli.cli.command import Settings, command
from actioncli.cli.output import note, say
from actioncli.errors import UsageError

if TYPE_CHECKING:
    from actioncli.actions import Actions
    from actioncli.studio.server import Server
    from actioncli.studio.upload_folder import UploadFolder

PortOption = Annotated[
    int,
    typer.Option(
        metavar="PORT", min=0, max=65535, help="Port of the loopback.  [default: any free one]",
        show_default=False,
    ),
]  # fmt: skip
OpenOption = Annotated[
    bool, typer.Option("--open/--no-open", help="Show the page in the browser.", show_default=False)
]


@command
def studio(
    settings: Settings,
    port: PortOption = 0,
    open_page: OpenOption = True,
    camera: Annotated[
        str | None,
        typer.Option(
            metavar="SOURCE",
            help="A camera for the page beside the browser's own: what `watch` takes, such as the "
            "address of one in the network. Where actions are enrolled, it is shown at once.",
            show_default=False,
        ),
    ] = None,
) -> None:
    """Record, enrol and try actions on a page in the browser.

    With nothing enrolled, example clips are offered to begin with; with two actions, trying them
    live comes first, large enough to be read across a room.

    The page is served on this machine alone, and only to who has the token in its address.
    Pictures of the browser's camera and files that are dropped on the page are looked at here, by
    the same functions as the commands'; they go nowhere else, and none is kept. Ctrl-C ends it.
    Needs the extra: pip install 'actioncli[studio]'.

    \b
    Examples:
      actioncli studio
      actioncli studio --port 8000 --no-open
      actioncli studio --store family.db
      actioncli studio --camera rtsp://192.168.1.20/stream

    \b
    JSON keys:
      address
    """
    serve(settings, port, open_page, camera)


def serve(
    settings: Settings, port: int = 0, open_page: bool = True, camera: str | None = None
) -> None:
    """Serve the studio until it is ended, with a camera beside the browser's.

    Raises:
        UsageError: the extra is missing.
        StoreError, WeightsError: the support set or the weights cannot be used.
    """
    check_extra()
    from actioncli.studio.app import Studio

    actions = _actions(settings)
    with _served(settings, port, open_page) as (server, uploads):
        behind = Studio(actions, uploads, source=camera)
        try:
            server.run(behind.app())
        finally:
            behind.close()


def review_page(settings: Settings, folder: Path, port: int, open_page: bool) -> Counter[str]:
    """Serve the page of `review` until it is ended; how many clips had which decision.

    Raises:
        UsageError: the extra is missing, or there is no such folder.
        StoreError, WeightsError: the support set or the weights cannot be used.
    """
    check_extra()
    from actioncli.live.recorder import kept_clips
    from actioncli.studio.review import Review

    kept_clips(folder)
    behind = Review(_actions(settings), folder)
    with _served(settings, port, open_page) as (server, _):
        server.run(behind.app())
    return behind.done


def _actions(settings: Settings) -> Actions:
    from actioncli.actions import open

    actions = open(settings.store)
    _ = actions.support  # a store that cannot be read is reported here, not on the page
    return actions


def check_extra() -> None:
    """Find out whether pages can be served.

    Raises:
        UsageError: the packages for it are not installed.
    """
    for module in ("starlette", "uvicorn", "websockets"):
        if importlib.util.find_spec(module) is None:
            raise UsageError(f"the page needs {module}: pip install 'actioncli[studio]'.")


@contextlib.contextmanager
def _served(
    settings: Settings, port: int, open_page: bool
) -> Iterator[tuple[Server, UploadFolder]]:
    """A server whose address has been printed, on a line of its own, and a private folder."""
    from actioncli.studio.server import Server
    from actioncli.studio.upload_folder import UploadFolder

    with (
        contextlib.closing(Server(port, settings.debug)) as server,
        contextlib.closing(UploadFolder()) as uploads,
    ):
        if settings.json:
            say(json.dumps({"address": server.address}))
        else:
            say(server.address)
            settings.tell("Ctrl-C ends it.")
        if open_page:
            threading.Thread(target=_open, args=(server, uploads.folder), daemon=True).start()
        yield server, uploads


def _open(server: Server, folder: Path) -> None:
    if not server.open(folder):
        note("note: no browser was found here; open the address in one.")
