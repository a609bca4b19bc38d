"""Who may talk to a local page: whoever has its token, from the page itself, and nobody else.

Everybody on the machine can open a port on the loopback, and every page in the user's browser can
send requests to it. So each request must name the loopback as its host (a name that someone points
there would pass for it otherwise: DNS rebinding), carry the token, and, where it changes something
or opens a WebSocket, come from the page's own origin.
"""

from __future__ import annotations

import hmac
from http.cookies import CookieError, SimpleCookie
from urllib.parse import parse_qs

from starlette.datastructures import Headers, MutableHeaders
from starlette.responses import PlainTextResponse
from starlette.types import ASGIApp, Message, Receive, Scope, Send

_SAFE = frozenset({"GET", "HEAD"})

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
            token: what a request must carry: once as the address's `token`, from then on as the
                cookie that it is exchanged for.
        """
        self._app, self._token = app, token
        self._hosts = {f"127.0.0.1:{port}", f"localhost:{port}"}
        # Cookies know no ports: two pages at once must not overwrite each other's.
        self._cookie = f"actioncli-{port}"

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Answer, refuse, or hand over."""
        if scope["type"] not in {"http", "websocket"}:
            await self._app(scope, receive, send)
            return
        headers = Headers(scope=scope)
        asked = parse_qs(scope["query_string"].decode("latin-1")).get("token", [""])[0]
        reason = self._refusal(scope, headers, asked)
        if reason is not None:
            await self._refuse(scope, receive, send, reason)
            return

        async def answer(message: Message) -> None:
            if message["type"] == "http.response.start":
                sent = MutableHeaders(scope=message)
                for name, value in _HEADERS.items():
                    sent[name] = value
                if asked:
                    sent.append(
                        "Set-Cookie",
                        f"{self._cookie}={self._token}; Path=/; HttpOnly; SameSite=Strict",
                    )
            await send(message)

        await self._app(scope, receive, answer)

    def _refusal(self, scope: Scope, headers: Headers, asked: str) -> str | None:
        host = headers.get("host", "")
        if host not in self._hosts:
            return "Refused: this page is only served as 127.0.0.1."
        given = asked or self._from_cookie(headers.get("cookie", ""))
        if not hmac.compare_digest(given.encode(), self._token.encode()):
            return "Refused: open the whole address that actioncli printed, with its token."
        changes = scope["type"] == "websocket" or scope["method"] not in _SAFE
        if changes and headers.get("origin") != f"http://{host}":
            return "Refused: only the page itself may do this."
        return None

    def _from_cookie(self, header: str) -> str:
        try:
            morsel = SimpleCookie(header).get(self._cookie)
        except CookieError:
            return ""
        return morsel.value if morsel is not None else ""

    @staticmethod
    async def _refuse(scope: Scope, receive: Receive, send: Send, reason: str) -> None:
        if scope["type"] == "websocket":
            # Before it is accepted, a closed WebSocket is answered with 403.
            await send({"type": "websocket.close", "code": 1008, "reason": reason})
            return
        plain = {name: value for name, value in _HEADERS.items() if name != "Permissions-Policy"}
        response = PlainTextResponse(reason + "\n", 403, {**plain, "Connection": "close"})
        await response(scope, receive, send)
