"""A camera of the browser: its pictures come over a WebSocket, what they show goes back. Pictures
of a camera that was named go to the browser, which then has it as one of its own."""

from __future__ import annotations

import asyncio
import contextlib
import json
import math
import struct
import time
from collections.abc import AsyncIterator, Awaitable, Callable, Iterator
from dataclasses import asdict
from typing import Any

import cv2
import numpy as np
from starlette.websockets import WebSocket, WebSocketDisconnect

from actioncli.actions import Actions
from actioncli.errors import ActionCliError, ClipError, UsageError
from actioncli.live.events import STRIDE, Event, EventDetector
from actioncli.live.stream import PoseStream
from actioncli.pose import without_password
from actioncli.pose.annotate import bones
from actioncli.pose.camera import LiveSource, jpeg, open_source
from actioncli.pose.frames import Frame, VideoFile
from actioncli.pose.landmarks import LANDMARK_COUNT
from actioncli.pose.sides import ALL_NAMES
from actioncli.pose.video import DEFAULT_QUALITY
from actioncli.recognition.support import SupportSet
from actioncli.studio.guard import SUBPROTOCOL
from actioncli.studio.responses import checked_tau

# A message is the picture's time, in seconds, as a little-endian double, and the picture as JPEG.
_TIME = struct.Struct("<d")
_JPEG = b"\xff\xd8\xff"
# Pixels of a picture that is sent.
_WIDTH = 640
# Seconds of poses that are remembered while nothing is enrolled.
_MEMORY = 3.0


class Camera:
    """What one camera shows, picture by picture.

    Attributes:
        tau: the threshold that is tried; None is the one in use.
    """

    def __init__(self, actions: Actions) -> None:
        """Load the pose networks.

        Raises:
            WeightsError: one is missing or damaged.
        """
        self._actions = actions
        self.tau: float | None = None
        self._detector: EventDetector | None = None
        self._used: tuple[SupportSet, float | None] | None = None
        self._poses = PoseStream(DEFAULT_QUALITY, _MEMORY)
        self._time, self._looked = -math.inf, -math.inf

    def frame(self, message: bytes) -> dict[str, Any]:
        """Take in a picture, and tell what it shows.

        Raises:
            UsageError: the message holds no picture that follows the one before.
            StoreError: the support set cannot be read.
        """
        frame = self._decoded(message)
        self._poses.add(frame)
        over: list[Event] = []
        if frame.time - self._looked >= STRIDE:
            self._looked = frame.time
            self._follow_support()
            if self._detector is not None:
                over = self._detector.update(self._poses.clip(), frame.time)
        return self._message(over)

    def _decoded(self, message: bytes) -> Frame:
        picture = message[_TIME.size :]
        if not picture.startswith(_JPEG):
            raise UsageError("A message must hold a time and a JPEG picture.")
        (time,) = _TIME.unpack_from(message)
        if not (math.isfinite(time) and time > self._time):
            raise UsageError("Pictures must come in the order of their times.")
        image = cv2.imdecode(np.frombuffer(picture, np.uint8), cv2.IMREAD_COLOR)
        if image is None:
            raise UsageError("The JPEG picture is damaged.")
        self._time = time
        return Frame(time, np.asarray(image, np.uint8))

    def _follow_support(self) -> None:
        """What is enrolled may change while the camera runs."""
        loaded = self._actions.support
        if self._used == (loaded, self.tau):
            return
        self._used = loaded, self.tau
        support = loaded if self.tau is None else loaded.with_tau(self.tau)
        self._threshold = support.threshold
        if not loaded.actions:
            self._detector = None
        elif self._detector is None:
            self._detector = EventDetector(support)
        else:
            self._detector.follow(support)
        if self._detector is not None:
            self._poses.remember(max(self._detector.windows) + 1)

    def _message(self, over: list[Event]) -> dict[str, Any]:
        body, (width, height) = self._poses.body, self._poses.size
        shown: dict[str, Any] = {"seen": body is not None, "whole": False, "points": None}
        if body is not None:
            shown["whole"] = body.in_view
            shown["points"] = [
                [round(float(x) / width, 4), round(float(y) / height, 4), round(float(sure), 2)]
                for (x, y), sure in zip(body.points, body.visibility, strict=False)
            ]
        detector = self._detector
        if detector is not None:
            shown["ranking"] = [asdict(seen) for seen in detector.ranking]
            shown["tau"] = self._threshold.tau
            shown["current"] = detector.current and detector.current.label
            shown["events"] = [event.to_json() for event in over]
        return shown


