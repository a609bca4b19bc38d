"""Poses that were estimated before, so that the same video is not looked at twice."""

from __future__ import annotations

import contextlib
import hashlib
import io
import json
import os
import re
import tempfile
import time
import zipfile
import zlib
from pathlib import Path

import numpy as np

from actioncli.files import is_own_folder, marked_folder, user_folder
from actioncli.pose.poses import Poses

# Changes when what is stored changes its meaning.
FORMAT = 2
LARGEST = 256 * 2**20  # bytes; the poses of about 20 hours
SUFFIX = ".npz"
# How the cache names its files, and those that it has not finished.
_KEPT = re.compile(r"[0-9a-f]{64}\.npz")
_UNFINISHED = re.compile(r"tmp\w{8}\.part")
_ARRAYS = ("times", "world", "visibility", "points", "frames")
_LONGEST_WRITING = 3600.0  # seconds
# What numpy and zipfile make of a file with flipped bits.
_DAMAGED = (
    OSError, ValueError, KeyError, IndexError, EOFError, MemoryError, OverflowError, RuntimeError,
    TypeError, zipfile.BadZipFile, zlib.error,
)  # fmt: skip


def cache_folder() -> Path:
    """Where poses are kept: below `$ACTIONCLI_HOME` if that is set, else where caches belong.

    Raises:
        NoHomeError: there is no such place.
    """
    return user_folder("cache") / "poses"


def cache_key(video: Path, settings: dict[str, object]) -> str:
    """Name for the poses of a file's content under these settings (JSON values)."""
    with video.open("rb") as file:
        digest = hashlib.file_digest(file, "sha256").hexdigest()
    text = json.dumps({"format": FORMAT, "video": digest, **settings}, sort_keys=True)
    return hashlib.sha256(text.encode()).hexdigest()


def load(key: str) -> Poses | None:
    """The poses kept under a key; None if there are none, or the file is damaged."""
    try:
        folder = cache_folder()
        path = folder / (key + SUFFIX)
        if not is_own_folder(folder):
            return None
        # numpy leaves a file open that it cannot read; this one is closed.
        with path.open("rb") as file, np.load(file, allow_pickle=False) as stored:
            poses = Poses(
                **{name: stored[name] for name in _ARRAYS},
                size=(int(stored["size"][0]), int(stored["size"][1])),
                notes=tuple(str(note) for note in stored["notes"]),
            )
        os.utime(path)  # what is used stays longest
    except _DAMAGED:
        return None
    return poses


def keep(key: str, poses: Poses) -> None:
    """Store poses and drop the least recently used beyond the size limit.

    A cache that cannot be written is no error: the poses are there.
    """
    with contextlib.suppress(OSError):
        folder = cache_folder()
        # In a folder of somebody else, nothing is written or deleted.
        if not marked_folder(
            folder, lambda name: _KEPT.fullmatch(name) or _UNFINISHED.fullmatch(name)
        ):
            return
        # mkstemp gives mode 0600, which the file keeps.
        handle, part = tempfile.mkstemp(dir=folder, suffix=".part")
        try:
            with os.fdopen(handle, "wb") as file:
                file.write(_packed(poses))
            Path(part).replace(folder / (key + SUFFIX))
        except BaseException:  # Ctrl-C, too, leaves nothing behind
            Path(part).unlink(missing_ok=True)
            raise
        _shrink(folder)


def _packed(poses: Poses) -> memoryview:
    """As a file; a zip file that is half written on a full disk would complain later."""
    whole = io.BytesIO()
    np.savez_compressed(
        whole,
        **{name: getattr(poses, name) for name in _ARRAYS},
        size=np.array(poses.size),
        notes=np.array(poses.notes, dtype=np.str_),
    )
    return whole.getbuffer()


def _shrink(folder: Path) -> None:
    files = []
    for path in folder.iterdir():
        status = path.lstat()
        # Who was killed could not take it away; who still writes is done long before.
        if _UNFINISHED.fullmatch(path.name) and time.time() - status.st_mtime > _LONGEST_WRITING:
            path.unlink(missing_ok=True)
        if _KEPT.fullmatch(path.name):
            files.append((status, path))
    files.sort(key=lambda entry: entry[0].st_mtime_ns)
    total = sum(status.st_size for status, _ in files)
    for status, path in files:
        if total <= LARGEST:
            break
        path.unlink(missing_ok=True)
        total -= status.st_size
