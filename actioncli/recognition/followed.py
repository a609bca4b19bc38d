"""The support set as it is now, for what runs on while others enrol and remove."""

from __future__ import annotations

import threading

from actioncli.recognition.recognizer import Recognizer
from actioncli.recognition.support import SupportSet
from actioncli.store.store import SupportStore


class FollowedSupport:
    """A support set that is read again whenever its store has changed, whoever changes it.

    May be used from several threads, beside other processes.
    """

    def __init__(
        self, store: SupportStore, recognizer: Recognizer, tau: float | None = None
    ) -> None:
        """Nothing is read yet; see `SupportSet.load` for the arguments."""
        self._store, self._recognizer, self._tau = store, recognizer, tau
        self._lock = threading.Lock()
        self._loaded: SupportSet | None = None
        self._seen = ""

    def version(self) -> str:
        """Changes when the store does."""
        try:
            status = self._store.path.stat()
        except OSError:
            return "none"
        return f"{status.st_ino:x}-{status.st_mtime_ns:x}-{status.st_size:x}"

    def __call__(self) -> SupportSet:
        """What is enrolled now: the same object as before where nothing has changed.

        Raises:
            StoreError: the store cannot be read.
        """
        with self._lock:
            version = self.version()
            if self._loaded is None or self._seen != version:
                self._loaded = SupportSet.load(self._store, self._recognizer, self._tau)
                self._seen = version
            return self._loaded
