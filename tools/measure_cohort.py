"""What it would bring to judge a score beside how like a clip is to motions of no action.

    python tools/measure_cohort.py collections/*.npz --splits tools/splits.json \\
        --weights bench.safetensors

Asks the classes that training holds out, in the episodes of validation. From the logit of a query
and an example, a share of the mean logit of the two to their K nearest motions of a cohort is
taken: the weights' own, or training clips. Prints closed accuracy, AUROC and OSCR in Markdown.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np
from measure_windows import logits

from actioncli.clips.clip import FloatArray
from actioncli.clips.collection import read_collection
from actioncli.evaluation.metrics import auroc, oscr
from actioncli.evaluation.splits import read_splits
from actioncli.recognition.recognizer import Recognizer
from actioncli.training.data import hold_out, training_set
from actioncli.training.validation import Validation

NEAREST, SHARES, CLIPS = (3, 5, 10), (0.5, 1.0, 1.5), 256


def main() -> None:
    """See the module."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("collections", type=Path, nargs="+")
    parser.add_argument("--splits", type=Path, required=True)
    parser.add_argument("--weights", type=Path, required=True)
    given = parser.parse_args()
    read = [read_collection(path) for path in given.collections]
    data, held = hold_out(training_set(read, read_splits(given.splits)), 0)
    recognizer = Recognizer(given.weights)
    validation = Validation(held, recognizer.weights.config, 0)
    embedded = recognizer.embed(validation._clips)
    chosen = np.random.default_rng(1).choice(len(data.clips), CLIPS, replace=False)
    cohorts = {
        f"the {len(recognizer.cohort)} of the weights": recognizer.cohort,
        f"{CLIPS} training clips": recognizer.embed([data.clips[row] for row in chosen]),
    }

    def say(name: str, taken: FloatArray) -> None:
        """A line, where `taken` (N,) of each clip is taken from its logits."""
        score, right, enrolled = [], [], []
        for (support, asked, targets), logit in zip(validation._episodes, raw, strict=True):
            less = logit - taken[asked][:, None] - taken[support]
            nearest = less.argmax(axis=1)
            score.append(less.max(axis=1))
            right.append(nearest == targets)
            enrolled.append(targets >= 0)
        scores, hits, known = map(np.concatenate, (score, right, enrolled))
        figures = (
            hits[known].mean(),
            auroc(scores[known], scores[~known]),
            oscr(scores[known], hits[known], scores[~known]),
        )
        print("|", name, "|", " | ".join(f"{figure:.3f}" for figure in figures), "|", flush=True)

    raw = [logits(recognizer, embedded[asked], embedded[support])
           for support, asked, _ in validation._episodes]  # fmt: skip
    print("| cohort | closed accuracy | AUROC | OSCR |\n| --- | --- | --- | --- |")
    say("none", np.zeros(len(embedded), np.float32))
    for name, cohort in cohorts.items():
        near = np.sort(logits(recognizer, embedded, cohort), axis=1)
        for k in NEAREST:
            for share in SHARES:
                say(f"{name}, {k} nearest, {share:g}", share / 2 * near[:, -k:].mean(axis=1))


if __name__ == "__main__":
    main()
