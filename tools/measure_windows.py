"""Which parts of a query should be compared: the whole clip, its active part, or windows.

    python tools/measure_windows.py FOLDER --splits FILE --model WEIGHTS=COLLECTION,... ...

FOLDER holds the collections, each --model weights that never saw the named ones
(`tools/fit_score.py` makes such). Asked are their `train` classes; benchmark classes are not
touched, and clips of `excluded` classes stand before and after an action. Episodes are 5-way
(or all but two), 1-shot, cross-person, with a few queries each. Prints Markdown: one table of
queries that are recorded otherwise than the enrolled clips, one of enrolled clips with idling.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable, Mapping, Sequence
from itertools import pairwise
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from actioncli.clips.active import active_part
from actioncli.clips.clip import Clip, FloatArray
from actioncli.clips.collection import Collection, read_collection
from actioncli.clips.edit import cut
from actioncli.clips.prepare import sample
from actioncli.clips.skeleton import DEFAULT_JOINTS, select_joints
from actioncli.evaluation.episodes import Episode, Protocol, Sampler, possible_ways
from actioncli.evaluation.metrics import (
    auroc,
    closed_set_accuracy,
    false_accept_rate,
    false_reject_rate,
    oscr,
)
from actioncli.evaluation.splits import Split, read_splits
from actioncli.recognition.recognizer import Recognizer
from actioncli.recognition.threshold import DEFAULT_TAU
from actioncli.recognition.windows import CHANCES, windows

WAYS = 5
# Of each kind, known and unknown, in an episode.
QUERIES = 6
# Seconds from the last pose of one action to the first of the next.
_CHANGE = 0.5
_PELVIS = DEFAULT_JOINTS.index("pelv")

# Rows of a comparison: the whole clip, its active part, and its windows.
# A candidate chooses the confidence and the action from the rows' (R,) confidences and actions.
Rows = tuple[NDArray[np.float64], NDArray[np.intp]]
Candidate = Callable[[Rows], tuple[float, int]]
Situation = Callable[[FloatArray, float, "Other"], FloatArray]


class Other:
    """What a situation adds to a clip: other clips of the same collection, and chance."""

    def __init__(self, collection: Collection, split: Split, clip: int) -> None:
        self.rng = np.random.default_rng(clip)
        labels, people = collection.labels, collection.subjects
        self._collection = collection
        self._again = [
            n
            for n in range(len(labels))
            if (labels[n], people[n]) == (labels[clip], people[clip]) and n != clip
        ] or [clip]
        foreign = [n for n in range(len(labels)) if labels[n] in split.excluded]
        self._foreign = [n for n in foreign if people[n] == people[clip]] or foreign

    def again(self) -> FloatArray:
        """The action once more by the same person."""
        return _joints(self._collection.clips[self.rng.choice(self._again)])

    def foreign(self) -> FloatArray:
        """An action that is neither enrolled nor asked for."""
        return _joints(self._collection.clips[self.rng.choice(self._foreign)])

    def held(self, pose: FloatArray, seconds: float, fps: float) -> FloatArray:
        """A pose held by a person who sways (6 mm), seen by a sensor with noise (2 mm)."""
        frames = round(seconds * fps)
        window = np.hanning(max(3, round(0.7 * fps)) + 2)
        drift = self.rng.normal(size=(frames, len(pose) + 1, 3))
        drift = np.apply_along_axis(np.convolve, 0, drift, window, "same")
        drift *= 0.006 / drift.std()
        return np.asarray(
            pose + drift[:, :-1] + drift[:, -1:] + self.rng.normal(0, 0.002, (frames, *pose.shape))
        )


def as_recorded(joints: FloatArray, fps: float, other: Other) -> FloatArray:
    """One performance, most often from rest to rest."""
    return joints


def idling(seconds: float) -> Situation:
    """Standing still before and after."""
    return lambda joints, fps, other: np.concatenate(
        [other.held(joints[0], seconds, fps), joints, other.held(joints[-1], seconds, fps)]
    )


def between(joints: FloatArray, fps: float, other: Other) -> FloatArray:
    """The person does something else before and after, without rest."""
    return _one_after_another([other.foreign(), joints, other.foreign()], fps)


def twice(joints: FloatArray, fps: float, other: Other) -> FloatArray:
    """Two performances."""
    return _one_after_another([joints, other.again()], fps)


def part(first: float, last: float) -> Situation:
    """The recording misses the beginning or the end."""
    return lambda joints, fps, other: joints[int(first * len(joints)) : int(last * len(joints))]


def lasting(share: float) -> Situation:
    """Performed so many times as long."""
    return lambda joints, fps, other: sample(joints, max(4, round(share * len(joints))))


def _one_after_another(parts: Sequence[FloatArray], fps: float) -> FloatArray:
    """On one spot; between two, joints go straight from pose to pose, slow at both ends."""
    time = np.linspace(0, 1, round(_CHANGE * fps) + 2)[1:-1, None, None]
    share = time * time * (3 - 2 * time)
    centred = [joints - joints[:1, [_PELVIS]] for joints in parts]
    joined = [centred[0]]
    for before, after in pairwise(centred):
        joined += [before[-1] * (1 - share) + after[:1] * share, after]
    return np.concatenate(joined)


def _joints(clip: Clip) -> FloatArray:
    return select_joints(clip.joints, clip.joint_names, DEFAULT_JOINTS)


SITUATIONS: Mapping[str, Situation] = {
    "as recorded": as_recorded,
    **{f"{s} s idling before and after": idling(s) for s in (1, 2, 4)},
    "between two other actions": between,
    "twice": twice,
    "first 70 %": part(0, 0.7),
    "last 70 %": part(0.3, 1),
    "1.5 times as slow": lasting(1.5),
    "1.5 times as fast": lasting(1 / 1.5),
}

# Those that are also measured on the enrolled clips.
ENROLLED = ("as recorded", "2 s idling before and after")


def only(row: int) -> Candidate:
    """One row, whatever the others say."""
    return lambda rows: (float(rows[0][row]), int(rows[1][row]))


def surest(chances: float, first: int = 2) -> Candidate:
    """The whole clip or the surest of the rows from `first` on, N of them, whose odds against a
    match are multiplied by N ** chances."""

    def choose(rows: Rows) -> tuple[float, int]:
        confidence, action = rows
        competing = confidence[first:] if first > 1 else confidence[first : first + 1]
        odds = max(len(competing), 1) ** chances
        lowered = np.concatenate([confidence[:1], competing / (competing + (1 - competing) * odds)])
        best = int(lowered.argmax())
        return float(lowered[best]), int(action[best + first - 1 if best else 0])

    return choose


CANDIDATES: Mapping[str, Candidate] = {
    "whole clip": only(0),
    "active part": only(1),
    "whole or active part": surest(0, first=1),
    **{f"whole or window, power {power:g}": surest(power) for power in (0, 0.1, 0.2, 0.3, 0.5)},
}


def figures(answers: Sequence[tuple[float, int, int]]) -> NDArray[np.float64]:
    """Accuracy, AUROC, OSCR, false accepts and rejects of (confidence, action, target) each."""
    score, action, target = (np.array(column) for column in zip(*answers, strict=True))
    known = target >= 0
    right = action[known] == target[known]
    return np.array(
        [
            closed_set_accuracy(right),
            auroc(score[known], score[~known]),
            oscr(score[known], right, score[~known]),
            false_accept_rate(score[~known], DEFAULT_TAU),
            false_reject_rate(score[known], DEFAULT_TAU),
        ]
    )


def queries(episode: Episode) -> list[tuple[int, int]]:
    """A few clips and their targets, spread over classes."""
    found = []
    for kind in (episode.target >= 0, episode.target < 0):
        which = np.flatnonzero(kind)
        spread = which[np.linspace(0, len(which) - 1, min(QUERIES, len(which))).astype(int)]
        found += [(int(episode.queries[n]), int(episode.target[n])) for n in spread]
    return found


class Study:
    """One collection, asked by a model that has not seen it."""

    def __init__(self, weights: Path, collection: Collection, split: Split, episodes: int) -> None:
        self._recognizer, self._collection, self._split = Recognizer(weights), collection, split
        sampler = Sampler(
            collection.name,
            collection.labels,
            collection.subjects,
            split.train,
            Protocol.CROSS_PERSON,
        )
        ways = possible_ways(WAYS, len(split.train))
        self._episodes = [sampler.episode(ways, number) for number in range(episodes)]

    def _made(self, clip: int, situation: Situation) -> Clip:
        shown = self._collection.clips[clip]
        other = Other(self._collection, self._split, clip)
        return Clip(situation(_joints(shown), shown.fps, other), DEFAULT_JOINTS, shown.fps)

    def of_queries(self, situation: Situation) -> dict[str, NDArray[np.float64]]:
        """Figures of every candidate."""
        answers: dict[str, list[tuple[float, int, int]]] = {name: [] for name in CANDIDATES}
        for episode in self._episodes:
            enrolled = [self._collection.clips[n] for n in episode.support[:, 0]]
            support = self._recognizer.embed(enrolled)
            for clip, target in queries(episode):
                rows = self._rows(self._made(clip, situation), enrolled, support)
                for name, candidate in CANDIDATES.items():
                    answers[name].append((*candidate(rows), target))
        return {name: figures(given) for name, given in answers.items()}

    def of_enrolled(self, situation: Situation, trimmed: bool) -> NDArray[np.float64]:
        """Figures where enrolled clips are in a situation, and perhaps cut to the active part."""
        answers = []
        for episode in self._episodes:
            enrolled = [self._made(n, situation) for n in episode.support[:, 0]]
            if trimmed:
                enrolled = [cut(clip, *active_part(clip)) for clip in enrolled]
            support = self._recognizer.embed(enrolled)
            for clip, target in queries(episode):
                rows = self._rows(self._made(clip, as_recorded), enrolled, support)
                answers.append((*surest(CHANCES)(rows), target))
        return figures(answers)

    def _rows(self, query: Clip, enrolled: Sequence[Clip], support: FloatArray) -> Rows:
        parts = [query, cut(query, *active_part(query))]
        parts += windows(query, [clip.duration for clip in enrolled])
        actions = {str(n): support[n : n + 1] for n in range(len(support))}
        comparison = self._recognizer.compare(parts, actions)
        nearest = comparison.distance.argmin(axis=1)
        confidence = np.take_along_axis(comparison.confidence, nearest[:, None], axis=1)[:, 0]
        return confidence.astype(np.float64), nearest


def tell(first: str, second: str, each: Sequence[Mapping[str, NDArray[np.float64]]]) -> None:
    """Print rows: means over collections."""
    for name in each[0]:
        mean = np.mean([one[name] for one in each], axis=0)
        shown = " | ".join(f"{figure:.3f}" for figure in mean)
        print(f"| {first} | {name}{second} | {shown} |", flush=True)


def main() -> None:
    """Print the tables."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--splits", type=Path, required=True)
    parser.add_argument("--model", action="append", required=True, metavar="WEIGHTS=COLLECTION,...")
    parser.add_argument("--episodes", type=int, default=20)
    parser.add_argument("--situations", nargs="+", choices=SITUATIONS, default=list(SITUATIONS))
    asked = parser.parse_args()
    splits = read_splits(asked.splits)
    studies = []
    for model in asked.model:
        weights, _, names = model.partition("=")
        for name in names.split(","):
            collection = read_collection(asked.folder / f"{name}.npz")
            split = splits.by_collection[name]
            studies.append(Study(Path(weights), collection, split, asked.episodes))
    header = "closed accuracy | AUROC | OSCR | false accepts | false rejects |"
    print(f"| queries | compared | {header}\n|{' --- |' * 7}", flush=True)
    for name in asked.situations:
        tell(name, "", [study.of_queries(SITUATIONS[name]) for study in studies])
    print(f"\n| enrolled clips | used | {header}\n|{' --- |' * 7}", flush=True)
    for name in asked.situations:
        if name not in ENROLLED:
            continue
        for used, trimmed in (("whole clip", False), ("active part", True)):
            situation = SITUATIONS[name]
            tell(name, "", [{used: study.of_enrolled(situation, trimmed)} for study in studies])


if __name__ == "__main__":
    main()
