"""The newest frame of a camera, or of a stream at an address; what breaks is opened again."""

from __future__ import annotations

import contextlib
import re
import threading
import time
from collections.abc import Callable, Generator, Iterator
from pathlib import Path

import cv2
import numpy as np

from actioncli.errors import ClipError, UsageError
from actioncli.files import listed_cameras
from actioncli.pose import RETRY_SECONDS, without_password
from actioncli.pose.frames import (
    OPENING,
    PATIENCE,
    Frame,
    VideoFile,
    one_thread,
    opened,
    quiet,
)
from actioncli.pose.region import Image

# OpenCV takes larger numbers for other things, and crashes on some.
_LAST_CAMERA = 99
# Kinds of addresses that FFmpeg takes and that send pictures; others reach files or devices.
SCHEMES = ("http", "https", "rtsp", "rtsps", "rtmp", "rtmps", "rtp", "srt", "tcp", "udp")
# Without a picture for so many seconds nobody is seen; then it is told so often.
_SILENT, _LOOK = 1.0, 0.25
# Pauses before a source is opened again: each twice as long as the one before, until it has held.
_FIRST_PAUSE, _LONGEST_PAUSE, _HELD = 0.5, 10.0, 30.0
# Numbers of cameras that are tried where the system lists none.
_TRIED = 5
# Seconds after which a camera has found how bright it is.
_LIGHT = 0.7
# Seconds that a frame under way may take when the source is closed.
_LAST_FRAME = 1.0


def is_device(path: Path) -> bool:
    """Whether a path is a camera's: one that is not there, or no more, is no file either."""
    return path.is_char_device() or (path.parts[:2] == ("/", "dev") and not path.is_file())


def open_source(
    source: int | str | Path,
    retry: float = RETRY_SECONDS,
    note: Callable[[str], None] = lambda line: None,
) -> LiveSource | VideoFile:
    """A camera by its number or device, a video file, or the address of a stream or of a file.

    Args:
        retry, note: see `LiveSource`.

    Raises:
        ClipError: it cannot be opened.
        UsageError: an address of a kind that sends no pictures.
    """
    name = str(source)
    if isinstance(source, int) or name.isdecimal():
        return LiveSource(int(name), retry, note)
    if address := re.match(r"([a-zA-Z][a-zA-Z0-9+.-]*)://", name):
        if address[1].lower() not in SCHEMES:
            raise UsageError(
                f"{name}: such an address sends no pictures; {', '.join(SCHEMES)} can. A file is "
                "named without `file://`."
            )
        live = LiveSource(name, retry, note)
        if not live.ends:
            return live
        live.close()
        return VideoFile(name)
    path = Path(name)
    return LiveSource(path, retry, note) if is_device(path) else VideoFile(path)


def cameras() -> list[tuple[int, str]]:
    """The cameras of this machine that may give pictures: number and name."""
    listed = listed_cameras()
    if listed is None:
        return [(number, f"camera {number}") for number in range(_TRIED) if _opens(number)]
    return listed


def _opens(number: int) -> bool:
    connection = _Connection(number, 0.0)
    try:
        return connection.opens()
    finally:
        connection.close()


def still(source: int | str | Path) -> Image:
    """A picture of a camera, a video, or whatever is at an address, as `open_source` takes it.

    Raises:
        ClipError: there is none.
        UsageError: an address of a kind that sends no pictures.
    """
    opened = open_source(source, retry=0.0)
    shown: Image | None = None
    with contextlib.suppress(ClipError):  # of one that sends no more, the last is as good
        for frame in opened.frames():
            # The first pictures of many cameras are dark.
            if isinstance(frame, Frame):
                shown = frame.image
                if frame.time > _LIGHT:
                    break
    if isinstance(opened, LiveSource):
        opened.close()
    if shown is None:
        raise ClipError(f"{without_password(source)}: no picture can be decoded.")
    return shown


def jpeg(image: Image) -> bytes:
    """A picture as a file."""
    return bytes(cv2.imencode(".jpg", image)[1].tobytes())


