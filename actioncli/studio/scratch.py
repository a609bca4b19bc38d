"""Where uploads lie while they are read: a private folder that goes when the process goes."""

from __future__ import annotations

import contextlib
import os
import shutil
import subprocess
import sys
import tempfile
import time
from pathlib import Path

from starlette.requests import Request

from actioncli.errors import UsageError
from actioncli.files import NoHomeError, user_folder

_PREFIX = "studio-"
# A folder that is older was left by a machine that lost power; no page is used for so long.
_OLD_SECONDS = 7 * 24 * 3600

# Waits for the end of its parent, whatever ends it, and deletes the folder.
_SWEEPER = """
import shutil, sys
sys.stdin.read()
shutil.rmtree(sys.argv[1], ignore_errors=True)
"""


class TooLargeError(UsageError):
    """An upload that is larger than is taken."""

    def __init__(self, limit: int) -> None:
        """Say how much is taken, bytes."""
        super().__init__(
            f"The file is larger than {limit / 1e6:g} MB, more than is taken here. Cut out the "
            "action, or use the command line, which reads files where they are."
        )


class Scratch:
    """A folder that only its owner can read (0700), with files that only he can read (0600).

    It is deleted by `close`, and by a small process that outlives this one where `close` is
    never reached.

    Attributes:
        folder: its path.
    """

    def __init__(self) -> None:
        """Make it, beside the cache of poses.

        Raises:
            UsageError: it cannot be made.
        """
        try:
            base = user_folder("cache")
            base.mkdir(parents=True, exist_ok=True, mode=0o700)
            _sweep(base)
            self.folder = Path(tempfile.mkdtemp(prefix=_PREFIX, dir=base))
        except NoHomeError as error:
            raise UsageError(str(error)) from error
        except OSError as error:
            raise UsageError(f"{base}: cannot hold uploads: {error.strerror}.") from error
        # A session of its own: Ctrl-C on the terminal does not reach it.
        self._sweeper = subprocess.Popen(
            [sys.executable, "-I", "-S", "-c", _SWEEPER, str(self.folder)],
            stdin=subprocess.PIPE,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
            start_new_session=True,
        )

    def file(self, suffix: str) -> Path:
        """A new empty file."""
        handle, name = tempfile.mkstemp(suffix=suffix, dir=self.folder)
        os.close(handle)
        return Path(name)

    def close(self) -> None:
        """Delete the folder and all that is in it."""
        shutil.rmtree(self.folder, ignore_errors=True)
        if self._sweeper.stdin is not None:
            self._sweeper.stdin.close()
        self._sweeper.wait()


async def receive(request: Request, scratch: Scratch, suffix: str, limit: int) -> Path:
    """Write a request's body to a file, which is gone again unless all of it came.

    Args:
        limit: the most bytes that are taken.

    Raises:
        TooLargeError: the body announces more, which is told before it is read, or has more.
        UsageError: it cannot be written.
        ClientDisconnect: whoever sent it went away.
    """
    announced = request.headers.get("content-length", "")
    if announced.isdecimal() and int(announced) > limit:
        raise TooLargeError(limit)
    size, path = 0, None
    try:
        path = scratch.file(suffix)
        with path.open("wb") as file:
            async for part in request.stream():
                size += len(part)
                if size > limit:
                    raise TooLargeError(limit)
                file.write(part)
    except BaseException as error:
        if path is not None:
            path.unlink(missing_ok=True)
        if isinstance(error, OSError):
            raise UsageError(f"The upload cannot be kept: {error.strerror}.") from error
        raise
    return path


def _sweep(base: Path) -> None:
    for folder in base.glob(_PREFIX + "*"):
        with contextlib.suppress(OSError):
            if time.time() - folder.stat().st_mtime > _OLD_SECONDS:
                shutil.rmtree(folder, ignore_errors=True)
