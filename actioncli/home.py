"""Where a user's own files lie: in `$ACTIONCLI_HOME`, else where the system keeps such files."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Literal

HOME_VARIABLE = "ACTIONCLI_HOME"


class NoHomeError(OSError):
    """There is no such place, as for a service whose user has no home."""


def user_folder(kind: Literal["data", "cache"]) -> Path:
    """The folder for what is kept, or for what could be made again; nothing is created.

    Raises:
        NoHomeError: the user has no home, or `ACTIONCLI_HOME` begins with that of nobody.
    """
    named = os.environ.get(HOME_VARIABLE)
    try:
        if named:
            return Path(named).expanduser().absolute()
        import platformdirs

        if kind == "data":
            found = platformdirs.user_data_path("actioncli", appauthor=False)
        else:
            found = platformdirs.user_cache_path("actioncli")
    except RuntimeError as error:
        if named:
            raise NoHomeError(f"{HOME_VARIABLE}={named} names no folder: {error}") from error
        found = Path()
    # Older versions of platformdirs leave `~` as it is.
    if not found.is_absolute():
        raise NoHomeError(f"This user has no home folder: let {HOME_VARIABLE} name a folder.")
    return found
