"""What it would bring to judge a score beside how like a clip is to motions of no action.

    python tools/measure_cohort.py collections/*.npz --splits tools/splits.json \\
        --weights bench.safetensors

Asks the classes that training holds out, in the episodes of validation. From the logit of a query
and an example, a share of the mean logit of the two to their K nearest motions of a cohort is
taken: the weights' own, or training clips. Prints OSCR in Markdown: of episodes across collections,
and of those within each one, since a user has one camera.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np
from measure_windows import logits
from numpy.typing import NDArray

from actioncli.clips.clip import FloatArray
from actioncli.clips.collection import read_collection
from actioncli.evaluation.metrics import oscr
from actioncli.evaluation.splits import read_splits
from actioncli.model import parts_compare
from actioncli.recognition.recognizer import Recognizer
from actioncli.training.data import hold_out, training_set
from actioncli.training.validation import Validation

NEAREST, SHARES, CLIPS = (3, 5, 10), (0.5, 1.0, 1.5), 400


def main() -> None:
    """See the module."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("collections", type=Path, nargs="+")
    parser.add_argument("--splits", type=Path, required=True)
    parser.add_argument("--weights", type=Path, required=True)
    given = parser.parse_args()
    parts_compare.MOST_HIDDEN = 1.0  # what is out of view is another question
    read = [read_collection(path) for path in given.collections]
    data, held = hold_out(training_set(read, read_splits(given.splits)), 0)
    recognizer = Recognizer(given.weights)
    validation = Validation(held, recognizer.weights.config, 0)
    embedded = recognizer.embed(validation._clips)
    number = {id(clip): row for row, clip in enumerate(held.clips)}
    source = held.collections[[number[id(clip)] for clip in validation._clips]]
    places = [
        read[source[support[0]]].name
        if (source[asked] == source[support[0]]).all() and len({*source[support]}) == 1
        else "across"
        for support, asked, _ in validation._episodes
    ]
    chosen = np.random.default_rng(1).choice(len(data.clips), CLIPS, replace=False)
    cohorts = {
        f"the {len(recognizer.cohort)} of the weights": recognizer.cohort,
        f"{CLIPS} training clips": recognizer.embed([data.clips[row] for row in chosen]),
    }

    def say(name: str, taken: FloatArray) -> None:
        """A line, where `taken` (N,) of each clip is taken from its logits."""
        found: dict[str, list[tuple[FloatArray, NDArray[np.bool_], NDArray[np.bool_]]]] = {}
        for (support, asked, targets), logit, place in zip(
            validation._episodes, raw, places, strict=True
        ):
            less = logit - taken[asked][:, None] - taken[support]
            right = less.argmax(axis=1) == targets
            found.setdefault(place, []).append((less.max(axis=1), right, targets >= 0))
        figures = {}
        for place, asked in sorted(found.items()):
            score, right, known = map(np.concatenate, zip(*asked, strict=True))
            figures[place] = oscr(score[known], right[known], score[~known])
        within = [figure for place, figure in figures.items() if place != "across"]
        told = [*figures.values(), float(np.mean(within))]
        print("|", name, "|", " | ".join(f"{figure:.3f}" for figure in told), "|", flush=True)

    raw = [logits(recognizer, embedded[asked], embedded[support])
           for support, asked, _ in validation._episodes]  # fmt: skip
    head = ["cohort", *sorted({*places}), "mean within one"]
    print("|", " | ".join(head), "|\n|", " | ".join(["---"] * len(head)), "|")
    say("none", np.zeros(len(embedded), np.float32))
    for name, cohort in cohorts.items():
        near = np.sort(logits(recognizer, embedded, cohort), axis=1)
        for k in NEAREST:
            for share in SHARES:
                say(f"{name}, {k} nearest, {share:g}", share / 2 * near[:, -k:].mean(axis=1))


if __name__ == "__main__":
    main()
