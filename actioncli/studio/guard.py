"""Who may talk to a local page: whoever has its token, from the page itself, and nobody else.

Everybody on the machine can open a port on the loopback, and every page in the user's browser can
send requests to it. So each request must name the loopback as its host (a name that someone points
there would pass for it otherwise: DNS rebinding) and carry the token, and what changes something
or opens a WebSocket must come from the page's own origin. Only the page's own files, which hold
nothing of the user's, need no token.

The token is never a cookie, which a browser would send to every other port of the loopback as
well: the page sets it as a header, `Authorization: Bearer`, and as a subprotocol of a WebSocket.
"""

from __future__ import annotations

import hmac

from starlette.datastructures import Headers, MutableHeaders
from starlette.responses import PlainTextResponse
from starlette.types import ASGIApp, Message, Receive, Scope, Send

_SAFE = frozenset({"GET", "HEAD"})
# The WebSocket's subprotocol; the token is offered as a second one.
SUBPROTOCOL = "actioncli"

# The page may use what this server sends, its camera, and nothing else; nobody may frame it.
_HEADERS = {
    "Cache-Control": "no-store",
    "Content-Security-Policy": (
        "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self'; "
        "connect-src 'self'; base-uri 'none'; form-action 'none'; frame-ancestors 'none'"
    ),
    "Cross-Origin-Opener-Policy": "same-origin",
    "Cross-Origin-Resource-Policy": "same-origin",
    "Permissions-Policy": "camera=(self), microphone=(), geolocation=()",
    "Referrer-Policy": "no-referrer",
    "X-Content-Type-Options": "nosniff",
}


class Guard:
    """Lets through what may pass, and gives every answer its headers."""

    def __init__(self, app: ASGIApp, port: int, token: str) -> None:
        """Stand before an application.

        Args:
            port: of the loopback, where it is served.
            token: what a request must carry.
        """
        self._app, self._token = app, token
        self._hosts = {f"127.0.0.1:{port}", f"localhost:{port}"}

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Answer, refuse, or hand over."""
        if scope["type"] not in {"http", "websocket"}:
            await self._app(scope, receive, send)
            return
        reason = self._refusal(scope)
        if reason is not None:
            await self._refuse(scope, receive, send, reason)
            return

        async def answer(message: Message) -> None:
            if message["type"] == "http.response.start":
                MutableHeaders(scope=message).update(_HEADERS)
            await send(message)

        await self._app(scope, receive, answer)

    def _refusal(self, scope: Scope) -> str | None:
        headers = Headers(scope=scope)
        host = headers.get("host", "")
        if host not in self._hosts:
            return "Refused: this page is only served as 127.0.0.1."
        if scope["type"] == "websocket":
            changes, given = True, "".join(scope["subprotocols"][1:2])
        else:
            changes = scope["method"] not in _SAFE
            given = headers.get("authorization", "").removeprefix("Bearer ")
        public = not changes and (scope["path"] == "/" or scope["path"].startswith("/static/"))
        if not public and not hmac.compare_digest(given.encode(), self._token.encode()):
            return "Refused: open the whole address that actioncli printed, with its token."
        if changes and headers.get("origin") != f"http://{host}":
            return "Refused: only the page itself may do this."
        return None

    @staticmethod
    async def _refuse(scope: Scope, receive: Receive, send: Send, reason: str) -> None:
        if scope["type"] == "websocket":
            # Before it is accepted, a closed WebSocket is answered with 403.
            await send({"type": "websocket.close", "code": 1008, "reason": reason})
            return
        plain = {name: value for name, value in _HEADERS.items() if name != "Permissions-Policy"}
        response = PlainTextResponse(reason + "\n", 403, {**plain, "Connection": "close"})
        await response(scope, receive, send)
