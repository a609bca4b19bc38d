"""The one-shot protocol of NTU RGB+D 120 as arXiv 2209.04288 runs it, for those who have it.

The data set (arXiv 1905.04757) keeps every sixth action for one-shot recognition and names one
sample of each as its only example. Three of these twenty actions need two people (A55 hugging,
A109 grabbing somebody's stuff, A115 photographing somebody) and are left out. K of the
remaining seventeen are enrolled by their named sample; all other samples of all seventeen are
queries, so known and unknown ones are not equally many, and rejecting everything is right for
about (17 - K) / 17 of them.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from actioncli.clips.clip import Clip
from actioncli.clips.read import read_clip
from actioncli.errors import ClipError
from actioncli.evaluation.acceptance import Acceptance, Table
from actioncli.evaluation.protocol import EpisodeScores
from actioncli.evaluation.result import Evaluation, Result, Skipped
from actioncli.evaluation.scorer import Scorer
from actioncli.evaluation.task import CLIPS_AT_ONCE, Progress, Steps

NAME = "ntu-rgb-d-120"
WAYS = tuple(range(5, 16))
_TWO_PEOPLE = (55, 109, 115)

# The named sample of each class: third camera, eighth performer, first repetition; actions
# above 60 were recorded later, from setup 18 on.
EXEMPLARS = {
    f"A{action:03d}": f"S{1 if action <= 60 else 18:03d}C003P008R001A{action:03d}"
    for action in range(1, 121, 6)
    if action not in _TWO_PEOPLE
}

# Setup, camera, performer, repetition, action.
_SAMPLE = re.compile(r"S\d{3}C\d{3}P\d{3}R\d{3}(A\d{3})")


@dataclass(frozen=True, slots=True)
class NtuMeasurement:
    """What the protocol found: figures for each K, and each exemplar against all queries."""

    evaluation: Evaluation
    acceptance: Acceptance


def evaluate_ntu(
    scorer: Scorer,
    folder: str | Path,
    *,
    ways: Sequence[int] = WAYS,
    episodes: int = 100,
    tau: float = 0.5,
    seed: int = 0,
    progress: Progress | None = None,
) -> NtuMeasurement:
    """Run the protocol on a folder of `.skeleton` files, searched with its subfolders.

    An episode draws K classes. Queries and exemplars are the same in all of them, so each pair
    is compared once. Samples without a usable body are skipped and counted.

    Args:
        scorer: what is measured.
        folder: with files named like `S001C003P008R001A001.skeleton`.
        ways: numbers K of enrolled classes, at most 16.
        episodes: draws of classes for each K.
        tau: accept means confidence > tau.
        seed: of the draws.
        progress: told about every step.

    Raises:
        ClipError: an exemplar is missing or unusable, or a class has no other sample.
    """
    labels = list(EXEMPLARS)
    files = _samples(Path(folder))
    step = Steps(progress, len(files) + len(ways) * episodes)
    support = {
        label: scorer.embed([read_clip(files.pop(name))]) for label, name in EXEMPLARS.items()
    }
    step(f"{NAME}: exemplars", len(support))
    distances, confidences, shown, unusable = [], [], [], []
    for batch in _batches(list(files.values())):
        clips: list[Clip] = []
        for file in batch:
            try:
                clips.append(read_clip(file))
                shown.append(_action(file))
            except ClipError as error:
                unusable.append(str(error))
        if clips:
            compared = scorer.compare(scorer.embed(clips), support)
            distances.append(compared.distance)
            confidences.append(compared.confidence)
        step(f"{NAME}: comparing", len(batch))
    missing = sorted(set(labels) - set(shown))
    if missing:
        raise ClipError(f"{folder}: no usable sample beside the exemplar of {', '.join(missing)}.")
    distance, confidence = np.concatenate(distances), np.concatenate(confidences)
    target = np.array([labels.index(label) for label in shown])

    results: list[Result] = []
    for k in ways:
        asked = EpisodeScores()
        for number in range(episodes):
            enrolled = np.random.default_rng([seed, k, number]).permutation(len(labels))[:k]
            place = np.full(len(labels), -1)
            place[enrolled] = np.arange(k)
            asked.add(distance[:, enrolled], confidence[:, enrolled], place[target], tau)
            step(f"{NAME}: {k}-way")
        results.append(asked.result(NAME, k, len(labels)))
    table = Table(NAME, labels)
    table.add(labels, shown, confidence > tau)
    skipped = (Skipped(NAME, f"{len(unusable)} samples, {unusable[0]}"),) if unusable else ()
    return NtuMeasurement(
        Evaluation(
            scorer=scorer.name,
            protocol="ntu-one-shot",
            shots=1,
            episodes=episodes,
            tau=tau,
            seed=seed,
            results=tuple(results),
            means=(),
            skipped=skipped,
        ),
        table.acceptance(),
    )


def _samples(folder: Path) -> dict[str, Path]:
    """Samples of the seventeen classes by name, in the order of their names."""
    files = {file.stem: file for file in sorted(folder.rglob("*.skeleton"))}
    named = {name: file for name, file in sorted(files.items()) if _action(file) in EXEMPLARS}
    missing = [name for name in EXEMPLARS.values() if name not in named]
    if missing:
        raise ClipError(
            f"{folder}: the protocol needs these exemplars, which are not there: "
            f"{', '.join(f'{name}.skeleton' for name in missing)}."
        )
    return named


def _action(file: Path) -> str:
    match = _SAMPLE.fullmatch(file.stem)
    return match[1] if match else ""


def _batches(files: Sequence[Path]) -> Iterator[Sequence[Path]]:
    for start in range(0, len(files), CLIPS_AT_ONCE):
        yield files[start : start + CLIPS_AT_ONCE]
