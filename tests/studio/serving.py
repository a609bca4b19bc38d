"""A studio on a real port, and a client that speaks to it as a page does."""

from __future__ import annotations

import http.client
import json
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any
from urllib.parse import parse_qs, quote, urlsplit

from starlette.applications import Starlette

from actioncli.studio.server import Server

EXAMPLES = Path(__file__).parents[2] / "examples"


@dataclass
class Client:
    """Whoever has an address."""

    address: str
    port: int = field(init=False)
    token: str = field(init=False)

    def __post_init__(self) -> None:
        parts = urlsplit(self.address)
        self.port = parts.port or 0
        self.token = parse_qs(parts.query)["token"][0]

    @property
    def origin(self) -> str:
        return f"http://127.0.0.1:{self.port}"

    def headers(self) -> dict[str, str]:
        return {"Cookie": f"actioncli-{self.port}={self.token}", "Origin": self.origin}

    def ask(
        self,
        method: str,
        path: str,
        body: object = None,
        headers: dict[str, str] | None = None,
        **more: Any,
    ) -> tuple[int, Any]:
        """Status, and what was answered: JSON as what it means, all else as bytes."""
        connection = http.client.HTTPConnection("127.0.0.1", self.port, timeout=60)
        sent = json.dumps(body) if isinstance(body, dict) else body
        try:
            given = self.headers() if headers is None else headers
            connection.request(method, path, sent, given, **more)  # type: ignore[arg-type]
            response = connection.getresponse()
            content = response.read()
        finally:
            connection.close()
        kind = response.getheader("Content-Type", "")
        return response.status, json.loads(content) if "json" in kind else content

    def send(self, file: Path) -> dict[str, Any]:
        """Upload a file and wait until it has been read."""
        status, told = self.ask("POST", f"/api/clips?name={quote(file.name)}", file.read_bytes())
        assert status == 202, told
        return self.read(told["id"])

    def read(self, number: str) -> dict[str, Any]:
        for _ in range(600):
            status, told = self.ask("GET", f"/api/clips/{number}")
            assert status == 200, told
            if told["state"] != "reading":
                return dict(told)
            threading.Event().wait(0.05)
        raise AssertionError("is still being read")


@contextmanager
def serving(app: Starlette) -> Iterator[str]:
    """Serve in a thread; the address."""
    server = Server()
    thread = threading.Thread(target=server.run, args=(app,))
    thread.start()
    try:
        yield server.address
    finally:
        server.stop()
        thread.join()
        server.close()
