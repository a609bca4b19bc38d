"""Where uploads lie while they are read: a private folder that goes when the process goes."""

from __future__ import annotations

import contextlib
import re
import secrets
import subprocess
import sys
import time
from pathlib import Path

from starlette.requests import Request

from actioncli.errors import UsageError
from actioncli.files import NoHomeError, marked_folder, user_folder
from actioncli.studio import sweeper
from actioncli.studio.sweeper import delete_uploads

# A folder that is older was left by a machine that lost power; no page is used for so long.
_OLD_SECONDS = 7 * 24 * 3600
_RANDOM_NAME = re.compile("[0-9a-f]{32}")


class TooLargeError(UsageError):
    """An upload that is larger than is taken."""

    def __init__(self, limit: int) -> None:
        """Say how much is taken, bytes."""
        super().__init__(
            f"The file is larger than {limit / 1e6:g} MB, more than is taken here. Cut out the "
            "action, or use the command line, which reads files where they are."
        )


class UploadFolder:
    """A folder that only its owner can read (0700), with files that only he can read (0600).

    It is deleted by `close`, and by a small process that outlives this one where `close` is
    never reached.

    Attributes:
        folder: its path.
    """

    def __init__(self) -> None:
        """Make it in `uploads`, beside the cache of poses.

        Raises:
            UsageError: it cannot be made, or `uploads` is not a folder of this tool.
        """
        try:
            base = user_folder("cache") / "uploads"
        except NoHomeError as error:
            raise UsageError(str(error)) from error
        try:
            if not marked_folder(base):
                raise UsageError(
                    f"{base}: uploads lie in a folder of this name, and something else is there; "
                    "move it."
                )
            _sweep(base)
            self.folder = base / secrets.token_hex(16)
            self.folder.mkdir(mode=0o700)
        except OSError as error:
            raise UsageError(f"{base}: cannot hold uploads: {error.strerror}.") from error
        # A session of its own: Ctrl-C on the terminal does not reach it.
        self._sweeper = subprocess.Popen(
            [sys.executable, "-I", "-S", sweeper.__file__, str(self.folder)],
            stdin=subprocess.PIPE,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
            start_new_session=True,
        )

    def file(self, suffix: str) -> Path:
        """A new empty file."""
        path = self.folder / f"{secrets.token_hex(16)}{suffix}"
        path.touch(mode=0o600, exist_ok=False)
        return path

    def close(self) -> None:
        """Delete the folder and the files that were made in it."""
        delete_uploads(self.folder)
        if self._sweeper.stdin is not None:
            self._sweeper.stdin.close()
        self._sweeper.wait()


async def receive(request: Request, folder: UploadFolder, suffix: str, limit: int) -> Path:
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
        path = folder.file(suffix)
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
    for folder in base.iterdir():
        with contextlib.suppress(OSError):
            old = time.time() - folder.lstat().st_mtime > _OLD_SECONDS
            if old and _RANDOM_NAME.fullmatch(folder.name):
                delete_uploads(folder)
