"""Where the store lies, and that nobody else can read it.

A recording of a person is private: the folder is made for its owner only (0700), the file too
(0600), and both from their first moment on. SQLite gives its journal the mode of the database.
"""

from __future__ import annotations

import os
import stat
import zlib
from pathlib import Path

from actioncli.errors import StoreError
from actioncli.files import (
    HOME_VARIABLE,
    NoHomeError,
    is_mine,
    rights_of_others,
    sync_folder,
    user_folder,
    user_settings,
)
from actioncli.store.faults import system_fault

FILE_NAME = "support.db"

# SQLite takes 512 bytes of a path, file systems 255 of a name; eight are for `-journal`.
_LONGEST_NAME = 255 - 8
_LONGEST_PATH = 512 - 8


def store_path(path: str | Path | None = None) -> Path:
    """The store's file: `path`, else what the user set, else `$ACTIONCLI_HOME/support.db`, else in
    the user's data folder.

    Raises:
        UsageError: the user's settings cannot be read.
        StoreError: the user has no home, or `ACTIONCLI_HOME` begins with that of nobody (`~name`).
    """
    if path is not None:
        return Path(path).absolute()
    if named := user_settings().get("store"):
        return Path(named).absolute()
    try:
        return user_folder("data") / FILE_NAME
    except NoHomeError as error:
        raise StoreError(str(error)) from error


def exists(path: Path) -> bool:
    """Whether there is a file that can be opened as a store.

    Raises:
        StoreError: a folder, a device or a symbolic link is there, or one may not look.
    """
    try:
        mode = path.lstat().st_mode
    except (FileNotFoundError, NotADirectoryError):
        return False
    except (OSError, ValueError) as error:
        raise _unusable(path, error) from error
    if stat.S_ISDIR(mode):
        raise StoreError(f"{path} is a folder; name a file in it, such as {path / FILE_NAME}.")
    if stat.S_ISLNK(mode):
        # Someone else may have laid it; following it would fill or close a file of their choice.
        raise StoreError(
            f"{path} is a symbolic link, which a store must not be; name the file itself with "
            f"--store, or its folder with {HOME_VARIABLE}."
        )
    if not stat.S_ISREG(mode):
        raise StoreError(f"{path} is no ordinary file; name another one with --store.")
    return True


def prepare(path: Path) -> None:
    """Create folder and file if they are missing, for their owner only. Safe to race.

    A folder that was there before keeps its mode (it may be anything: a project, a USB stick)
    unless it is empty. A store that others could read is closed to them.

    Raises:
        StoreError: it cannot be created, or what is there cannot be a store.
    """
    folder = path.parent
    try:
        if not exists(path):
            _check_length(path)
            made = [each for each in (folder, *folder.parents) if not each.is_dir()]
            folder.mkdir(mode=0o700, parents=True, exist_ok=True)
            for each in made:
                sync_folder(each.parent)
            if _ours(folder) and not any(folder.iterdir()):
                folder.chmod(0o700)
            try:
                path.touch(0o600, exist_ok=False)
            except FileExistsError:
                exists(path)  # another process was faster, which is well; a link is not
        elif rights_of_others(path) and _ours(path):
            path.chmod(0o600)
    except (OSError, ValueError) as error:
        raise _unusable(path, error) from error


def beside(path: Path, suffix: str) -> Path:
    """The name of what belongs to a store, beside it; SQLite may append to that.

    A name that leaves no room loses its end, in whose place a checksum tells stores apart.
    """
    room = _LONGEST_NAME - len(suffix)
    name = os.fsencode(path.name)
    if len(name) <= room:
        return path.with_name(path.name + suffix)
    cut = name[: room - 9].decode(errors="ignore")
    return path.with_name(f"{cut}~{zlib.crc32(name):08x}{suffix}")


def _check_length(path: Path) -> None:
    """Refuse a name that leaves no room for that of the journal beside it."""
    for what, name, most in (
        ("file name", path.name, _LONGEST_NAME),
        ("path", os.path.realpath(path), _LONGEST_PATH),
    ):
        if len(os.fsencode(name)) > most:
            raise StoreError(
                f"{path}: this {what} is too long for a support set (more than {most} bytes); name "
                f"a shorter one with --store or {HOME_VARIABLE}."
            )


def exposure(path: Path) -> list[str]:
    """Who else could read or exchange a store that is there, a line for each way."""
    found = [f"{path} is open to other users: chmod 600 it."] if rights_of_others(path) else []
    folder = path.parent
    if rights_of_others(folder) & 0o022 and not folder.stat().st_mode & stat.S_ISVTX:
        found.append(f"Other users may replace {path}: chmod 700 its folder.")
    return found


def _ours(path: Path) -> bool:
    status = path.lstat()
    return is_mine(status) and not status.st_mode & stat.S_ISVTX


def _unusable(path: Path, error: OSError | ValueError) -> StoreError:
    if isinstance(error, OSError):
        return system_fault(path, error, "cannot hold a support set")
    return StoreError(f"{str(path)!r} cannot be a file name: {error}.")
