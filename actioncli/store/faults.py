"""What went wrong with the store, said so that a person knows the way out."""

from __future__ import annotations

import errno
import sqlite3
from pathlib import Path

from actioncli.errors import StoreError

_RESTORE = (
    "Run `actioncli doctor --repair`: it takes what the file still holds, fills up from the copy "
    "beside it, and keeps the file."
)
# By SQLite's result code; https://sqlite.org/rescode.html
_REASONS = {
    sqlite3.SQLITE_NOTADB: "is not a support set (not an SQLite database, or its first bytes are "
    f"damaged). Name another file with --store or ACTIONCLI_HOME, or: {_RESTORE}",
    sqlite3.SQLITE_CORRUPT: f"is damaged. {_RESTORE}",
    sqlite3.SQLITE_BUSY: "is locked by another program. Wait for it or end it, then try again; "
    "on a network drive that cannot lock, move the store to a local disk (ACTIONCLI_HOME).",
    sqlite3.SQLITE_READONLY: "cannot be written, or not be recovered after an interrupted write. "
    "Make the file and its folder writable, or name another place with --store or ACTIONCLI_HOME.",
    sqlite3.SQLITE_FULL: "cannot grow: the disk is full. Nothing was changed; free some space and "
    "try again.",
    sqlite3.SQLITE_CANTOPEN: "cannot be opened. Check that the folder exists and that you may "
    "read and write both it and the file, or name another place with --store or ACTIONCLI_HOME.",
    sqlite3.SQLITE_IOERR: "cannot be read or written: the disk or its file system fails, is full "
    "or cannot lock. Check it, or move the store to a local disk (ACTIONCLI_HOME).",
}
_REASONS[sqlite3.SQLITE_LOCKED] = _REASONS[sqlite3.SQLITE_BUSY]
# The journal of an interrupted write cannot be deleted: the folder is read-only.
_REASONS[sqlite3.SQLITE_IOERR_DELETE] = _REASONS[sqlite3.SQLITE_READONLY]
_REASONS[sqlite3.SQLITE_PERM] = _REASONS[sqlite3.SQLITE_CANTOPEN]


def sqlite_fault(path: Path, error: sqlite3.Error | UnicodeDecodeError) -> StoreError:
    """The error of a database as a `StoreError` that names the file and the remedy."""
    # Errors that Python raises itself (text that is not UTF-8) carry no code.
    code = getattr(error, "sqlite_errorcode", sqlite3.SQLITE_CORRUPT)
    # The lower byte of an extended code is the primary one.
    reason = _REASONS.get(code) or _REASONS.get(code & 0xFF) or f"cannot be used. {_RESTORE}"
    return StoreError(f"{path} {reason} ({error})")


def system_fault(path: Path, error: OSError, what: str = "") -> StoreError:
    """The error of the operating system as a `StoreError` that names the file and the remedy."""
    reason = error.strerror or str(error)
    if error.errno in {errno.ENOSPC, errno.EDQUOT, errno.EFBIG}:
        way = "Free some space and try again."
    elif error.errno in {errno.EACCES, errno.EPERM, errno.EROFS}:
        way = "Make it readable and writable for you, or name another place."
    else:
        way = "Check the path, or name another place."
    return StoreError(f"{path} {what or 'cannot be used'}: {reason}. {way}")
