"""Frames of a video file, in time order, decoded beside whatever is done with them."""

from __future__ import annotations

import contextlib
import math
import os
import queue
import threading
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import cast

import cv2
import numpy as np

from actioncli.errors import ClipError
from actioncli.pose import without_password
from actioncli.pose.region import Image

# Frames decoded in advance; they are all that is ever held, whatever the video's length.
AHEAD = 2
# What a broken header's frame rate is replaced by.
USUAL_FPS = 30.0
HIGHEST_FPS = 1000.0
# Pixels; twice those of an 8K video.
LARGEST_FRAME = 64 * 10**6
# Seconds that an address has to answer, and that it may send nothing.
OPENING, PATIENCE = 10.0, 5.0
# OpenCV's lowest level of logging.
_SILENT = 0


@dataclass(frozen=True, slots=True, eq=False)
class Frame:
    """One frame: seconds from the beginning of the video, and the BGR image (H, W, 3)."""

    time: float
    image: Image


@contextlib.contextmanager
def quiet() -> Iterator[None]:
    """Keep back what FFmpeg and OpenCV write past Python; what matters is told by our errors."""
    os.environ.setdefault("OPENCV_FFMPEG_LOGLEVEL", "-8")
    # These functions are in another place since OpenCV 5.
    logging = cv2.utils.logging if hasattr(cv2.utils, "logging") else cv2
    level = logging.getLogLevel()
    logging.setLogLevel(_SILENT)
    try:
        yield
    finally:
        logging.setLogLevel(level)


def opened(source: str | int, backend: int) -> cv2.VideoCapture:
    """Open a file, an address or a camera, quietly."""
    limits = []
    if backend == cv2.CAP_FFMPEG:
        limits = [cv2.CAP_PROP_OPEN_TIMEOUT_MSEC, round(1000 * OPENING)]
        limits += [cv2.CAP_PROP_READ_TIMEOUT_MSEC, round(1000 * PATIENCE)]
    with quiet():
        given = name_for_opencv(source) if isinstance(source, str) else source
        return cv2.VideoCapture(given, backend, limits)


def name_for_opencv(name: str) -> str:
    """A file's name in bytes, which OpenCV takes, though its types want text: on text with half
    characters, which stand for bytes of a name that are no UTF-8, it crashes."""
    return cast(str, os.fsencode(name))


@contextlib.contextmanager
def one_thread() -> Iterator[None]:
    """Let OpenCV cut pictures out on one thread: others would spin while they wait for more, and
    take the cores from the networks."""
    threads = cv2.getNumThreads()
    cv2.setNumThreads(1)
    try:
        yield
    finally:
        cv2.setNumThreads(threads)


