"""What the windows of a long clip cost and find: the constants of `recognition/windows.py`.

    python tools/measure_windows.py collections/*.npz --splits tools/splits.json \\
        --weights bench.safetensors

Asks the classes that training holds out. Of up to four actions of a collection one clip each is
enrolled by one person; another person's clips are asked alone, and in the middle of a long clip
between two of the person's clips that show none of the four. Prints, over the power of the number
of windows by which odds count less, the share of clips accepted at 0.5: of enrolled actions, if
rightly named, and of others.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np
from measure_live import FPS, joined, joints_of

from actioncli.clips.clip import Clip, FloatArray
from actioncli.clips.collection import read_collection
from actioncli.clips.skeleton import DEFAULT_JOINTS
from actioncli.evaluation.splits import read_splits
from actioncli.recognition.recognizer import Recognizer
from actioncli.recognition.windows import windows
from actioncli.training.data import TrainingSet, hold_out, training_set

MOST_WAYS, FEWEST = 4, 5
POWERS = (0.0, 0.15, 0.3, 0.45, 0.6, 0.8, 1.0)


def episode(
    data: TrainingSet, rng: np.random.Generator
) -> tuple[list[Clip], list[tuple[int, Clip, Clip]]]:
    """Enrolled clips; and queries: which action (-1 for none), alone, and in a long clip."""

    def clip(row: np.int64) -> Clip:
        return Clip(joints_of(data.clips[row]), DEFAULT_JOINTS, FPS)

    while True:
        source = rng.choice(np.unique(data.collections))
        here = data.collections == source
        classes = rng.permutation(np.unique(data.labels[here]))
        people = rng.permutation(np.unique(data.subjects[here]))
        if len(classes) < FEWEST or len(people) < 2:
            continue
        known = classes[: min(MOST_WAYS, len(classes) - 3)]

        def rows(action: np.int64, person: np.int64) -> np.ndarray:  # type: ignore[type-arg]
            return np.flatnonzero((data.labels == action) & (data.subjects == person))

        enrolled = [rows(action, people[0]) for action in known]
        asked = {int(action): rows(action, people[1]) for action in classes}
        others = [of for action, of in asked.items() if action not in known and len(of)]
        if not all(map(len, enrolled)) or len(others) < 3:
            continue
        queries = []
        targets = [(way, asked[int(action)]) for way, action in enumerate(known)]
        for target, of in [*targets, (-1, others[0])]:
            if len(of):
                middle = clip(rng.choice(of))
                beside = [clip(rng.choice(others[at])) for at in (1, 2)]
                parts = [(each.joints, None, 1) for each in (beside[0], middle, beside[1])]
                queries.append((target, middle, joined("", parts, {}).clip))
        return [clip(rng.choice(of)) for of in enrolled], queries


def logits(recognizer: Recognizer, clips: list[Clip], enrolled: list[Clip]) -> FloatArray:
    """(clips, enrolled) log odds."""
    compared = recognizer.compare(clips, {str(way): [each] for way, each in enumerate(enrolled)})
    return np.asarray(-np.log(compared.distance))


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
