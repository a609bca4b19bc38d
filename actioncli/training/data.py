"""What training draws from: clips of many classes, with some classes held out for validation."""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from actioncli.clips.clip import Clip
from actioncli.clips.collection import Collection
from actioncli.errors import UsageError
from actioncli.evaluation.splits import Splits

Indices = NDArray[np.int64]


@dataclass(frozen=True, eq=False)
class TrainingSet:
    """N clips with their class, performer and collection as numbers.

    Attributes:
        clips: N clips.
        labels, subjects, collections: (N,) numbers of class, performer and source; a class or
            performer of one collection is never the same as one of another.
        classes: names of the classes, `collection/label`.
    """

    clips: tuple[Clip, ...]
    labels: Indices
    subjects: Indices
    collections: Indices
    classes: tuple[str, ...]

    @cached_property
    def members(self) -> dict[int, Indices]:
        """The clips of each class."""
        return {int(c): np.flatnonzero(self.labels == c) for c in np.unique(self.labels)}

    @cached_property
    def fingerprint(self) -> str:
        """SHA-256 over clips and labels: a run may only go on with the data it began with."""
        digest = hashlib.sha256(repr((self.classes, self.labels.tolist())).encode())
        for clip in self.clips:
            digest.update(clip.joints.data)
            if clip.confidence is not None:
                digest.update(clip.confidence.data)
        return digest.hexdigest()

    def of_classes(self, classes: Sequence[int]) -> TrainingSet:
        """The clips of some classes."""
        rows = np.flatnonzero(np.isin(self.labels, classes))
        return TrainingSet(
            tuple(self.clips[row] for row in rows),
            self.labels[rows],
            self.subjects[rows],
            self.collections[rows],
            self.classes,
        )


def training_set(collections: Sequence[Collection], splits: Splits | None = None) -> TrainingSet:
    """Join collections.

    Args:
        collections: what to train on.
        splits: keep only their `train` classes, without their `people`; None keeps all.

    Raises:
        UsageError: the splits do not fit the collections, or nothing is left.
    """
    clips: list[Clip] = []
    labels: list[str] = []
    subjects: list[str] = []
    sources: list[int] = []
    for number, collection in enumerate(collections):
        wanted, kept_apart = set(collection.labels), set[str]()
        if splits is not None:
            wanted = set(splits.names(collection.name, "train", collection.labels))
            kept_apart = set(splits.names(collection.name, "people", collection.subjects))
        for clip, label, subject in zip(
            collection.clips, collection.labels, collection.subjects, strict=True
        ):
            if label in wanted and subject not in kept_apart:
                clips.append(clip)
                labels.append(f"{collection.name}/{label}")
                subjects.append(f"{collection.name}/{subject}")
                sources.append(number)
    if not clips:
        raise UsageError("no clips to train on: the collections hold no class of the splits.")
    classes, class_of = np.unique(labels, return_inverse=True)
    return TrainingSet(
        tuple(clips),
        class_of.astype(np.int64),
        np.unique(subjects, return_inverse=True)[1].astype(np.int64),
        np.array(sources, np.int64),
        tuple(str(name) for name in classes),
    )


# Share of a collection's classes that validation keeps for itself.
VALIDATION_SHARE = 0.15


def hold_out(data: TrainingSet, seed: int) -> tuple[TrainingSet, TrainingSet]:
    """Split classes into training and validation ones.

    Of each collection with more than 4 classes that several people perform, `VALIDATION_SHARE`
    of those classes, at least 2, is held out.

    Returns:
        training and validation set, without a class in common.
    """
    rng = np.random.default_rng([seed, 0x5E1])
    held: list[int] = []
    for source in np.unique(data.collections):
        classes = [
            c
            for c, rows in data.members.items()
            if data.collections[rows[0]] == source and len(np.unique(data.subjects[rows])) > 1
        ]
        if len(classes) > 4:
            count = max(2, round(VALIDATION_SHARE * len(classes)))
            held += rng.choice(classes, count, replace=False).tolist()
    kept = [c for c in data.members if c not in held]
    return data.of_classes(kept), data.of_classes(held)


def query_of(
    data: TrainingSet, rows: Indices, support: np.int64, rng: np.random.Generator
) -> np.int64:
    """A clip of a class, of another performer than the support clip's where there is one."""
    others = rows[data.subjects[rows] != data.subjects[support]]
    return np.int64(rng.choice(others if len(others) else rows[rows != support]))


# About as long as one action; a recording of several windows holds more than one.
_WINDOW_SECONDS = 2.5


def cut_long_recordings(data: TrainingSet) -> TrainingSet:
    """Cut long recordings that are alone in their class into windows, each a class of its own."""
    clips: list[Clip] = []
    rows: list[int] = []
    names: list[str] = []
    for row, clip in enumerate(data.clips):
        label = int(data.labels[row])
        count = round(clip.duration / _WINDOW_SECONDS) if len(data.members[label]) == 1 else 1
        edges = np.linspace(0, len(clip), max(1, count) + 1).astype(int)
        for part, (first, end) in enumerate(pairwise(edges)):
            joints = clip.joints[first:end]
            # A window in which nobody moves shows no action.
            if count > 1 and not np.any(joints != joints[:1]):
                continue
            confidence = None if clip.confidence is None else clip.confidence[first:end]
            clips.append(
                Clip(joints, clip.joint_names, clip.fps, confidence) if count > 1 else clip
            )
            rows.append(row)
            names.append(f"{data.classes[label]}#{part}")
    classes, labels = np.unique(names, return_inverse=True)
    return TrainingSet(
        tuple(clips),
        labels.astype(np.int64),
        data.subjects[rows],
        data.collections[rows],
        tuple(str(name) for name in classes),
    )
