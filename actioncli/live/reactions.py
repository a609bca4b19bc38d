"""What is done at an event. Nothing here makes the watching wait, or ends it."""

from __future__ import annotations

import base64
import contextlib
import http.client
import queue
import threading
import time
import urllib.error
import urllib.request
from abc import ABC, abstractmethod
from collections.abc import Callable, Collection
from dataclasses import dataclass
from datetime import UTC, datetime
from typing import Any
from urllib.parse import SplitResult, unquote, urlsplit, urlunsplit

from actioncli.errors import UsageError
from actioncli.files import json_text
from actioncli.live.events import Event

# Seconds that a server may take; what could not be sent by then is dropped, for a light that is
# switched minutes after the gesture is worse than one that is not.
LATE = 10.0
# Events that wait while one is sent.
_MOST_WAITING = 16
# Seconds that the last ones are given at the end.
LAST_SECONDS = 5.0


class Reaction(ABC):
    """Something that is done at events."""

    def enrolled(self, labels: Collection[str]) -> None:  # noqa: B027 - most need not know
        """Hear which actions can come from now on."""

    @abstractmethod
    def __call__(self, event: Event) -> None:
        """Do it, or begin to; without waiting."""

    def close(self) -> None:  # noqa: B027 - most leave nothing behind
        """Give what was begun a little time."""


@dataclass
class Bell(Reaction):
    """Rings."""

    ring: Callable[[], None]

    def __call__(self, event: Event) -> None:
        """Once."""
        self.ring()


class Line:
    """Whether what is sent arrives: that it does not is told once, and that it does again."""

    def __init__(self, name: str, note: Callable[[str], None]) -> None:
        """Nothing was sent yet."""
        self._name, self._note = name, note
        self._missed, self._works = 0, True
        self._lock = threading.Lock()

    def fails(self, why: object, missed: int = 0) -> None:
        """It does not work, and so many events did not arrive."""
        with self._lock:
            self._missed += missed
            worked, self._works = self._works, False
        if worked:
            self._note(f"error: {self._name}: {why}; events are dropped until it works.")

    def works(self) -> None:
        """It does."""
        with self._lock:
            worked, self._works = self._works, True
            missed, self._missed = self._missed, 0
        if not worked:
            self._note(f"note: {self._name}: works again; events dropped: {missed}.")


class Webhook(Reaction):
    """Posts each event as JSON to an address, and to no other one."""

    def __init__(self, address: str, note: Callable[[str], None]) -> None:
        """Begin; nothing is sent yet.

        Raises:
            UsageError: it is no address of the web.
        """
        parts, port = split_address("--webhook", address, ("http", "https"))
        host = f"[{parts.hostname}]" if ":" in str(parts.hostname) else parts.hostname
        netloc = f"{host}:{port}" if port else f"{host}"
        self._address = urlunsplit((parts.scheme, netloc, parts.path, parts.query, ""))
        self._headers = {"Content-Type": "application/json", "User-Agent": "actioncli"}
        if parts.username is not None:
            user = f"{unquote(parts.username)}:{unquote(parts.password or '')}"
            coded = base64.b64encode(user.encode()).decode()
            self._headers["Authorization"] = f"Basic {coded}"
        # What follows the host is often what keeps strangers out.
        self._line = Line(f"--webhook {parts.scheme}://{netloc}", note)
        self._waiting: queue.Queue[tuple[float, str] | None] = queue.Queue(_MOST_WAITING)
        self._thread = threading.Thread(target=self._send, name="webhook", daemon=True)
        self._thread.start()

    def __call__(self, event: Event) -> None:
        """Send it after those that wait."""
        try:
            self._waiting.put_nowait((time.monotonic(), event_text(event)))
        except queue.Full:
            self._line.fails("does not answer", 1)

    def close(self) -> None:
        """Wait a little for what is being sent."""
        with contextlib.suppress(queue.Full):
            self._waiting.put(None, timeout=LAST_SECONDS)
        self._thread.join(LAST_SECONDS)

    def _send(self) -> None:
        opener = urllib.request.build_opener(_NoRedirect)
        while (waiting := self._waiting.get()) is not None:
            since, text = waiting
            if time.monotonic() - since > LATE:
                self._line.fails("is too slow", 1)
                continue
            request = urllib.request.Request(self._address, text.encode(), self._headers)
            try:
                opener.open(request, timeout=LATE).close()
            except urllib.error.HTTPError as answer:
                answer.close()
                self._line.fails(f"answers {answer.code}", 1)
            except (OSError, http.client.HTTPException, ValueError) as error:
                self._line.fails(getattr(error, "reason", None) or error, 1)
            else:
                self._line.works()


class _NoRedirect(urllib.request.HTTPRedirectHandler):
    """Only the address that was given is contacted."""

    def redirect_request(self, *_: Any) -> None:
        """Nowhere."""


def split_address(
    option: str, address: str, schemes: Collection[str]
) -> tuple[SplitResult, int | None]:
    """The parts of an address, and its port.

    Raises:
        UsageError: it is none, or of another kind.
    """
    try:
        parts = urlsplit(address)
        if parts.scheme in schemes and parts.hostname:
            return parts, parts.port
        wrong = f"it begins with {' or '.join(f'{scheme}://' for scheme in schemes)} and a host"
    except ValueError as error:
        wrong = str(error)
    # Not the address: it may hold a password.
    raise UsageError(f"{option}: that is no address: {wrong}.")


def event_text(event: Event) -> str:
    """What is sent of an event: its fields, and the time of day at which it was told."""
    now = datetime.now(UTC).isoformat(timespec="milliseconds")
    return json_text({**event.to_json(), "time": now}, indent=None)
