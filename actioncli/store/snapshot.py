"""All that a query asks a store for, read in one transaction."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from actioncli.store.database import reading
from actioncli.store.examples import Example, list_examples, read_record
from actioncli.store.settings import read_settings

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from actioncli.clips.clip import Clip


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


def read_snapshot(path: Path, weights: str, settings: Collection[str]) -> Snapshot:
    """See `SupportStore.snapshot`."""
    from actioncli.store.cache import read_embeddings

    with reading(path) as db:
        if db is None:
            return Snapshot((), {}, {}, {})
        examples = list_examples(db)
        embeddings = read_embeddings(db, weights)
        records = {
            example.id: read_record(db, path, example.id)
            for example in examples
            if example.id not in embeddings
        }
        found = {
            name: value
            for wanted in settings
            for name, value in read_settings(db, path, wanted).items()
        }
    clips = {example: record.clip() for example, record in records.items()}
    return Snapshot(tuple(examples), embeddings, clips, found)
