"""One collection made ready for measuring: its clips, its episodes, and how far a run is."""

from __future__ import annotations

import typing
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from actioncli.clips.clip import Clip
from actioncli.errors import ClipError, UsageError
from actioncli.evaluation.episodes import Protocol, Sampler
from actioncli.evaluation.result import Skipped
from actioncli.evaluation.splits import Splits
from actioncli.recognition.decision import Comparison

if TYPE_CHECKING:
    from actioncli.clips.collection import Collection

# Called with what is being done, how many steps of the run are done, and how many there are.
Progress = Callable[[str, int, int], None]

# Clips embedded in one call: memory stays flat and progress moves.
CLIPS_AT_ONCE = 32


class Scorer(typing.Protocol):
    """What is measured: a `Recognizer`, or a baseline with the same two steps."""

    @property
    def name(self) -> str:
        """How reports call it."""

    def embed(self, clips: Sequence[Clip]) -> NDArray[Any]:
        """All that comparison needs of N clips; the leading axis has length N."""

    def compare(self, queries: NDArray[Any], support: Mapping[str, NDArray[Any]]) -> Comparison:
        """Compare Q embedded queries with K actions, each given by its embedded examples."""


class Steps:
    """Counts steps towards a total known from the start."""

    def __init__(self, progress: Progress | None, total: int) -> None:
        """Tell `progress`, if there is one, about every step."""
        self._progress = progress
        self._total = total
        self._done = 0

    def __call__(self, what: str, steps: int = 1) -> None:
        """Say that `steps` more of `what` are done."""
        self._done += steps
        if self._progress is not None:
            self._progress(what, self._done, self._total)


@dataclass(frozen=True, slots=True, eq=False)
class Task:
    """A collection cut down to the classes that are measured.

    Attributes:
        name: of the collection.
        classes: those that episodes draw from, in alphabetical order.
        clips: of these classes only; what the sampler's indices mean.
        sampler: of its episodes.
    """

    name: str
    classes: tuple[str, ...]
    clips: tuple[Clip, ...]
    sampler: Sampler

    @classmethod
    def of(
        cls,
        collection: Collection,
        splits: Splits | None,
        protocol: Protocol,
        shots: int,
        seed: int,
    ) -> Task:
        """Keep the benchmark classes and people, or all of them without splits.

        Raises:
            ClipError: no such class, or performers that do not suit the protocol.
            UsageError: the splits do not fit the collection.
        """
        kept, classes = measured(collection, splits)
        if not classes:
            raise ClipError(f"{collection.name}: the splits keep none of its classes for this.")
        sampler = Sampler(
            collection.name,
            [collection.labels[clip] for clip in kept],
            [collection.subjects[clip] for clip in kept],
            classes,
            protocol,
            shots,
            seed,
        )
        clips = tuple(collection.clips[c] for c in kept)
        return cls(collection.name, classes, clips, sampler)

    def embed(self, scorer: Scorer, step: Steps) -> NDArray[Any]:
        """Every clip once, a step each."""
        parts = []
        for start in range(0, len(self.clips), CLIPS_AT_ONCE):
            clips = self.clips[start : start + CLIPS_AT_ONCE]
            parts.append(scorer.embed(clips))
            step(f"{self.name}: embedding", len(clips))
        return np.concatenate(parts)


def measured(collection: Collection, splits: Splits | None) -> tuple[list[int], tuple[str, ...]]:
    """The clips that show a benchmark class by people who are measured, and these classes in
    alphabetical order; all of them without splits.

    Raises:
        UsageError: the splits do not fit the collection.
    """
    wanted, people = set(collection.labels), set(collection.subjects)
    if splits is not None:
        wanted = set(splits.names(collection.name, "benchmark", collection.labels))
        people = set(splits.names(collection.name, "people", collection.subjects)) or people
    of_clips = zip(collection.labels, collection.subjects, strict=True)
    kept = [n for n, (label, who) in enumerate(of_clips) if label in wanted and who in people]
    return kept, tuple(sorted(wanted))


T = TypeVar("T")


def possible(
    collections: Sequence[Collection], make: Callable[[Collection], T]
) -> tuple[list[T], list[Skipped]]:
    """`make` of each collection, and which of them cannot be measured for what reason.

    Raises:
        ClipError: none of them can.
        UsageError: two have the same name.
    """
    names = [collection.name for collection in collections]
    twice = sorted({name for name in names if names.count(name) > 1})
    if twice:
        raise UsageError(f"several collections are called {', '.join(twice)}; rename the files.")
    made: list[T] = []
    skipped: list[Skipped] = []
    for collection in collections:
        try:
            made.append(make(collection))
        except ClipError as error:
            skipped.append(Skipped(collection.name, str(error)))
    if not made:
        reasons = " ".join(skip.reason for skip in skipped) or "No collection was given."
        raise ClipError(f"nothing to measure. {reasons}")
    return made, skipped
