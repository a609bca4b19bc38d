"""Responses of the local pages: files, JSON, errors; and what their requests hold."""

from __future__ import annotations

from collections.abc import Callable
from importlib.resources import files
from typing import Any

from starlette.applications import Starlette
from starlette.exceptions import HTTPException
from starlette.requests import Request
from starlette.responses import JSONResponse, PlainTextResponse, Response
from starlette.routing import BaseRoute, Route

from actioncli.clips.clip import Clip
from actioncli.errors import ActionCliError, ClipError, StoreError, SupportError, UsageError
from actioncli.files import json_text
from actioncli.recognition.decision import Decision
from actioncli.report.figure import figure
from actioncli.report.page import playable
from actioncli.studio.upload_folder import TooLargeError

# The first that fits.
_STATUS = (
    (TooLargeError, 413),
    (UsageError, 400),
    (ClipError, 422),
    (SupportError, 404),
    (StoreError, 503),
    (ActionCliError, 500),
)
_KINDS = {".html": "text/html", ".css": "text/css", ".js": "text/javascript",
          ".svg": "image/svg+xml"}  # fmt: skip
# What pages share with reports, by package.
_SHARED = {"page.css": "actioncli.report", "player.js": "actioncli.report"}


class AsciiJson(JSONResponse):
    """JSON in ASCII: names of files can hold what UTF-8 cannot."""

    def render(self, content: object) -> bytes:
        """The body."""
        return json_text(content, None).encode("ascii")


def application(page: str, routes: list[BaseRoute]) -> Starlette:
    """A page, the files that it loads, and what it can ask for.

    Args:
        page: file of the page at `/`.
        routes: the rest.
    """
    return Starlette(
        routes=[
            Route("/", _file(page)),
            Route("/static/{name}", _static),
            *routes,
        ],
        exception_handlers={
            ActionCliError: _failed,
            HTTPException: _no_such,
            Exception: _bug,
        },
    )


def decision_entry(decision: Decision | None) -> dict[str, Any] | None:
    """A decision, and why it rejects; None where nothing is enrolled."""
    if decision is None:
        return None
    return {**decision.to_json(), "negative_is_nearer": decision.negative_is_nearer}


def moving(clip: Clip) -> dict[str, Any]:
    """A clip's figure as a player takes it."""
    return playable(figure(clip))


async def json_object(request: Request) -> dict[str, Any]:
    """What a page sent.

    Raises:
        UsageError: it is no JSON object.
    """
    try:
        document = await request.json()
    except (ValueError, RecursionError) as error:
        raise UsageError("The request holds no JSON.") from error
    if not isinstance(document, dict):
        raise UsageError("The request holds no JSON object.")
    return document


def checked_tau(tau: object) -> float | None:
    """A threshold that a page sent; None stands for the one in use.

    Raises:
        UsageError: it is none.
    """
    if tau is None:
        return None
    if isinstance(tau, bool) or not isinstance(tau, int | float) or not 0 <= tau <= 1:
        raise UsageError("tau must lie between 0 and 1.")
    return float(tau)


def _error(kind: str, message: str, status: int) -> Response:
    # What has not been read of the request is not waited for.
    headers = {"Connection": "close"} if status == 413 else None
    return AsciiJson({"error": {"type": kind, "message": message}}, status, headers)


def _failed(request: Request, error: Exception) -> Response:
    status = next(code for kind, code in _STATUS if isinstance(error, kind))
    return _error(type(error).__name__, str(error), status)


def _bug(request: Request, error: Exception) -> Response:
    kind = type(error).__name__
    message = f"unexpected {kind}: {error} (this is a bug; --debug shows where)"
    return _error(kind, message, 500)


def _no_such(request: Request, error: Exception) -> Response:
    assert isinstance(error, HTTPException)
    return _error("HTTPException", f"{request.url.path}: {error.detail}.", error.status_code)


def _file(name: str) -> Callable[[Request], Response]:
    package = _SHARED.get(name, "actioncli.studio")
    path = files(package) / name if name in _SHARED else files(package) / "static" / name
    suffix = name[name.rindex(".") :]

    def respond(request: Request) -> Response:
        return Response(path.read_bytes(), media_type=_KINDS[suffix])

    return respond


def _static(request: Request) -> Response:
    name = request.path_params["name"]
    own = {each.name for each in (files("actioncli.studio") / "static").iterdir()}
    if name not in own | _SHARED.keys() or name.endswith(".html"):
        return PlainTextResponse("No such file.\n", 404)
    return _file(name)(request)
