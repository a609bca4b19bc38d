"""HTTP as uvicorn speaks it, but whoever connects and asks nothing is not waited for.

Everybody on the machine can open connections to the loopback, and a process may have about a
thousand: without a bound, who holds them open keeps the user from the page.
"""

from __future__ import annotations

import asyncio
import time
from typing import cast

from uvicorn.protocols.http.h11_impl import H11Protocol

# Seconds in which the whole head of the first request must have come.
_FIRST_SECONDS = 5.0
# Connections without a request in progress; a browser keeps six at most.
MOST_IDLE = 256


class BoundedProtocol(H11Protocol):
    """Closes connections without a request: after a while, and the oldest where there are many."""

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
