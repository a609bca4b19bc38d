"""Clips that were sent: read beside everything else, then held until somebody decides."""

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
from actioncli.pose import VIDEO_SUFFIXES
from actioncli.pose.read import ReadOptions, read_any
from actioncli.pose.video import Progress
from actioncli.recognition.recognizer import Recognizer
from actioncli.store.names import file_name

# Clips held at once; the oldest goes first. They are small: it is a bound, not a budget.
_MOST = 64
# Seconds after which a video whose page no longer asks how far it is, is not read on. A browser
# lets the pages of hidden tabs ask once a minute.
_PATIENCE = 150.0


class CancelledError(Exception):
    """Nobody wants the clip any more."""


@dataclass(eq=False)
class Sent:
    """One clip that was sent.

    Attributes:
        id: what the page calls it.
        name: of the file, for people.
        whole: whether the user said which part is the action.
        progress: how far a video has been read.
        reading: gives the clip and its embedding (F, E), or the error.
    """

    id: str
    name: str
    whole: bool = False
    progress: Progress | None = None
    reading: Future[Clip] = field(default_factory=Future)
    _cancelled: threading.Event = field(default_factory=threading.Event)
    _asked: float = field(default_factory=time.monotonic)

    def asked(self) -> None:
        """Note that somebody waits for it."""
        self._asked = time.monotonic()

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
        if time.monotonic() - self._asked > _PATIENCE:
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


class Tray:
    """What was sent and not yet decided."""

    def __init__(self, recognizer: Recognizer) -> None:
        """Begin with nothing.

        Args:
            recognizer: finds out whether a clip can be used.
        """
        self._recognizer = recognizer
        self._sent: dict[str, Sent] = {}
        self._numbers = itertools.count(1)
        self._lock = threading.Lock()
        # Two: a file of joints need not wait for a long video.
        self._workers = ThreadPoolExecutor(2, "read")

    def add(self, path: Path, name: str, options: ReadOptions) -> Sent:
        """Read a file, in the background, and delete it.

        Args:
            name: that it has for the user.
            options: how to read it.
        """
        with self._lock:
            sent = Sent(str(next(self._numbers)), file_name(name) or "clip", options.whole)
            self._sent[sent.id] = sent
            dropped = [self._sent.pop(old) for old in list(self._sent)[:-_MOST]]
        for old in dropped:
            old.cancel()
        sent.reading = self._workers.submit(self._read, path, sent, options)
        # A reading that is cancelled before it begins never gets to delete its file.
        sent.reading.add_done_callback(lambda _: path.unlink(missing_ok=True))
        return sent

    def get(self, number: str) -> Sent:
        """A clip that was sent.

        Raises:
            SupportError: there is none of that number.
        """
        with self._lock:
            sent = self._sent.get(number)
        if sent is None:
            raise SupportError("This clip is not here any more; send it again.")
        sent.asked()
        return sent

    def discard(self, number: str) -> None:
        """Forget a clip; one that is being read is stopped."""
        with self._lock:
            sent = self._sent.pop(number, None)
        if sent is not None:
            sent.cancel()

    def close(self) -> None:
        """Stop all reading, and wait until it has."""
        with self._lock:
            for sent in self._sent.values():
                sent.cancel()
            self._sent.clear()
        self._workers.shutdown(wait=True, cancel_futures=True)

    def _read(self, path: Path, sent: Sent, options: ReadOptions) -> Clip:
        try:
            clip = read_any(path, options, sent.advance)
            clip = replace(clip, source=sent.name)
            # A clip that the model cannot use would fail every later classification.
            self._recognizer.embed([clip])
            return clip
        except ActionCliError as error:
            told = str(error).replace(str(path), sent.name)
            raise type(error)(told) from error