@contextlib.asynccontextmanager
async def _accepted(socket: WebSocket) -> AsyncIterator[None]:
    """Take a WebSocket; an error is told to the page, and ends it."""
    await socket.accept(SUBPROTOCOL)
    try:
        yield
    except ActionCliError as error:
        await _send(socket, {"error": str(error)})
        await socket.close(1003)
    except WebSocketDisconnect:
        return


def live_endpoint(actions: Actions) -> Callable[[WebSocket], Awaitable[None]]:
    """The WebSocket of a camera: pictures in, one answer to each out, in order."""

    async def live(socket: WebSocket) -> None:
        async with _accepted(socket):
            camera = await asyncio.to_thread(Camera, actions)
            await _send(socket, {"bones": _bones()})
            while True:
                message = await socket.receive()
                if message["type"] == "websocket.disconnect":
                    return
                if message.get("bytes") is not None:
                    shown = await asyncio.to_thread(camera.frame, message["bytes"])
                    await _send(socket, shown)
                else:
                    camera.tau = _tau(message.get("text") or "")

    return live


def source_endpoint(source: str | None) -> Callable[[WebSocket], Awaitable[None]]:
    """The WebSocket of a camera that was named, as `open_source` takes it: a picture, or word that
    there is none, for each message of the page."""

    async def shown(socket: WebSocket) -> None:
        async with _accepted(socket):
            if source is None:
                raise UsageError("No camera was named: `actioncli studio --camera 0` names one.")
            camera = await asyncio.to_thread(open_source, source)
            try:
                pictures = _pictures(camera)
                while (picture := await asyncio.to_thread(next, pictures, None)) is not None:
                    if picture:
                        await socket.send_bytes(picture)
                    else:
                        await _send(socket, {"silent": True})
                    if (await socket.receive())["type"] == "websocket.disconnect":
                        return
            finally:
                if isinstance(camera, LiveSource):
                    await asyncio.to_thread(camera.close)
            raise ClipError(f"{without_password(source)}: the video has ended.")

    return shown


def _pictures(camera: LiveSource | VideoFile) -> Iterator[bytes]:
    """JPEG pictures as they come, a video's at its own pace; empty now and then while there is
    none."""
    begun = time.monotonic()
    for frame in camera.frames():
        if not isinstance(frame, Frame):
            yield b""
            continue
        if isinstance(camera, VideoFile):
            time.sleep(max(begun + frame.time - time.monotonic(), 0))
        scale = min(_WIDTH / frame.image.shape[1], 1)
        small = cv2.resize(frame.image, None, fx=scale, fy=scale)
        yield jpeg(np.asarray(small, np.uint8))


async def _send(socket: WebSocket, document: object) -> None:
    # In ASCII, as every response.
    await socket.send_text(json.dumps(document))


def _bones() -> list[tuple[int, int, str, float]]:
    """Columns of both ends, the side of the body, and the share of a stroke's width, of each bone
    that is drawn on film."""
    return [
        (start, end, _side(start, end), 1 if end < LANDMARK_COUNT else 0.4)
        for start, end, _ in bones()
    ]


def _side(*columns: int) -> str:
    sides = {ALL_NAMES[column][0] for column in columns if ALL_NAMES[column] != "nose"}
    return {"l": "left", "r": "right"}[sides.pop()] if len(sides) == 1 else "middle"


def _tau(text: str) -> float | None:
    """The threshold that a message names.

    Raises:
        UsageError: it names none.
    """
    try:
        tau = json.loads(text)["tau"]
    except (ValueError, TypeError, KeyError, RecursionError) as error:
        raise UsageError("A message must hold a picture or a threshold.") from error
    return checked_tau(tau)
