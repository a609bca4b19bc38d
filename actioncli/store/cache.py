"""The embeddings of the examples, kept beside them so that a query need not compute them.

They belong to one set of weights and can always be computed again.
"""

from __future__ import annotations

import json
import sqlite3
import zlib
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from actioncli.errors import StoreError
from actioncli.store.database import reading, writing
from actioncli.store.examples import read_record, require_label

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from actioncli.clips.clip import Clip

# Of what `embed` computes with the same weights; kept beside their checksum. 2: the radius is that
# of the view that is asked.
REVISION = 2

# Clips that are embedded before their embeddings are kept.
_AT_ONCE = 256

# No one should wait long for the right to keep what can be computed again.
_PATIENCE = 2.0

_ALL = (
    "SELECT id, label, negative, weights, embeddings.frames, width, data, crc "
    "FROM embeddings JOIN examples ON example = id"
)


def read_embeddings(
    path: Path,
    weights_checksum: str,
    embed: Callable[[Sequence[Clip]], NDArray[np.float32]],
    negative: bool,
) -> dict[str, NDArray[np.float32]]:
    """See `SupportStore.embeddings`."""
    import numpy as np

    weights = f"{weights_checksum} {REVISION}"
    with reading(path) as db:
        if db is None:
            return {}
        labels, found = _kept(db, weights, negative)
    missing = [example for example in labels if example not in found]
    for start in range(0, len(missing), _AT_ONCE):
        with reading(path) as db:
            records = {
                example: read_record(db, path, example)
                for example in missing[start : start + _AT_ONCE]
                if db and db.execute("SELECT 1 FROM examples WHERE id = ?", (example,)).fetchone()
            }
        # The store is not locked while embeddings are computed.
        fresh = {
            example: np.asarray(embed([record.clip()])[0], "<f4")
            for example, record in records.items()
        }
        _keep(path, weights, negative, labels, fresh)
        found |= fresh
    by_label: dict[str, list[int]] = {}
    for example, label in labels.items():
        if example in found:
            by_label.setdefault(label, []).append(example)
    # Ten thousand take 350 MB: each goes as soon as its copy stands beside those of its label.
    return {
        label: np.stack([found.pop(example) for example in by_label[label]])
        for label in sorted(by_label)
    }


def _kept(
    db: sqlite3.Connection, weights: str, negative: bool
) -> tuple[dict[int, str], dict[int, NDArray[np.float32]]]:
    """What is cached for the actions, or for the negatives.

    Returns:
        The label of every example, in the order of enrolment, and the (F, E) embeddings of those
        that have one for these weights.
    """
    import numpy as np

    labels: dict[int, str] = {}
    found: dict[int, NDArray[np.float32]] = {}
    checked: set[object] = set()
    for example, label, held, frames, width, crc, data in db.execute(
        "SELECT id, label, negative, embeddings.frames, width, crc, data FROM examples "
        "LEFT JOIN embeddings ON example = id AND weights = ? WHERE negative = ? ORDER BY id",
        (weights, negative),
    ):
        if label not in checked:
            require_label(label)
            checked.add(label)
        labels[example] = label
        if data is not None and crc == _crc(example, label, held, weights, frames, width, data):
            found[example] = np.frombuffer(data, "<f4").reshape(frames, width)
    return labels, found


def _keep(
    path: Path,
    weights: str,
    negative: bool,
    labels: dict[int, str],
    embeddings: dict[int, NDArray[np.float32]],
) -> None:
    """Add to the cache, and drop what belongs to other weights.

    A store that cannot be written now goes without.
    """
    rows: list[tuple[Any, ...]] = []
    for example, embedding in embeddings.items():
        label = labels[example]
        frames, width = embedding.shape
        data = embedding.tobytes()
        crc = _crc(example, label, negative, weights, frames, width, data)
        rows.append((weights, frames, width, crc, data, example, label))
    try:
        with writing(path, _PATIENCE) as db:
            db.execute("DELETE FROM embeddings WHERE weights != ?", (weights,))
            # An example may have been removed or renamed in the meantime.
            db.executemany(
                "INSERT OR REPLACE INTO embeddings (example, weights, frames, width, crc, data) "
                "SELECT id, ?, ?, ?, ?, ? FROM examples WHERE id = ? AND label = ?",
                rows,
            )
    except StoreError:
        return


def damaged_embeddings(db: sqlite3.Connection) -> list[int]:
    """The examples whose cached embedding has changed since it was written."""
    return [row[0] for row in db.execute(f"{_ALL} ORDER BY id") if _crc(*row[:7]) != row[7]]


def rename_embeddings(db: sqlite3.Connection, old: str, new: str) -> None:
    """Keep the embeddings of a label that is about to get another name."""
    changed = []
    for row in db.execute(f"{_ALL} WHERE label = ?", (old,)):
        example, _, negative, weights, frames, width, data, crc = row
        if _crc(*row[:7]) == crc:
            crc = _crc(example, new, negative, weights, frames, width, data)
            changed.append((crc, example, weights))
    db.executemany("UPDATE embeddings SET crc = ? WHERE example = ? AND weights = ?", changed)


def _crc(
    example: int, label: str, negative: bool, weights: str, frames: int, width: int, data: bytes
) -> int:
    """Covers an embedding and what it belongs to: SQLite does not see a flipped bit.

    With the label in it, a query that meets only embeddings notices one that was damaged.
    """
    told = json.dumps([example, label, int(negative), weights, frames, width], default=repr)
    return zlib.crc32(data, zlib.crc32(told.encode()))
