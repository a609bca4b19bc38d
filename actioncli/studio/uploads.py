"""Uploaded clips: read beside everything else, then held until somebody decides."""

from __future__ import annotations

import itertools
import threading
import time
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass, field, replace
from pathlib import Path

from actioncli.clips.clip import Clip
from actioncli.clips.read import CLIP_SUFFIXES
from actioncli.errors import ActionCliError, ClipError, SupportError
from actioncli.pose import VIDEO_SUFFIXES, ReadOptions
from actioncli.pose.read import read_any
from actioncli.pose.video import Progress
from actioncli.recognition.recognizer import Recognizer
from actioncli.store.names import file_name

# Clips held at once: beyond, the oldest goes that no page asks for any more. They are small: it
# is a bound, not a budget.
_MOST = 512
# Seconds after which a video whose page no longer asks how far it is, is not read on. A browser
# lets the pages of hidden tabs ask once a minute.
_PATIENCE = 150.0


class CancelledError(Exception):
    """Nobody wants the clip any more."""


@dataclass(eq=False)
class Upload:
    """One uploaded clip.

    Attributes:
        id: what the page calls it.
        name: of the file, for people.
        whole: whether the user said which part is the action.
        progress: how far a video has been read.
        reading: gives the clip, or the error.
        asked: when somebody last asked for it, on the monotonic clock.
    """

    id: str
    name: str
    whole: bool = False
    progress: Progress | None = None
    reading: Future[Clip] = field(default_factory=Future)
    _cancelled: threading.Event = field(default_factory=threading.Event)
    asked: float = field(default_factory=time.monotonic)

    def cancel(self) -> None:
        """Stop reading as soon as possible."""
        self._cancelled.set()
        self.reading.cancel()

    def error(self) -> str:
        """Why it cannot be used; empty while it is read and where all is well."""
        if self.reading.cancelled():
            return f"{self.name}: it was cancelled."
        failure = self.reading.exception() if self.reading.done() else None
        if failure is None:
            return ""
        if isinstance(failure, CancelledError):
            return f"{self.name}: {failure}."
        if isinstance(failure, ActionCliError):
            return str(failure)
        return f"unexpected {type(failure).__name__}: {failure} (this is a bug)"

    def clip(self) -> Clip:
        """The clip.

        Raises:
            ClipError: it is still being read, or cannot be.
        """
        if not self.reading.done():
            raise ClipError(f"{self.name}: is still being read.")
        if message := self.error():
            raise ClipError(message)
        return self.reading.result()

    def advance(self, progress: Progress) -> None:
        """Take note of progress.

        Raises:
            CancelledError: reading should stop.
        """
        self.progress = progress
        if self._cancelled.is_set():
            raise CancelledError("it was cancelled")
        if time.monotonic() - self.asked > _PATIENCE:
            raise CancelledError("nobody waited for it; send it again")


def check_kind(name: str) -> str:
    """The suffix of a file that may hold a clip.

    Raises:
        ClipError: its name says that it holds something else.
    """
    suffix = Path(name).suffix.lower()
    if suffix in VIDEO_SUFFIXES or suffix in CLIP_SUFFIXES:
        return suffix
    raise ClipError(
        f"{file_name(name)}: {suffix or 'no suffix'} is neither a video "
        f"({', '.join(sorted(VIDEO_SUFFIXES))}) nor a file of joints ({', '.join(CLIP_SUFFIXES)})."
    )


class Uploads:
    """What was uploaded and is not yet decided on."""

    def __init__(self, recognizer: Recognizer) -> None:
        """Begin with nothing.

        Args:
            recognizer: finds out whether a clip can be used.
        """
        self._recognizer = recognizer
        self._uploads: dict[str, Upload] = {}
        self._numbers = itertools.count(1)
        self._lock = threading.Lock()
        # Two: a file of joints need not wait for a long video.
        self._workers = ThreadPoolExecutor(2, "read")

    def add(self, path: Path, name: str, options: ReadOptions) -> Upload:
        """Read a file, in the background, and delete it.

        Args:
            name: that it has for the user.
            options: how to read it.
        """
        with self._lock:
            upload = Upload(str(next(self._numbers)), file_name(name) or "clip", options.whole)
            self._uploads[upload.id] = upload
            forgotten = time.monotonic() - _PATIENCE
            idle = [each.id for each in self._uploads.values() if each.asked < forgotten]
            excess = max(len(self._uploads) - _MOST, 0)
            dropped = [self._uploads.pop(old) for old in idle[:excess]]
        for old in dropped:
            old.cancel()
        upload.reading = self._workers.submit(self._read, path, upload, options)
        # A reading that is cancelled before it begins never gets to delete its file.
        upload.reading.add_done_callback(lambda _: path.unlink(missing_ok=True))
        return upload

    def get(self, number: str) -> Upload:
        """An uploaded clip.

        Raises:
            SupportError: there is none of that number.
        """
        with self._lock:
            upload = self._uploads.get(number)
        if upload is None:
            raise SupportError("This clip is not here any more; send it again.")
        upload.asked = time.monotonic()
        return upload

    def discard(self, number: str) -> None:
        """Forget a clip; one that is being read is stopped."""
        with self._lock:
            upload = self._uploads.pop(number, None)
        if upload is not None:
            upload.cancel()

    def close(self) -> None:
        """Stop all reading, and wait until it has."""
        with self._lock:
            for upload in self._uploads.values():
                upload.cancel()
            self._uploads.clear()
        self._workers.shutdown(wait=True, cancel_futures=True)

    def _read(self, path: Path, upload: Upload, options: ReadOptions) -> Clip:
        try:
            clip = read_any(path, options, upload.advance)
            clip = replace(clip, source=upload.name)
            # A clip that the model cannot use would fail every later classification.
            self._recognizer.embed([clip])
            return clip
        except ActionCliError as error:
            message = str(error).replace(str(path), upload.name)
            raise type(error)(message) from error
