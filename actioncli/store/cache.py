"""What a query asks a store for: the examples, and the embeddings that are kept beside them.

Embeddings belong to one set of weights and can always be computed again. Who enrols writes them;
who asks only reads.
"""

from __future__ import annotations

import json
import sqlite3
import zlib
from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING

from actioncli.store.examples import Example, require_label

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from actioncli.clips.clip import Clip

# Of what the recogniser computes with the same weights; kept beside their checksum. 4: limbs
# that were swapped are put back.
REVISION = 4

_ALL = (
    "SELECT id, label, negative, weights, embeddings.frames, width, data, crc "
    "FROM embeddings JOIN examples ON example = id"
)


@dataclass(frozen=True, slots=True, eq=False)
class Snapshot:
    """A store at one moment.

    Attributes:
        examples: by label and in the order of enrolment, negatives too.
        embeddings: (F, E) float32 by example, those that the store keeps for the weights.
        clips: by example, of those that have no embedding for the weights.
        settings: those that were asked for and are set, by name.
    """

    examples: tuple[Example, ...]
    embeddings: Mapping[int, NDArray[np.float32]]
    clips: Mapping[int, Clip]
    settings: Mapping[str, str]


def read_embeddings(db: sqlite3.Connection, weights: str) -> dict[int, NDArray[np.float32]]:
    """The (F, E) embeddings that are kept for these weights and undamaged, by example."""
    import numpy as np

    found: dict[int, NDArray[np.float32]] = {}
    checked: set[object] = set()
    for row in db.execute(f"{_ALL} WHERE weights = ? ORDER BY id", (_named(weights),)):
        example, label, _, _, frames, width, data, crc = row
        if label not in checked:
            require_label(label)
            checked.add(label)
        if crc == _crc(*row[:7]):
            found[example] = np.frombuffer(data, "<f4").reshape(frames, width)
    return found


def write_embeddings(
    db: sqlite3.Connection,
    weights_checksum: str,
    embeddings: Mapping[int, NDArray[np.float32]],
) -> None:
    """Keep (F, E) embeddings by example where it is still there; those of other weights go."""
    import numpy as np

    weights = _named(weights_checksum)
    db.execute("DELETE FROM embeddings WHERE weights != ?", (weights,))
    for example, embedding in embeddings.items():
        query = "SELECT label, negative FROM examples WHERE id = ?"
        for label, negative in db.execute(query, (example,)).fetchall():
            kept = (weights, *embedding.shape, np.asarray(embedding, "<f4").tobytes())
            db.execute(
                "INSERT OR REPLACE INTO embeddings (example, weights, frames, width, data, crc) "
                "VALUES (?, ?, ?, ?, ?, ?)",
                (example, *kept, _crc(example, label, negative, *kept)),
            )


def damaged_embeddings(db: sqlite3.Connection) -> list[int]:
    """The examples whose embedding has changed since it was written."""
    return [row[0] for row in db.execute(f"{_ALL} ORDER BY id") if _crc(*row[:7]) != row[7]]


def rename_embeddings(db: sqlite3.Connection, old: str, new: str) -> None:
    """Keep the embeddings of a label that is about to get another name."""
    changed = []
    for row in db.execute(f"{_ALL} WHERE label = ?", (old,)):
        example, _, *rest, crc = row
        if _crc(*row[:7]) == crc:
            changed.append((_crc(example, new, *rest), example, row[3]))
    db.executemany("UPDATE embeddings SET crc = ? WHERE example = ? AND weights = ?", changed)


def _named(weights_checksum: str) -> str:
    return f"{weights_checksum} {REVISION}"


def _crc(
    example: int, label: str, negative: bool, weights: str, frames: int, width: int, data: bytes
) -> int:
    """Covers an embedding and what it belongs to: SQLite does not see a flipped bit.

    With the label in it, a query that meets only embeddings notices one that was damaged.
    """
    owner = json.dumps([example, label, int(negative), weights, frames, width], default=repr)
    return zlib.crc32(data, zlib.crc32(owner.encode()))
