"""The newest frame of a camera, or of a stream at an address."""

from __future__ import annotations

import threading
import time
from collections.abc import Iterator

import cv2
import numpy as np

from actioncli.errors import ClipError
from actioncli.pose.frames import Frame, one_thread, opened

# OpenCV takes larger numbers for other things, and crashes on some.
_LAST_CAMERA = 99
# Seconds without a new frame after which a live source counts as gone.
_PATIENCE = 5.0
# Seconds that a frame under way may take when the source is closed.
_LAST_FRAME = 1.0


class LiveSource:
    """The newest frame of a camera or an address; what comes late is dropped, never queued.

    Attributes:
        dropped: frames that nobody took in time.
    """

    def __init__(self, source: int | str) -> None:
        """Open a camera by number, or an address such as rtsp://host/stream.

        Raises:
            ClipError: it cannot be opened.
        """
        self._name = f"camera {source}" if isinstance(source, int) else source
        if isinstance(source, int) and not 0 <= source <= _LAST_CAMERA:
            raise ClipError(f"{self._name}: there is none; cameras are numbered from 0.")
        backend = cv2.CAP_ANY if isinstance(source, int) else cv2.CAP_FFMPEG
        self._capture = opened(source, backend)
        if not self._capture.isOpened():
            raise ClipError(
                f"{self._name}: cannot be opened. "
                + (
                    "Cameras are numbered from 0; another program may be using it, or this one "
                    "may lack the permission."
                    if isinstance(source, int)
                    else "Is the address right, and does something send a stream from there?"
                )
            )
        self.dropped = 0
        self._newest: Frame | None = None
        self._changed = threading.Condition()
        self._closing = self._ended = False
        self._start = time.monotonic()
        self._thread = threading.Thread(target=self._receive, name="camera", daemon=True)
        self._thread.start()

    def _receive(self) -> None:
        read = True
        while read and not self._closing:
            read, image = self._capture.read()
            now = time.monotonic() - self._start
            with self._changed:
                self._ended = not read
                if read and image is not None:
                    self.dropped += self._newest is not None
                    self._newest = Frame(now, np.asarray(image, np.uint8))
                self._changed.notify()
        # Here and not in `close`: releasing while another thread reads can crash.
        self._capture.release()

    def frames(self) -> Iterator[Frame]:
        """Frames with seconds since opening, each the newest there is.

        Raises:
            ClipError: nothing has come for five seconds.
        """
        with one_thread():
            while True:
                with self._changed:
                    came = self._changed.wait_for(lambda: self._newest or self._ended, _PATIENCE)
                    frame, self._newest = self._newest, None
                if frame is not None:
                    yield frame
                elif self._ended:
                    return
                elif not came:
                    raise ClipError(f"{self._name}: no picture for {_PATIENCE:g} s.")

    def close(self) -> None:
        """Release the camera; a stream that has stalled is left behind."""
        self._closing = True
        self._thread.join(_LAST_FRAME)
