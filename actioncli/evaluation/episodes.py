"""Episodes: who enrols what, and which clips are asked afterwards.

An episode draws K classes of a collection, some support clips of each, and as many queries that
show one of these classes as queries that show another one. Nothing in it depends on what is
measured, so every scorer that is given the same seed answers the same questions.
"""

from __future__ import annotations

import zlib
from collections.abc import Sequence
from dataclasses import dataclass
from enum import StrEnum

import numpy as np
from numpy.typing import NDArray

from actioncli.errors import ClipError

Indices = NDArray[np.intp]

# Queries of one enrolled class in one episode, at most: enough to rank, few enough that episodes
# of a large collection differ.
QUERIES_PER_CLASS = 10

# Classes left out of the support set so that unknown queries are not all of one kind.
UNKNOWN_CLASSES = 2

# Draws of people or classes before a collection is declared too thin for the protocol.
_ATTEMPTS = 200


class Protocol(StrEnum):
    """Who asks the queries.

    CROSS_PERSON: half of the performers, drawn anew for each episode, enrol; the other half ask.
        So no query, known or unknown, comes from anybody whose clip is enrolled.
    PERSONAL: one performer, drawn for each episode, enrols and asks; no clip does both.
    """

    CROSS_PERSON = "cross-person"
    PERSONAL = "personal"


@dataclass(frozen=True, slots=True, eq=False)
class Episode:
    """One support set and its queries, as indices of clips.

    Attributes:
        labels: the K enrolled classes, in random order.
        support: (K, shots) clips.
        queries: (Q,) clips, none of them in `support`.
        target: (Q,) index into `labels` of what each query shows, -1 for an unknown class.
    """

    labels: tuple[str, ...]
    support: Indices
    queries: Indices
    target: Indices


def possible_ways(ways: int, classes: int) -> int:
    """`ways`, or all classes but two where a collection has fewer."""
    return min(ways, classes - UNKNOWN_CLASSES)


class Sampler:
    """Draws the episodes of one collection."""

    def __init__(
        self,
        name: str,
        labels: Sequence[str],
        subjects: Sequence[str],
        classes: Sequence[str],
        protocol: Protocol = Protocol.CROSS_PERSON,
        shots: int = 1,
        seed: int = 0,
    ) -> None:
        """Keep what the draws depend on.

        Args:
            name: of the collection; part of the seed and of messages.
            labels: class of each clip.
            subjects: performer of each clip, same length.
            classes: those to draw from; clips of other classes are never used.
            protocol: who enrols and who asks.
            shots: support clips per class.
            seed: the same for all scorers that are to be compared.

        Raises:
            ClipError: the performers are not told, or too few for the protocol.
        """
        self.name = name
        self.classes = sorted(set(classes))
        self.protocol = protocol
        self.shots = shots
        self.seed = seed
        self._shown: dict[tuple[str, str], list[int]] = {}
        for clip, (label, person) in enumerate(zip(labels, subjects, strict=True)):
            if label in classes:
                self._shown.setdefault((label, person), []).append(clip)
        self._people = sorted({person for _, person in self._shown})
        if "" in self._people:
            nameless = sum(len(clips) for (_, person), clips in self._shown.items() if not person)
            raise ClipError(
                f"{name}: {nameless} clips do not tell their performer, which the {protocol} "
                "protocol needs."
            )
        if protocol is Protocol.CROSS_PERSON and len(self._people) < 2:
            raise ClipError(
                f"{name}: the cross-person protocol needs two performers, this has "
                f"{len(self._people)}; use --protocol personal."
            )

    def episode(self, ways: int, number: int) -> Episode:
        """Episode `number` with `ways` classes; the same however many others are drawn.

        Known and unknown queries are equally many; within each kind all classes give as equally
        as their clips allow.

        Raises:
            ClipError: the collection has no such episode.
        """
        rng = self._generator(ways, number)
        for _ in range(_ATTEMPTS):
            drawn = self._draw(rng, ways)
            if drawn is not None:
                return drawn
        raise ClipError(
            f"{self.name}: no {ways}-way {self.shots}-shot episode of the {self.protocol} protocol "
            f"can be drawn from its {len(self.classes)} classes; ask for fewer --shots or another "
            "--protocol."
        )

    def _draw(self, rng: np.random.Generator, ways: int) -> Episode | None:
        """An episode of performers drawn at random, or None where their clips give none."""
        enrolling, asking = self._groups(rng)
        labels: list[str] = []
        support: list[Indices] = []
        known: list[Indices] = []
        unknown: list[Indices] = []
        for label in rng.permutation(self.classes):
            asked = self._clips(label, asking)
            enrolled = self._clips(label, enrolling)
            split = self._split(rng, enrolled, asked) if len(labels) < ways else None
            if split is not None:
                labels.append(str(label))
                support.append(split[0])
                known.append(split[1][:QUERIES_PER_CLASS])
            elif len(asked):
                unknown.append(rng.permutation(asked))
        size = min(sum(map(len, known)), sum(map(len, unknown)))
        if len(labels) < ways or not size:
            return None
        known, unknown = _evenly(known, size), _evenly(unknown, size)
        target = np.repeat(np.arange(ways), [len(clips) for clips in known])
        return Episode(
            labels=tuple(labels),
            support=np.stack(support),
            queries=np.concatenate([*known, *unknown]),
            target=np.concatenate([target, np.full(size, -1)]),
        )

    def _split(
        self, rng: np.random.Generator, enrolled: Indices, asked: Indices
    ) -> tuple[Indices, Indices] | None:
        """(shots,) support clips and the remaining queries of one class, or None."""
        support = rng.permutation(enrolled)[: self.shots]
        queries = rng.permutation(np.setdiff1d(asked, support))
        return (support, queries) if len(support) == self.shots and len(queries) else None

    def _groups(self, rng: np.random.Generator) -> tuple[list[str], list[str]]:
        """Performers who enrol, and performers who ask."""
        order = [str(person) for person in rng.permutation(self._people)]
        if self.protocol is Protocol.PERSONAL:
            return order[:1], order[:1]
        half = len(order) // 2
        return order[:half], order[half:]

    def _clips(self, label: str, people: Sequence[str]) -> Indices:
        clips = [clip for person in people for clip in self._shown.get((label, person), ())]
        return np.array(clips, dtype=np.intp)

    def _generator(self, ways: int, number: int) -> np.random.Generator:
        # Of the collection its name, not its place in the argument list. Not the shots: those of
        # fewer are the first of those of more, so that only what they add makes a difference.
        name = zlib.crc32(self.name.encode(errors="surrogatepass"))
        return np.random.default_rng([self.seed, name, ways, number])


def _evenly(parts: list[Indices], size: int) -> list[Indices]:
    """Cut parts so that `size` elements stay, taken from all in turn."""
    counts = [0] * len(parts)
    while sum(counts) < size:
        for i in sorted(range(len(parts)), key=lambda part: counts[part]):
            if counts[i] < len(parts[i]) and sum(counts) < size:
                counts[i] += 1
    return [part[:count] for part, count in zip(parts, counts, strict=True)]
