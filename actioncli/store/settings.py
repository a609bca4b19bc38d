"""Settings beside the examples: short texts by name, each with a checksum."""

from __future__ import annotations

import sqlite3
from pathlib import Path

from actioncli.errors import StoreError
from actioncli.store.migrations import setting_crc


def intact_setting(name: object, value: object, crc: object) -> bool:
    """Whether a setting is what was set."""
    texts = isinstance(name, str) and isinstance(value, str)
    return texts and setting_crc(str(name), str(value)) == crc


def put_setting(db: sqlite3.Connection, name: str, value: str) -> None:
    """Set a setting."""
    db.execute(
        "INSERT OR REPLACE INTO settings (name, value, crc) VALUES (?, ?, ?)",
        (name, value, setting_crc(name, value)),
    )


def damaged_setting(path: Path, name: object) -> str:
    """What to say of a setting that is not what was set."""
    return f"{path}: the calibrated {name} is damaged; `actioncli calibrate --reset` forgets it."


def read_settings(db: sqlite3.Connection, path: Path, only: str | None = None) -> dict[str, str]:
    """All settings, or the one of a name.

    Raises:
        StoreError: one is not what was set.
    """
    settings = {}
    query = "SELECT name, value, crc FROM settings WHERE ?1 IS NULL OR name = ?1"
    for name, value, crc in db.execute(query, (only,)).fetchall():
        if not intact_setting(name, value, crc):
            raise StoreError(damaged_setting(path, name))
        settings[name] = value
    return settings
