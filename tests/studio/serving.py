"""A page on a real port, and a client that speaks to it as the page does."""

import http.client
import json
import socket
import threading
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any
from urllib.parse import parse_qs, urlencode, urlsplit

from starlette.applications import Starlette

from actioncli import read_clip
from actioncli.live.events import Event
from actioncli.live.recorder import Recorder
from actioncli.recognition.threshold import Threshold
from actioncli.studio.server import Server
from tests.live.servers import until

__all__ = ["EXAMPLES", "Client", "record", "serving", "until"]

EXAMPLES = Path(__file__).parents[2] / "examples"


@dataclass
class Client:
    """Whoever has an address.

    Attributes:
        headers: what a page sends with each request.
    """

    address: str
    port: int = field(init=False)
    token: str = field(init=False)
    headers: dict[str, str] = field(init=False)

    def __post_init__(self) -> None:
        parts = urlsplit(self.address)
        assert parts.port is not None
        self.port = parts.port
        self.token = parse_qs(parts.fragment)["token"][0]
        self.headers = {
            "Authorization": f"Bearer {self.token}",
            "Origin": f"http://127.0.0.1:{self.port}",
        }

    def answer(
        self,
        method: str,
        path: str,
        body: bytes | None = None,
        headers: Mapping[str, str] | None = None,
    ) -> tuple[int, Mapping[str, str], bytes]:
        """Status, headers and content."""
        connection = http.client.HTTPConnection("127.0.0.1", self.port, timeout=60)
        try:
            sent = self.headers if headers is None else headers
            connection.request(method, path, body, dict(sent))
            response = connection.getresponse()
            return response.status, response.headers, response.read()
        finally:
            connection.close()

    def ask(self, method: str, path: str, document: object = None) -> tuple[int, Any]:
        """Status and the JSON document; None where there is no content."""
        body = None if document is None else json.dumps(document).encode()
        status, _, content = self.answer(method, path, body)
        return status, json.loads(content) if content else None

    def get(self, path: str) -> Any:
        """The document at a path that is there."""
        status, answer = self.ask("GET", path)
        assert status == 200, answer
        return answer

    def upload(self, file: Path, **options: object) -> tuple[int, Any]:
        """Send a file."""
        query = urlencode({"name": file.name, **options})
        status, _, content = self.answer("POST", f"/api/clips?{query}", file.read_bytes())
        return status, json.loads(content)

    def send(self, file: Path, **options: object) -> dict[str, Any]:
        """Send a file and wait until it has been read."""
        status, answer = self.upload(file, **options)
        assert status == 202, answer
        return self.read(answer["id"])

    def read(self, number: str) -> dict[str, Any]:
        """What has become of a clip that was sent."""
        until(lambda: self.get(f"/api/clips/{number}")["state"] != "reading", 120)
        read: dict[str, Any] = self.get(f"/api/clips/{number}")
        return read

    def begin_upload(self, *headers: str) -> socket.socket:
        """Send the beginning of a video whose content is still to come."""
        raw = socket.create_connection(("127.0.0.1", self.port), timeout=60)
        sent = {**self.headers, "Host": f"127.0.0.1:{self.port}"}
        lines = [f"{name}: {value}" for name, value in sent.items()]
        start = ["POST /api/clips?name=film.mp4 HTTP/1.1", *lines, *headers, "", ""]
        raw.sendall("\r\n".join(start).encode())
        return raw

    def enroll(self, file: Path, label: str, negative: bool = False) -> Any:
        """Send a file and keep it."""
        sent = self.send(file)
        assert sent["state"] == "ready", sent
        document = {"label": label, "negative": negative}
        status, answer = self.ask("POST", f"/api/clips/{sent['id']}/enroll", document)
        assert status == 200, answer
        return answer


def record(folder: Path, *labels: str) -> None:
    """Fill a folder as `watch --record` does, with an event of each label."""
    recorder = Recorder(folder, Threshold(0.5, ""), "camera 0")
    for n, label in enumerate(labels):
        clip = read_clip(EXAMPLES / "squat/ada.npz")
        event = Event(label, 0.1 * n, clip.duration, 0.6)
        recorder.update(clip, clip.duration, [], [event], False)


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
