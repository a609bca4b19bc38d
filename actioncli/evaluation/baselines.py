"""What a recogniser must beat: scorers with its interface but without training.

A baseline's distance decides which action is nearest, its confidence whether that is accepted.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import zip_longest
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from actioncli.clips.clip import Clip, FloatArray
from actioncli.clips.edit import mirrored
from actioncli.clips.prepare import Preparation, prepare
from actioncli.errors import SupportError, UsageError
from actioncli.evaluation.splits import Splits
from actioncli.evaluation.warping import warping_cost
from actioncli.recognition.decision import Comparison
from actioncli.recognition.recognizer import Recognizer

if TYPE_CHECKING:
    from actioncli.clips.collection import Collection

# Neighbours in the cohort that tell how densely motions lie around a clip.
_NEIGHBOURS = 10


class Dtw:
    """Dynamic time warping on prepared frames, nearest example first.

    Without a cohort the confidence is exp(-distance), which orders queries but means nothing
    as a probability. With one, the distance is divided by the geometric mean of how far the
    query and the example lie from their nearest neighbours among the cohort's motions, as
    speaker verification normalises scores; then 1 / (1 + distance) is 0.5 where they are as far
    from one another as from these.
    """

    def __init__(self, preparation: Preparation, cohort: Sequence[Clip] = ()) -> None:
        """Prepare the cohort.

        Args:
            preparation: what is done to every clip.
            cohort: motions that show none of the actions to be measured; empty for none.
        """
        self.preparation = preparation
        self.name = "dtw-cohort" if cohort else "dtw"
        self._cohort = self._frames(cohort)

    def embed(self, clips: Sequence[Clip]) -> NDArray[Any]:
        """(N,) records: `frames` (F, J, 3), and `radius`, the distance to the cohort (or 1)."""
        frames = self._frames(clips)
        embedded = np.empty(
            len(clips), dtype=[("frames", np.float32, frames.shape[1:]), ("radius", np.float32)]
        )
        embedded["frames"] = frames
        embedded["radius"] = self._radius(frames)
        return embedded

    def compare(self, queries: NDArray[Any], support: Mapping[str, NDArray[Any]]) -> Comparison:
        """Distance to an action is that to the nearest of its examples.

        Raises:
            SupportError: no action, or an action without examples.
        """
        counts = _counts(support)
        examples = np.concatenate(list(support.values()))
        pairs = _cost(queries["frames"], examples["frames"])
        pairs /= np.sqrt(queries["radius"][:, None] * examples["radius"])
        distance: FloatArray = np.minimum.reduceat(pairs, np.cumsum([0, *counts[:-1]]), axis=1)
        confidence = np.exp(-distance) if not len(self._cohort) else np.reciprocal(1 + distance)
        return _comparison(support, distance, confidence)

    def _frames(self, clips: Sequence[Clip]) -> FloatArray:
        shape = (self.preparation.frames, len(self.preparation.joints), 3)
        frames = [prepare(clip, self.preparation) for clip in clips]
        return np.stack(frames) if frames else np.empty((0, *shape), np.float32)

    def _radius(self, frames: FloatArray) -> FloatArray:
        if not len(self._cohort):
            return np.ones(len(frames), np.float32)
        distance = _cost(frames, self._cohort)
        nearest = np.sort(distance, axis=1)[:, :_NEIGHBOURS]
        radius: FloatArray = np.maximum(nearest.mean(axis=1), np.float32(1e-6))
        return radius


def cohort_clips(
    collections: Sequence[Collection], splits: Splits, size: int = 256, seed: int = 0
) -> list[Clip]:
    """Motions to normalise by: clips of the train classes, equally many of each collection.

    Raises:
        UsageError: the splits do not fit the collections, or name no train class.
    """
    rng = np.random.default_rng(seed)
    trained: list[list[Clip]] = []
    for collection in collections:
        classes = set(splits.names(collection.name, "train", collection.labels))
        numbers = [clip for clip, label in enumerate(collection.labels) if label in classes]
        trained.append([collection.clips[clip] for clip in rng.permutation(numbers)])
    # in turn from all collections, so that each gives its share while it has clips
    drawn = [clip for turn in zip_longest(*trained) for clip in turn if clip is not None][:size]
    if not drawn:
        raise UsageError(f"{splits.source}: names no train classes to draw a cohort from.")
    return drawn


class Exp:
    """EXP of the paper: exp(-T) of the nearest action stands in for the discriminator."""

    name = "exp"

    def __init__(self, recognizer: Recognizer) -> None:
        """Take distances from `recognizer`."""
        self._recognizer = recognizer

    def embed(self, clips: Sequence[Clip]) -> FloatArray:
        """As the recogniser does."""
        return self._recognizer.embed(clips)

    def compare(self, queries: NDArray[Any], support: Mapping[str, NDArray[Any]]) -> Comparison:
        """As the recogniser does, with another confidence."""
        compared = self._recognizer.compare(queries, support)
        return _comparison(support, compared.distance, np.exp(-compared.distance))


class EitherSide:
    """The recogniser where every example is enrolled with its mirror image beside it."""

    def __init__(self, recognizer: Recognizer) -> None:
        """Compare as `recognizer` does."""
        self._recognizer, self.name = recognizer, f"{recognizer.name}, either side"

    def embed(self, clips: Sequence[Clip]) -> FloatArray:
        """(N, 2, F, E): each clip, and its mirror image."""
        views = [self._recognizer.embed(each) for each in (clips, [*map(mirrored, clips)])]
        return np.stack(views, axis=1)

    def compare(self, queries: NDArray[Any], support: Mapping[str, NDArray[Any]]) -> Comparison:
        """As the recogniser does; queries are not mirrored."""
        both = {label: np.concatenate([each[:, 0], each[:, 1]]) for label, each in support.items()}
        return self._recognizer.compare(queries[:, 0], both)


class AlwaysReject:
    """Says unknown to everything; all actions are equally near."""

    name = "always-reject"

    def embed(self, clips: Sequence[Clip]) -> FloatArray:
        """Nothing: (N, 0)."""
        return np.empty((len(clips), 0), np.float32)

    def compare(self, queries: NDArray[Any], support: Mapping[str, NDArray[Any]]) -> Comparison:
        """Distance and confidence 0.

        Raises:
            SupportError: no action, or an action without examples.
        """
        nothing = np.zeros((len(queries), len(_counts(support))), np.float32)
        return _comparison(support, nothing, nothing)


class Random(AlwaysReject):
    """Guesses, anew in each comparison; the guesses of a run follow from its seed."""

    name = "random"

    def __init__(self, seed: int = 0) -> None:
        """Seed the guesses."""
        self._rng = np.random.default_rng(seed)

    def compare(self, queries: NDArray[Any], support: Mapping[str, NDArray[Any]]) -> Comparison:
        """Distance and confidence uniform in [0, 1) and independent of one another.

        Raises:
            SupportError: no action, or an action without examples.
        """
        guess = self._rng.random((2, len(queries), len(_counts(support))), dtype=np.float32)
        return _comparison(support, guess[0], guess[1])


def _cost(queries: NDArray[Any], supports: NDArray[Any]) -> FloatArray:
    """Warping cost (Q, S), frames apart by the root mean square over joints."""
    joints = queries.shape[2]
    flat = [frames.reshape(*frames.shape[:2], -1) for frames in (queries, supports)]
    return np.asarray(warping_cost(*flat) / joints**0.5, np.float32)


def _counts(support: Mapping[str, NDArray[Any]]) -> list[int]:
    if not support:
        raise SupportError("the support set is empty; enrol an action first.")
    for label, clips in support.items():
        if not len(clips):
            raise SupportError(f"the action {label!r} has no examples.")
    return [len(clips) for clips in support.values()]


def _comparison(
    support: Mapping[str, NDArray[Any]], distance: FloatArray, confidence: FloatArray
) -> Comparison:
    weights = np.exp(distance.min(axis=1, keepdims=True) - distance)
    return Comparison(
        labels=np.array(list(support), dtype=np.str_),
        distance=distance,
        confidence=confidence,
        probability=weights / weights.sum(axis=1, keepdims=True),
    )
