"""What the windows of a long clip cost and find: the constants of `recognition/windows.py`.

    python tools/measure_windows.py collections/*.npz --splits tools/splits.json \\
        --weights bench.safetensors

Asks the classes that training holds out. Of up to four actions of a collection one clip each is
enrolled; other people's clips of these, and of an action that is not enrolled, are asked alone, and
in the middle of a long clip between two clips of something else. Prints, over the power of the
number of windows by which odds count less, the share of clips accepted at 0.5: of enrolled actions,
if rightly named, and of others.
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from measure_live import FPS, joined, joints_of

from actioncli.clips.clip import Clip, FloatArray
from actioncli.clips.collection import read_collection
from actioncli.clips.skeleton import DEFAULT_JOINTS
from actioncli.evaluation.splits import read_splits
from actioncli.model.parts_compare import EXACT
from actioncli.recognition.recognizer import Recognizer
from actioncli.recognition.windows import windows
from actioncli.training.data import TrainingSet, hold_out, query_of, training_set

MOST_WAYS = 4
POWERS = (0.0, 0.1, 0.15, 0.2, 0.3, 0.5)


def episode(
    data: TrainingSet, rng: np.random.Generator
) -> tuple[list[Clip], list[tuple[int, Clip, Clip]]]:
    """Enrolled clips; and queries: which action (-1 for none), alone, and in a long clip."""

    def clip(row: np.int64) -> Clip:
        return Clip(joints_of(data.clips[row]), DEFAULT_JOINTS, FPS)

    source = rng.choice([each for each in np.unique(data.collections)
                         if len(np.unique(data.labels[data.collections == each])) > 1])  # fmt: skip
    classes = rng.permutation(np.unique(data.labels[data.collections == source])).tolist()
    known, others = classes[: min(MOST_WAYS, len(classes) - 1)], classes[-1:]
    enrolled = [rng.choice(data.members[action]) for action in known]
    queries = []
    targets = [*enumerate(known), *((-1, action) for action in others)]
    for target, action in targets:
        taken = enrolled[target] if target >= 0 else data.members[action][0]
        middle = clip(query_of(data, data.members[action], taken, rng))
        beside = rng.choice(np.flatnonzero(~np.isin(data.labels, [*known, action])), 2)
        parts = [clip(beside[0]), middle, clip(beside[1])]
        long = joined("", [(each.joints, None, 1) for each in parts], {}).clip
        queries.append((target, middle, long))
    return [clip(row) for row in enrolled], queries


def logits(
    recognizer: Recognizer,
    queries: Sequence[Clip] | FloatArray,
    examples: Sequence[Clip] | FloatArray,
) -> FloatArray:
    """Log odds (queries, examples) of clips or their embeddings, all of them compared in full."""
    asked, enrolled = recognizer.embed(queries), recognizer.embed(examples)
    found = []
    for start in range(0, len(enrolled), EXACT):
        block = enrolled[start : start + EXACT, None]
        actions = {str(place): example for place, example in enumerate(block)}
        found.append(-np.log(recognizer.compare(asked, actions).distance))
    return np.concatenate(found, axis=1)


def main() -> None:
    """See the module."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("collections", type=Path, nargs="+")
    parser.add_argument("--splits", type=Path, required=True)
    parser.add_argument("--weights", type=Path, required=True)
    parser.add_argument("--episodes", type=int, default=150)
    given = parser.parse_args()
    read = [read_collection(path) for path in given.collections]
    _, held = hold_out(training_set(read, read_splits(given.splits)), 0)
    recognizer, rng = Recognizer(given.weights), np.random.default_rng(0)
    accepted: dict[tuple[float | None, bool], list[bool]] = {}
    for number in range(given.episodes):
        enrolled, queries = episode(held, rng)
        for target, alone, long in queries:
            found: dict[float | None, FloatArray] = {
                None: logits(recognizer, [alone], enrolled).max(axis=0)
            }
            of_whole = logits(recognizer, [long], enrolled)
            parts = [*windows(long, [each.duration for each in enrolled])]
            of_parts = logits(recognizer, parts, enrolled) if parts else of_whole[:0]
            for power in POWERS:
                less = power * np.log(max(len(parts), 1))
                found[power] = np.concatenate([of_whole, of_parts - less]).max(axis=0)
            for power, sure in found.items():
                right = target < 0 or int(sure.argmax()) == target
                accepted.setdefault((power, target < 0), []).append(bool(sure.max() > 0 and right))
        if (number + 1) % 25 == 0:
            print(f"{number + 1} of {given.episodes} episodes", flush=True)
    print("\n| power | enrolled action accepted | something else accepted |\n| --- | --- | --- |")
    for power in (None, *POWERS):
        shares = [np.mean(accepted[power, unknown]) for unknown in (False, True)]
        print(f"| {'alone' if power is None else power} | {shares[0]:.3f} | {shares[1]:.3f} |")
    print(f"\n{len(accepted[None, False])} and {len(accepted[None, True])} queries")


if __name__ == "__main__":
    main()
