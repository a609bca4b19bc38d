"""What is wrong with a store, in words."""

from __future__ import annotations

import sqlite3
from collections.abc import Iterator
from pathlib import Path

from actioncli.errors import StoreError
from actioncli.store.cache import damaged_embeddings
from actioncli.store.database import reading
from actioncli.store.examples import read_record
from actioncli.store.settings import damaged_setting, intact_setting


def damage(path: Path) -> list[str]:
    """What is wrong with the content of a store, a line for each problem."""
    found: list[str] = []
    try:
        with reading(path) as db:
            found.extend(_damage(db, path))
    except StoreError as error:
        found.append(str(error))
    return found


def _damage(db: sqlite3.Connection, path: Path) -> Iterator[str]:
    for (message,) in db.execute("PRAGMA integrity_check"):
        if message != "ok":
            yield f"{path} is damaged: {message}. Run `actioncli doctor --repair`."
    orphans = len(db.execute("PRAGMA foreign_key_check").fetchall())
    if orphans:
        yield f"{path}: {orphans} embeddings belong to no example; they are not used."
    for (example,) in db.execute("SELECT id FROM examples ORDER BY id").fetchall():
        try:
            read_record(db, path, example)
        except StoreError as error:
            yield str(error)
    for name, value, crc in db.execute("SELECT name, value, crc FROM settings"):
        if not intact_setting(name, value, crc):
            yield damaged_setting(path, name)
    for example in damaged_embeddings(db):
        yield f"{path}: the embedding of example {example} is damaged; it is not used."