class VideoFile:
    """A video to read once, from the beginning.

    Rotation that a phone wrote into the file is applied; times are the file's own, so a variable
    frame rate is followed.

    Attributes:
        path: of the file, or the address without a password.
        fps: nominal frame rate.
        duration: announced length in seconds, 0 where the file does not tell.
        announced: frames that the file says it has, 0 where it does not tell.
        decoded: frames read so far, whether or not they were handed out.
        ended: whether the end has been reached.
    """

    def __init__(self, path: Path | str) -> None:
        """Open a file; as text, its address.

        Raises:
            ClipError: no such file, not readable, or not a video.
        """
        self.path: Path | str = path if isinstance(path, Path) else without_password(path)
        if isinstance(path, Path):
            _check_file(path)
            # FFmpeg takes a name like `http:` for an address; an absolute one never is.
            self._capture = opened(str(path.absolute()), cv2.CAP_FFMPEG)
        else:
            self._capture = opened(path, cv2.CAP_FFMPEG)
        if not self._capture.isOpened():
            raise ClipError(
                f"{self.path}: not a video that can be decoded; MP4, MOV, AVI, MKV, WebM and GIF "
                "can, if the file is complete."
            )
        width, height = (
            self._capture.get(side)
            for side in (cv2.CAP_PROP_FRAME_WIDTH, cv2.CAP_PROP_FRAME_HEIGHT)
        )
        if width * height > LARGEST_FRAME:
            self._capture.release()
            raise ClipError(
                f"{self.path}: its frames have {width:.0f} x {height:.0f} pixels, more than the "
                f"{LARGEST_FRAME // 10**6} million that are looked at; save it smaller."
            )
        self._capture.set(cv2.CAP_PROP_ORIENTATION_AUTO, 1)
        fps = self._capture.get(cv2.CAP_PROP_FPS)
        # A browser's recording has frames that come when they come: 1000 is its clock's rate.
        clock = fps >= HIGHEST_FPS
        self.fps = float(fps) if fps > 0 and not clock else USUAL_FPS
        count = self._capture.get(cv2.CAP_PROP_FRAME_COUNT)
        known = math.isfinite(count) and count > 0
        self.announced = int(count) if known and not clock else 0
        self.duration = count / fps if known and fps > 0 else 0.0
        self.decoded = 0
        self._reached = 0.0
        self.ended = False

    def frames(
        self, start: float = 0.0, end: float = math.inf, rate: float | None = None
    ) -> Iterator[Frame]:
        """Frames from `start` to `end` (seconds), decoded in a thread of their own.

        Args:
            rate: hand out at most so many a second; None: every frame.
        """
        frames: queue.Queue[Frame | BaseException | None] = queue.Queue(AHEAD)
        stop = threading.Event()

        def hand_over(item: Frame | BaseException | None) -> None:
            while not stop.is_set():
                with contextlib.suppress(queue.Full):
                    frames.put(item, timeout=0.1)
                    return

        def decode() -> None:
            try:
                for frame in self._decode(start, end, rate):
                    hand_over(frame)
                    if stop.is_set():
                        return
                hand_over(None)
            except BaseException as error:  # noqa: BLE001 - raised again in the reading thread
                hand_over(error)

        thread = threading.Thread(target=decode, name="decode", daemon=True)
        thread.start()
        try:
            with one_thread():
                while (item := frames.get()) is not None:
                    if isinstance(item, BaseException):
                        raise item
                    yield item
        finally:
            stop.set()
            thread.join()

    def _decode(self, start: float, end: float, rate: float | None) -> Iterator[Frame]:
        last_time, last_slot = -1 / self.fps, -1
        while self._capture.grab():
            self.decoded += 1
            time = self._capture.get(cv2.CAP_PROP_POS_MSEC) / 1000
            if not (math.isfinite(time) and time > last_time):
                time = last_time + 1 / self.fps
            last_time = self._reached = time
            if time > end:
                return
            # One frame for each slot of 1 / rate seconds; the others are never converted.
            slot = self.decoded if rate is None else int((time - start) * rate + 1e-3)
            if time < start or slot == last_slot:
                continue
            read, image = self._capture.retrieve()
            if read and image is not None:
                last_slot = slot
                yield Frame(time, np.asarray(image, np.uint8))
        self.ended = True

    def shortfall(self) -> str | None:
        """What to tell if the file ended much earlier than it announced."""
        missing = self.announced - self.decoded
        if not self.ended or missing <= max(2, 0.02 * self.announced):
            return None
        # Where the frame rate varies, as in a browser's recording, the count is only a guess.
        if self.duration - self._reached <= max(2 / self.fps, 0.02 * self.duration):
            return None
        return (
            f"the file announces {self.announced} frames and {self.decoded} could be decoded; "
            "it may be cut off or damaged"
        )


def _check_file(path: Path) -> None:
    """Refuse what cannot be a video.

    Raises:
        ClipError: no such file, not readable, or not a regular one.
    """
    if path.is_dir():
        raise ClipError(f"{path}: is a folder; a video is needed, or a folder that holds some.")
    try:
        # A pipe or a device could keep the reader waiting for ever.
        if path.exists() and not path.is_file():
            raise ClipError(f"{path}: is not a regular file; save the video as one.")
        with path.open("rb") as file:
            empty = not file.read(1)
    except OSError as error:
        raise ClipError(f"{path}: cannot read the video: {error.strerror}.") from error
    if empty:
        raise ClipError(f"{path}: the file is empty.")