class LiveSource:
    """The newest frame of a camera or an address; what comes late is dropped, never queued.

    Attributes:
        name: of the source, for people.
        ends: whether it is a file, which has an end.
        silent: whether there is no picture at the moment.
    """

    def __init__(
        self,
        source: int | str | Path,
        retry: float = 0.0,
        note: Callable[[str], None] = lambda line: None,
    ) -> None:
        """Open a camera by number or device, or an address such as rtsp://host/stream.

        Args:
            retry: seconds for which a source that breaks is opened again and again.
            note: hears that it broke, and that it is back.

        Raises:
            ClipError: it cannot be opened.
        """
        self.name = f"camera {source}" if isinstance(source, int) else without_password(source)
        if isinstance(source, int) and not 0 <= source <= _LAST_CAMERA:
            raise ClipError(f"{self.name}: there is none; cameras are numbered from 0.")
        self._source, self._retry, self._note = source, retry, note
        self._start, self._dropped, self.silent = time.monotonic(), 0, False
        self._connection = _Connection(source, self._start)
        if not self._connection.opens():
            self.close()
            raise ClipError(
                f"{self.name}: cannot be opened. "
                + (
                    "Is the address right, and does something send a stream from there?"
                    if isinstance(source, str)
                    else "`actioncli cameras` lists those that can; another program may be using "
                    "it, or this one may lack the permission."
                )
            )
        self.ends = self._connection.ends

    @property
    def dropped(self) -> int:
        """Frames that nobody took in time."""
        return self._dropped + self._connection.dropped

    def frames(self) -> Iterator[Frame | float]:
        """Frames with seconds since opening, each the newest there is; or, now and then while
        there is no picture, the seconds alone.

        Raises:
            ClipError: it broke, and did not come back in `retry` seconds.
        """
        pause = _FIRST_PAUSE
        with one_thread():
            while True:
                begun = time.monotonic()
                yield from self._shown()
                if time.monotonic() - begun > _HELD:
                    pause = _FIRST_PAUSE
                over = self._connection.over
                why = "the picture has ended" if over else f"no picture for {PATIENCE:g} s"
                if not self._retry:
                    raise ClipError(f"{self.name}: {why}.")
                self._note(f"{why}; trying again for {self._retry:g} s")
                pause = yield from self._regained(pause, why)
                self._note("the picture is back")

    def _shown(self) -> Iterator[Frame | float]:
        """Until the picture ends or stays away."""
        last = time.monotonic() - self._start
        while True:
            came = self._connection.newest(_LOOK)
            now = came.time if isinstance(came, Frame) else came
            self.silent = not isinstance(came, Frame) and now - last > _SILENT
            if isinstance(came, Frame):
                last = now
                yield came
            elif self._connection.over or now - last > PATIENCE:
                self.silent = True
                return
            elif self.silent:
                yield now

    def _regained(self, pause: float, why: str) -> Generator[float, None, float]:
        """Until the picture is back; the next pause."""
        until = time.monotonic() + self._retry
        while True:
            self.close()
            goes_on = time.monotonic() + min(pause, until - time.monotonic())
            while (left := goes_on - time.monotonic()) > 0:
                time.sleep(min(left, _LOOK))
                yield time.monotonic() - self._start
            pause = min(2 * pause, _LONGEST_PAUSE)
            before, self._connection = self._connection, _Connection(self._source, self._start)
            self._dropped += before.dropped
            opened_until = time.monotonic() - self._start + OPENING
            while not self._connection.over:
                # One picture alone is none: some addresses send no more.
                now = self._connection.came(2, _LOOK)
                if now is None:
                    return pause
                if now > opened_until:
                    break
                yield now
            if time.monotonic() >= until:
                raise ClipError(f"{self.name}: {why}, and was not back in {self._retry:g} s.")

    def close(self) -> None:
        """Release the camera; a stream that has stalled is left to its time limit."""
        self._connection.close()


class _Connection:
    """A source that is opened once, and read by a thread of its own.

    Attributes:
        ends: whether it is a file.
        over: whether there is nothing more to come.
        dropped: frames that were not taken.
    """

    def __init__(self, source: int | str | Path, start: float) -> None:
        """Begin to open."""
        self._source, self._start = source, start
        self._newest: Frame | None = None
        self._changed = threading.Condition()
        self._opened = self.ends = self.over = self._closing = False
        self._came = self.dropped = 0
        self._thread = threading.Thread(target=self._receive, name="camera", daemon=True)
        self._thread.start()

    def opens(self) -> bool:
        """Wait until it is open; whether it is."""
        with self._changed:
            self._changed.wait_for(lambda: self._opened or self.over, OPENING)
        return self._opened

    def newest(self, seconds: float) -> Frame | float:
        """Wait so long for a frame that was not taken yet; without one, when there was none."""
        with self._changed:
            self._changed.wait_for(lambda: self._newest or self.over, seconds)
            frame, self._newest = self._newest, None
            # Here, so that no frame that comes later seems to be earlier.
            return frame or time.monotonic() - self._start

    def came(self, frames: int, seconds: float) -> float | None:
        """Wait so long until so many frames have come; without them, when there were fewer."""
        with self._changed:
            self._changed.wait_for(lambda: self._came >= frames or self.over, seconds)
            return None if self._came >= frames else time.monotonic() - self._start

    def close(self) -> None:
        """End reading."""
        self._closing = True
        self._thread.join(_LAST_FRAME)

    def _receive(self) -> None:
        with quiet():
            backends = {int: cv2.CAP_ANY, str: cv2.CAP_FFMPEG}
            source, backend = self._source, backends.get(type(self._source), cv2.CAP_V4L2)
            capture = opened(str(source) if isinstance(source, Path) else source, backend)
            read = capture.isOpened()
            with self._changed:
                self._opened, self.ends = read, capture.get(cv2.CAP_PROP_FRAME_COUNT) > 0
                self._changed.notify()
            while read and not self._closing:
                try:
                    read, image = capture.read()
                except cv2.error:  # such as a picture that no memory could hold
                    read = False
                with self._changed:
                    if read and image is not None:
                        self._came += 1
                        self.dropped += self._newest is not None
                        now = time.monotonic() - self._start
                        self._newest = Frame(now, np.asarray(image, np.uint8))
                    self._changed.notify()
            # Here and not in `close`: releasing while another thread reads can crash.
            capture.release()
            with self._changed:
                self.over = True
                self._changed.notify()
