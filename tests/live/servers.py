"""Servers that events are sent to: they answer, refuse, hang, and come back."""

from __future__ import annotations

import json
import signal
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from typing import Any

# An MQTT broker, on the port that is named; where a file of users is, nobody else is let in.
BROKER = """
import asyncio, sys
from amqtt.broker import Broker

plugins = {"amqtt.plugins.authentication.AnonymousAuthPlugin": {"allow_anonymous": True}}
if len(sys.argv) > 2:
    plugins = {"amqtt.plugins.authentication.FileAuthPlugin": {"password_file": sys.argv[2]}}

async def main():
    listener = {"type": "tcp", "bind": f"127.0.0.1:{sys.argv[1]}"}
    await Broker({"listeners": {"default": listener}, "plugins": plugins}).start()
    print("ready", flush=True)
    await asyncio.Event().wait()

asyncio.run(main())
"""


def until(done: Callable[[], object], seconds: float = 60) -> None:
    """Wait; fails where it does not come."""
    deadline = time.monotonic() + seconds
    while not done():
        assert time.monotonic() < deadline, "it did not come"
        time.sleep(0.02)


def free_port() -> int:
    """A port that nobody listens on."""
    with socket.create_server(("127.0.0.1", 0)) as server:
        port: int = server.getsockname()[1]
        return port


@contextmanager
def broker(port: int, *users: str) -> Iterator[subprocess.Popen[str]]:
    """An MQTT broker in a process of its own, so that it can be stopped and killed."""
    words = [sys.executable, "-W", "ignore", "-c", BROKER, str(port), *users]
    with subprocess.Popen(
        words, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True
    ) as process:
        try:
            assert process.stdout is not None
            assert process.stdout.readline() == "ready\n"
            yield process
        finally:
            process.send_signal(signal.SIGCONT)
            process.kill()


@contextmanager
def subscribed(port: int) -> Iterator[list[tuple[str, Any]]]:
    """What a subscriber to everything gets: topics, and the documents or words on them."""
    from paho.mqtt.client import Client
    from paho.mqtt.enums import CallbackAPIVersion

    got: list[tuple[str, Any]] = []
    ready = threading.Event()

    def on_message(client: Any, _: Any, message: Any) -> None:
        text = message.payload.decode()
        got.append((message.topic, json.loads(text) if text.startswith("{") else text))

    client = Client(CallbackAPIVersion.VERSION2)
    client.on_message = on_message
    client.on_subscribe = lambda *_: ready.set()
    client.on_connect = lambda *_: client.subscribe("#")
    client.connect("127.0.0.1", port)
    client.loop_start()
    try:
        assert ready.wait(20)
        yield got
    finally:
        client.disconnect()
        client.loop_stop()


@dataclass
class Hook:
    """A web server that notes what is posted.

    Attributes:
        posted: paths, and documents.
        answers: the status for what comes next; None hangs until `over`.
    """

    port: int
    posted: list[tuple[str, Any]] = field(default_factory=list)
    headers: list[dict[str, str]] = field(default_factory=list)
    status: int | None = 200
    over: threading.Event = field(default_factory=threading.Event)


@contextmanager
def hook(port: int = 0) -> Iterator[Hook]:
    """Such a server."""

    class Server(BaseHTTPRequestHandler):
        def log_message(self, *_: object) -> None:
            """Nobody reads it."""

        def do_POST(self) -> None:
            content = self.rfile.read(int(self.headers["Content-Length"]))
            found.posted.append((self.path, json.loads(content)))
            found.headers.append(dict(self.headers))
            if found.status is None:
                found.over.wait()
                return
            self.send_response(found.status)
            if found.status == 302:
                self.send_header("Location", f"http://127.0.0.1:{found.port}/elsewhere")
            self.end_headers()

        def do_GET(self) -> None:
            found.posted.append((self.path, None))

    with ThreadingHTTPServer(("127.0.0.1", port), Server) as server:
        server.daemon_threads = True
        found = Hook(server.server_port)
        thread = threading.Thread(target=server.serve_forever, args=(0.05,))
        thread.start()
        yield found
        found.over.set()
        server.shutdown()
        thread.join()
