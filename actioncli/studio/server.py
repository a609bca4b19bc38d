"""Serving a page on the loopback until somebody ends it."""

from __future__ import annotations

import asyncio
import contextlib
import os
import secrets
import socket
import time
import webbrowser
from html import escape
from pathlib import Path
from typing import cast

import uvicorn
from starlette.types import ASGIApp
from uvicorn.protocols.http.h11_impl import H11Protocol

from actioncli.errors import UsageError
from actioncli.files import has_screen
from actioncli.studio.guard import Guard

# Bytes of a WebSocket message: a picture of a camera, many times over.
_LARGEST_MESSAGE = 4_000_000
# Seconds in which the whole head of the first request must have come.
_FIRST_SECONDS = 5.0
# Connections without a request in progress; a browser keeps six at most.
MOST_IDLE = 256
# Seconds that requests in progress are given at the end.
_LAST_SECONDS = 1


class BoundedProtocol(H11Protocol):
    """HTTP that closes connections without a request: after a while, and the oldest of many.

    Everybody on the machine can open connections to the loopback, and a process may have about a
    thousand: without a bound, who holds them open keeps the user from the page.
    """

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        """Take a connection, in the place of the one that has been idle for longest."""
        super().connection_made(cast(asyncio.Transport, transport))
        self._since = time.monotonic()
        self._first = self.loop.call_later(_FIRST_SECONDS, self._close_unasked)
        idle = [
            each
            for each in self.connections
            if isinstance(each, BoundedProtocol)
            and (not each.cycle or each.cycle.response_complete)
        ]
        if len(idle) > MOST_IDLE:
            oldest = min(idle, key=lambda each: each._since)
            oldest.transport.abort()
            # It is told later; the next connection of the same burst is to drop another.
            self.connections.discard(oldest)

    def connection_lost(self, exc: Exception | None) -> None:
        """Forget the connection."""
        self._first.cancel()
        super().connection_lost(exc)

    def _close_unasked(self) -> None:
        # A WebSocket has taken over the connection where it is not listed any more.
        if not self.cycle and self in self.connections:
            self.transport.abort()


class Server:
    """A port of the loopback, and the address with its token that leads to the page.

    Attributes:
        address: what to open.
    """

    def __init__(self, port: int = 0, debug: bool = False) -> None:
        """Take a port; 0 is any that is free.

        Args:
            debug: whether the traceback of a bug is written to standard error.

        Raises:
            UsageError: it cannot be had.
        """
        try:
            # From here on who connects waits until `run` answers.
            self._socket = socket.create_server(("127.0.0.1", port))
        except (OSError, OverflowError) as error:
            number = error.errno if isinstance(error, OSError) else None
            reason = os.strerror(number) if number else "there is no such port"
            raise UsageError(
                f"--port {port}: cannot be used ({reason}); 0 takes any that is free."
            ) from error
        self.port: int = self._socket.getsockname()[1]
        self._token = secrets.token_urlsafe(32)
        # A browser sends no fragment: the token stands in no request's address.
        self.address = f"http://127.0.0.1:{self.port}/#token={self._token}"
        self._debug = debug
        self._uvicorn: uvicorn.Server | None = None

    def run(self, app: ASGIApp) -> None:
        """Serve until `stop`, or Ctrl-C."""
        self._uvicorn = uvicorn.Server(
            uvicorn.Config(
                Guard(app, self.port, self._token),
                # The terminal belongs to the command.
                log_config=None,
                access_log=False,
                log_level="error" if self._debug else "critical",
                lifespan="off",
                http=BoundedProtocol,
                # Taken in one go, before the requests of any are looked at: none drops another.
                backlog=MOST_IDLE,
                ws="websockets-sansio",
                ws_max_size=_LARGEST_MESSAGE,
                server_header=False,
                timeout_graceful_shutdown=_LAST_SECONDS,
            )
        )
        with contextlib.suppress(KeyboardInterrupt):
            self._uvicorn.run([self._socket])

    def stop(self) -> None:
        """End `run`, from another thread."""
        if self._uvicorn is not None:
            self._uvicorn.should_exit = True

    def close(self) -> None:
        """Give the port back."""
        self._socket.close()

    def open(self, folder: Path) -> bool:
        """Show the page in the user's browser; whether one was found. It may wait for its end.

        Whoever lists the machine's processes sees a browser's arguments. So it is given a file
        that only the user can read, which leads to the address.

        Args:
            folder: private one for the file.
        """
        # Without a screen, a browser for terminals would take over this one.
        if not has_screen():
            return False
        page = folder / "open.html"
        page.touch(mode=0o600)
        address = escape(self.address)
        page.write_text(
            f'<!doctype html><meta charset="utf-8"><title>actioncli</title>\n'
            f'<meta http-equiv="refresh" content="0; url={address}">\n'
            f'<a href="{address}">Open the page</a>\n',
            encoding="utf-8",
        )
        try:
            return webbrowser.open(page.as_uri())
        except webbrowser.Error:
            return False
