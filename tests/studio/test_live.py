"""A camera of the browser, without the browser: pictures over a WebSocket."""

import json
import struct
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from websockets.exceptions import ConnectionClosed
from websockets.sync.client import ClientConnection, connect
from websockets.typing import Origin, Subprotocol

from actioncli import read_video_clip
from actioncli.studio.app import Studio
from actioncli.studio.live import Camera
from tests.pose.videos import answering, number, numbered, part, real_frames, write_video

from .serving import EXAMPLES, Client, serving

SHARED = Path(__file__).parents[3] / "shared/video"
FILM = SHARED / "jumping_jack/afrlW.mp4"
needs_film = pytest.mark.skipif(not FILM.is_file(), reason=f"needs {FILM}")


@contextmanager
def connected(client: Client, path: str) -> Iterator[ClientConnection]:
    """A WebSocket, as the page opens it."""
    address = f"ws://127.0.0.1:{client.port}{path}"
    offered = [Subprotocol("actioncli"), Subprotocol(client.token)]
    origin = Origin(client.headers["Origin"])
    with connect(address, origin=origin, subprotocols=offered) as connection:
        assert connection.subprotocol == "actioncli"
        yield connection


@pytest.fixture
def socket(client: Client) -> Iterator[ClientConnection]:
    with connected(client, "/api/live") as connection:
        yield connection


def message(time: float, image: Any) -> bytes:
    small = cv2.resize(image, None, fx=0.5, fy=0.5)
    return struct.pack("<d", time) + cv2.imencode(".jpg", small)[1].tobytes()


def receive(socket: ClientConnection) -> dict[str, Any]:
    answer: dict[str, Any] = json.loads(socket.recv(timeout=120))
    return answer


def test_nobody_in_the_picture(socket: ClientConnection) -> None:
    bones = receive(socket)["bones"]
    assert {side for _, _, side, _ in bones} == {"left", "right", "middle"}
    socket.send(message(0.0, np.full((240, 320, 3), 90, np.uint8)))
    answer = receive(socket)
    assert (answer["seen"], answer["whole"], answer["points"]) == (False, False, None)
    assert "ranking" not in answer  # nothing is enrolled


def test_the_tau_that_is_tried_and_the_support_set_are_followed(
    client: Client, studio: Studio, socket: ClientConnection
) -> None:
    client.enroll(EXAMPLES / "squat/ada.npz", "squat")
    receive(socket)
    grey = np.full((240, 320, 3), 90, np.uint8)
    socket.send(message(0.0, grey))
    assert receive(socket)["tau"] == 0.5
    socket.send(json.dumps({"tau": 0.8}))
    socket.send(message(1.0, grey))
    answer = receive(socket)
    assert (answer["tau"], answer["ranking"], answer["current"]) == (0.8, [], None)
    socket.send(json.dumps({"tau": None}))
    client.ask("PUT", "/api/tau", {"tau": 0.3})
    socket.send(message(2.0, grey))
    assert receive(socket)["tau"] == 0.3
    studio.actions.store.clear()
    socket.send(message(3.0, grey))
    assert "ranking" not in receive(socket)


@pytest.mark.parametrize(
    ("wrong", "why"),
    [
        (b"", "a time and a JPEG"),
        (struct.pack("<d", 1.0) + b"\x89PNG", "a time and a JPEG"),
        (struct.pack("<d", 1.0) + b"\xff\xd8\xff\xe0 damaged", "damaged"),
        (struct.pack("<d", float("nan")) + b"\xff\xd8\xff\xe0", "order of their times"),
        ("no json", "a picture or a threshold"),
        ('{"tau": 2}', "between 0 and 1"),
        ('{"tau": true}', "between 0 and 1"),
    ],
)
def test_what_is_no_picture_ends_it(socket: ClientConnection, wrong: bytes | str, why: str) -> None:
    receive(socket)
    socket.send(wrong)
    assert why in receive(socket)["error"]
    with pytest.raises(ConnectionClosed):
        socket.recv(timeout=60)


def test_a_message_beyond_all_measure_ends_it(socket: ClientConnection) -> None:
    receive(socket)
    socket.send(bytes(5_000_000))
    with pytest.raises(ConnectionClosed):
        socket.recv(timeout=60)


def test_pictures_of_a_camera_that_is_named(studio: Studio, tmp_path: Path) -> None:
    pictures = [part(picture) for picture in numbered(20, 192, 128)]
    shown: list[bytes | float] = [each for picture in pictures for each in (picture, 0.05)]
    with answering([*shown, 60.0]) as address, named(studio, address) as socket:
        seen = []
        while isinstance(picture := socket.recv(timeout=60), bytes):
            seen.append(number(cv2.imdecode(np.frombuffer(picture, np.uint8), cv2.IMREAD_COLOR)))
            socket.send("next")
        assert seen == sorted(set(seen))
        assert seen[-1] == 19
        assert json.loads(picture) == {"silent": True}
    video = write_video(tmp_path / "a.mp4", numbered(20), 40)
    with named(studio, str(video)) as socket:
        begun = time.monotonic()
        while isinstance(picture := socket.recv(timeout=60), bytes):
            socket.send("next")
        assert time.monotonic() - begun > 0.4  # at its own pace
        assert json.loads(picture) == {"error": f"{video}: the video has ended."}
    with named(studio, None) as socket:
        assert "`actioncli studio --camera 0` names one" in receive(socket)["error"]
    with named(studio, "file:///a.mp4") as socket:
        assert "sends no pictures" in receive(socket)["error"]


@contextmanager
def named(studio: Studio, source: str | None) -> Iterator[ClientConnection]:
    """The pictures of a source."""
    other = Studio(studio.actions, studio.upload_folder, source=source)
    with serving(other.app()) as address:
        client = Client(address)
        assert client.get("/api/state")["source"] == source
        with connected(client, "/api/source") as connection:
            yield connection
    other.close()


@needs_film
def test_an_action_is_recognised_while_it_is_performed(studio: Studio) -> None:
    studio.actions.store.enroll("jumping jack", read_video_clip(FILM, cache=False))
    camera = Camera(studio.actions)
    events, whole, rankings = [], [], []
    # At a rate that a slow machine reaches too.
    for n, image in enumerate(real_frames(FILM, 40, every=3)):
        answer = camera.frame(message(n / 10, image))
        whole.append(answer["whole"])
        rankings += answer.get("ranking", [])
        events += [answer["current"]] if answer.get("current") else []
    assert np.mean(whole) > 0.9
    assert set(events) == {"jumping jack"}
    assert max(seen["confidence"] for seen in rankings) > 0.9
    assert len(answer["points"]) == 75
