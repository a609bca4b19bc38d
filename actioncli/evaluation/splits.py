"""Which classes of a collection may be trained on, and which are kept for measuring."""

from __future__ import annotations

import json
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from actioncli.clips.formats.files import MEGABYTE, check_file, check_size
from actioncli.errors import ClipError, UsageError

# Some hundred thousand names of classes.
_LARGEST = 8 * MEGABYTE

PARTS = ("train", "benchmark", "excluded", "people")


@dataclass(frozen=True, slots=True)
class Split:
    """Classes of one collection; no class is in two parts.

    Attributes:
        train: may be trained on when a benchmark figure is reported.
        benchmark: measured, never trained on before.
        excluded: show an action of the benchmark under another name or from another sensor;
            neither trained on for a benchmark figure nor measured.
        people: performers who are measured and never trained on; none where classes alone tell.
    """

    train: tuple[str, ...]
    benchmark: tuple[str, ...]
    excluded: tuple[str, ...]
    people: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True)
class Splits:
    """What a splits file says.

    Attributes:
        source: the file, for messages.
        by_collection: split of each collection, by the collection's name.
    """

    source: str
    by_collection: dict[str, Split]

    def names(self, collection: str, part: str, present: Sequence[str]) -> tuple[str, ...]:
        """Names of one part of a collection, possibly none.

        Args:
            collection: its name, the file name without suffix.
            part: "train", "benchmark" or "excluded"; or "people".
            present: labels, or performers, that the collection holds.

        Raises:
            UsageError: the file does not name the collection, or names what is not in it.
        """
        split = self.by_collection.get(collection)
        if split is None:
            raise UsageError(
                f"{self.source}: says nothing about the collection {collection!r}, only about "
                f"{', '.join(self.by_collection)}."
            )
        named: tuple[str, ...] = getattr(split, part)
        missing = sorted(set(named) - set(present))
        if missing:
            raise UsageError(
                f"{self.source}: names {part} of {collection!r} that are not in it: "
                f"{', '.join(missing)}. Is it the split of another release?"
            )
        return named


def read_splits(path: str | Path) -> Splits:
    """Read `{"collection": {"train": [...], "benchmark": [...], "excluded": [...]}}`, with names of
    classes, and `"people": [...]` with names of performers.

    A part may be left out and is then empty.

    Raises:
        UsageError: the file cannot be read, is no such JSON, or puts a class into two parts.
    """
    source = str(path)
    try:
        check_file(Path(path))
        check_size(Path(path), _LARGEST)
        parsed = json.loads(Path(path).read_text(encoding="utf-8"))
    except ClipError as error:
        raise UsageError(f"cannot read the splits: {error}") from error
    except OSError as error:
        raise UsageError(f"{source}: cannot read the splits: {error.strerror}.") from error
    except (ValueError, RecursionError) as error:
        raise UsageError(f"{source}: no JSON ({error}); see the format in the help.") from error
    if not isinstance(parsed, dict):
        raise UsageError(f"{source}: must be an object with a key per collection.")
    return Splits(source, {name: _split(source, name, part) for name, part in parsed.items()})


def _split(source: str, collection: str, parts: object) -> Split:
    where = f"{source}: {collection!r}"
    if not isinstance(parts, dict):
        raise UsageError(f"{where} must be an object with the keys {', '.join(PARTS)}.")
    unknown = sorted(set(parts) - set(PARTS))
    if unknown:
        raise UsageError(
            f"{where} has the keys {', '.join(unknown)}; known are {', '.join(PARTS)}."
        )
    found: dict[str, tuple[str, ...]] = {}
    for part in PARTS:
        classes = parts.get(part, [])
        if not isinstance(classes, list) or not all(isinstance(name, str) for name in classes):
            raise UsageError(f"{where}: {part} must be a list of names.")
        found[part] = tuple(classes)
    everything = [name for part in PARTS[:3] for name in found[part]]
    twice = sorted(name for name, times in Counter(everything).items() if times > 1)
    if twice:
        raise UsageError(f"{where} names {', '.join(twice)} more than once.")
    return Split(**found)
