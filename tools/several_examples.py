"""How several examples of an action should count: the best, their mean, in between, or attended to
as one.

    python tools/several_examples.py collections/*.npz --splits tools/splits.json \\
        --weights bench.safetensors

Asks the classes that training holds out: three examples of each of up to four actions of a
collection by half of its people, two queries of each and of as many other actions by the other
half. Prints closed accuracy, AUROC and OSCR in Markdown.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable
from pathlib import Path
from unittest.mock import patch

import numpy as np
from measure_windows import logits

from actioncli.clips.clip import FloatArray
from actioncli.clips.collection import read_collection
from actioncli.evaluation.metrics import auroc, oscr
from actioncli.evaluation.splits import read_splits
from actioncli.model import parts, parts_compare
from actioncli.model.config import PartsConfig
from actioncli.recognition.recognizer import Recognizer
from actioncli.training.data import hold_out, training_set

EXAMPLES, ASKED, OF_CLASS, MOST_WAYS = 3, 2, 24, 4
# From the log odds of the examples (actions, examples) to those of the actions.
WAYS: dict[str, Callable[[FloatArray], FloatArray]] = {
    "one example": lambda odds: odds[:, 0],
    "the best of three": lambda odds: odds.max(axis=1),
    "the second of three": lambda odds: np.sort(odds, axis=1)[:, -2],
    "their mean": lambda odds: odds.mean(axis=1),
    "the mean of their odds": lambda odds: np.log(np.exp(odds).mean(axis=1)),
}
ATTENDED = "attended to as one"


def attended(recognizer: Recognizer, query: FloatArray, examples: FloatArray) -> FloatArray:
    """Log odds (K,) of actions whose examples a query (T, E) attends to together, (K, n, T, E);
    each of them attends to the query alone."""
    params, config = recognizer.weights.tensors, recognizer.weights.config
    assert isinstance(config, PartsConfig)
    k, n, t = examples.shape[:3]
    asked = parts_compare._unpacked(config, query[None])
    each = parts_compare._unpacked(config, examples.reshape(k * n, t, -1))
    together = parts.Embedded(*(x.reshape(len(x), k, n * t, -1) for x in each))

    def one_way(queries: parts.Embedded, supports: parts.Embedded) -> FloatArray:
        return np.asarray(parts._one_way(params, config, queries, supports, lambda x: x))

    back = one_way(parts._side_by_side(each), asked)[0].reshape(k, n).mean(axis=1)
    with patch.object(parts, "_apart", lambda tokens: np.tile(_APART(tokens), (1, n))):
        there = one_way(asked, together)[:, 0]
    logit = (there + back) / 2
    return np.asarray(logit * params["confidence.scale"] + params["confidence.shift"])


_APART = parts._apart


def main() -> None:
    """See the module."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("collections", type=Path, nargs="+")
    parser.add_argument("--splits", type=Path, required=True)
    parser.add_argument("--weights", type=Path, required=True)
    parser.add_argument("--episodes", type=int, default=400)
    given = parser.parse_args()
    read = [read_collection(path) for path in given.collections]
    _, held = hold_out(training_set(read, read_splits(given.splits)), 0)
    rng = np.random.default_rng(0)
    rows = np.concatenate([rng.permutation(of)[:OF_CLASS] for of in held.members.values()])
    label, person, source = held.labels[rows], held.subjects[rows], held.collections[rows]
    recognizer = Recognizer(given.weights)
    embedded = recognizer.embed([held.clips[row] for row in rows])
    odds = logits(recognizer, embedded, embedded)
    found: dict[str, list[tuple[float, bool, bool]]] = {name: [] for name in (*WAYS, ATTENDED)}
    for _ in range(given.episodes):
        here = source == rng.choice(np.unique(source))
        classes = rng.permutation(np.unique(label[here]))
        ways = min(MOST_WAYS, len(classes) - 1)
        known, asked = classes[:ways], classes[: 2 * ways]
        people = rng.permutation(np.unique(person[here]))
        enrolling = np.isin(person, people[: max(1, len(people) // 2)])
        can = [np.flatnonzero((label == action) & enrolling) for action in known]
        if not can or min(map(len, can)) < EXAMPLES:
            continue
        examples = np.stack([rng.choice(places, EXAMPLES, replace=False) for places in can])
        for action in asked:
            places = np.flatnonzero((label == action) & ~enrolling)
            for query in rng.permutation(places)[:ASKED]:
                counted = {name: way(odds[query][examples]) for name, way in WAYS.items()}
                counted[ATTENDED] = attended(recognizer, embedded[query], embedded[examples])
                for name, of_actions in counted.items():
                    nearest = int(of_actions.argmax())
                    right = bool(known[nearest] == action)
                    found[name].append((float(of_actions[nearest]), right, action in known))
    print("| counts | closed accuracy | AUROC | OSCR | queries |\n| --- | --- | --- | --- | --- |")
    for name, answers in found.items():
        score, right, enrolled = map(np.array, zip(*answers, strict=True))
        area = oscr(score[enrolled], right[enrolled], score[~enrolled])
        figures = (right[enrolled].mean(), auroc(score[enrolled], score[~enrolled]), area)
        print(
            "|", name, "|", " | ".join(f"{figure:.3f}" for figure in figures), "|", len(right), "|"
        )


if __name__ == "__main__":
    main()
