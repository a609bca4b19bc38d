"""Fit the constants of the default recipe's score (`_SCORE` in actioncli/training/closing.py).

    python tools/fit_score.py FOLDER --splits FILE --work FOLDER [--steps 1500]

FOLDER holds the collections. A model is trained for each fold of tools/folds.py and asked about
the actions that the fold holds back: of sensors that it knows, and of sensors that it does not.
Logistic regression on the queries and their nearest actions, as many unknown queries as known
ones, gives the weights of warping cost and radii; those of T and the discriminator stand below.
The bias is where as many unknown queries are accepted as known ones
rejected, mean over collections. The same is told of clips as a simulated camera sees them
(tools/monocular.py). Benchmark classes are not touched. About five minutes a model on
one core; finished models are kept in --work.
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import torch
from folds import FOLDS, fold_splits, read_folder, thinned
from monocular import estimated
from numpy.typing import NDArray
from robustness import disturbed
from torch.nn import functional

from actioncli.clips.collection import Collection
from actioncli.evaluation.episodes import Protocol, Sampler, possible_ways
from actioncli.evaluation.metrics import pooled, reliability
from actioncli.evaluation.splits import Splits
from actioncli.model import compare
from actioncli.model.compare import sigmoid
from actioncli.recognition.recognizer import Recognizer
from actioncli.training.closing import unit_distance
from actioncli.training.data import hold_out, training_set
from actioncli.training.loop import train
from actioncli.training.recipes import RECIPES
from actioncli.training.validation import Validation

EPISODES, WAYS, CLIPS = 60, 5, 2
# Weights of -log T and of the discriminator's logit, chosen by OSCR, which is flat around them, see
# the model card. A regression sees only the nearest actions, of which the warping cost tells more,
# and would let T count against them.
T, DISCRIMINATOR = 0.75, 0.2
# Weights by which the nearest action is found while the others are fitted.
START = np.array([T, 4.3, 5.0, DISCRIMINATOR])


@dataclass(frozen=True, eq=False)
class Samples:
    """Queries of one collection's episodes and the action nearest to each.

    Attributes:
        terms: (M, 4) what the score's weights multiply.
        hit: (M,) whether the nearest action is right.
        known: (M,) whether the query shows an enrolled action.
        name: fold, collection and view.
    """

    terms: NDArray[np.float64]
    hit: NDArray[np.bool_]
    known: NDArray[np.bool_]
    name: tuple[str, str, str]


def trained(
    fold: str, collections: Sequence[Collection], splits: Splits, out: Path, steps: int
) -> Path:
    """Weights of a model that never saw what the fold holds back."""
    if not out.exists():
        data, held = hold_out(training_set(collections, fold_splits(splits, fold)), 0)
        recipe = replace(RECIPES["default"], steps=steps)
        names = [collection.name for collection in collections]
        train(recipe, data, Validation(held, 0), out, 0, names)
    return out


def samples(
    recognizer: Recognizer, collection: Collection, classes: Sequence[str], fold: str
) -> list[Samples]:
    """What the collection's episodes give, as recorded and as the simulated camera sees them."""
    params, config = recognizer.weights.tensors, recognizer.weights.config
    unit = np.log(unit_distance(config, params))
    sampler = Sampler(
        collection.name, collection.labels, collection.subjects, classes, Protocol.CROSS_PERSON
    )
    ways = possible_ways(WAYS, len(classes))
    episodes = [sampler.episode(ways, number) for number in range(EPISODES)]
    views = {
        "recorded": collection.clips,
        "camera": [disturbed(clip, estimated) for clip in collection.clips],
    }
    found = []
    for view, clips in views.items():
        embedded = recognizer.embed(clips)
        terms, hits, known = [], [], []
        for episode in episodes:
            actions = [embedded[clips] for clips in episode.support]
            parts = compare.score_parts(params, config, embedded[episode.queries], actions)
            each = compare.weighted(parts).astype(np.float64)
            each[..., 0] += unit
            nearest = (each @ START).argmax(axis=1)
            terms.append(each[np.arange(len(nearest)), nearest])
            hits.append(nearest == episode.target)
            known.append(episode.target >= 0)
        columns = (np.concatenate(column) for column in (terms, hits, known))
        found.append(Samples(*columns, (fold, collection.name, view)))
    return found


def fit(parts: Sequence[Samples]) -> tuple[NDArray[np.float64], float]:
    """Weights (4,), those of warping cost and radii by a logistic regression, slightly held towards
    zero, and the even bias."""
    x = torch.tensor(np.concatenate([part.terms for part in parts]))
    y = torch.tensor(np.concatenate([part.hit for part in parts]).astype(float))
    share = torch.tensor(
        np.concatenate([np.full(len(part.hit), 1 / len(part.hit)) for part in parts])
    )
    of_network = T * x[:, 0] + DISCRIMINATOR * x[:, 3]
    mean, spread = x[:, 1:3].mean(dim=0), x[:, 1:3].std(dim=0)
    scaled = (x[:, 1:3] - mean) / spread
    weight = torch.zeros(2, dtype=torch.float64, requires_grad=True)
    bias = torch.zeros(1, dtype=torch.float64, requires_grad=True)
    optimiser = torch.optim.LBFGS([weight, bias], max_iter=200, line_search_fn="strong_wolfe")

    def loss() -> torch.Tensor:
        optimiser.zero_grad()
        value = functional.binary_cross_entropy_with_logits(
            of_network + scaled @ weight + bias, y, weight=share / share.mean()
        )
        value = value + 1e-3 * weight.square().sum()
        value.backward()
        return value

    optimiser.step(loss)
    found = np.array([T, *(weight / spread).detach().tolist(), DISCRIMINATOR])
    low, high = -20.0, 20.0
    while high - low > 1e-3:
        middle = (low + high) / 2
        accepts, rejects = rates(parts, found, middle)
        low, high = (low, middle) if accepts > rejects else (middle, high)
    return found, (low + high) / 2


def rates(
    parts: Sequence[Samples], weight: NDArray[np.float64], bias: float
) -> tuple[float, float]:
    """Unknown queries accepted and known ones rejected at 0.5, means over collections."""
    each = []
    for part in parts:
        accepted = part.terms @ weight + bias > 0
        each.append((accepted[~part.known].mean(), 1 - accepted[part.known].mean()))
    accepts, rejects = np.mean(each, axis=0)
    return float(accepts), float(rejects)


def tell(name: str, parts: Sequence[Samples], weight: NDArray[np.float64], bias: float) -> None:
    """A row for each view: calibration error and the balance of errors at 0.5."""
    for view in ("recorded", "camera"):
        seen = [part for part in parts if part.name[2] == view]
        bins = pooled([reliability(sigmoid(part.terms @ weight + bias), part.hit) for part in seen])
        accepts, rejects = rates(seen, weight, bias)
        print(f"| {name} | {view} | {bins.ece:.3f} | {accepts:.3f} | {rejects:.3f} |")


def main() -> None:
    """Print the constants, and how those of three folds do on the fourth."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("folder", type=Path)
    parser.add_argument("--splits", type=Path, required=True)
    parser.add_argument("--work", type=Path, required=True)
    parser.add_argument("--steps", type=int, default=1500)
    asked = parser.parse_args()
    torch.set_num_threads(1)
    asked.work.mkdir(parents=True, exist_ok=True)
    collections, splits = read_folder(asked.folder, asked.splits)
    parts: list[Samples] = []
    for fold in FOLDS:
        out = asked.work / f"{fold.replace(' ', '_')}.safetensors"
        recognizer = Recognizer(trained(fold, list(collections.values()), splits, out, asked.steps))
        for name, split in fold_splits(splits, fold).by_collection.items():
            if len(split.benchmark) >= 4:
                shown = thinned(collections[name], CLIPS)
                parts += samples(recognizer, shown, split.benchmark, fold)
    recorded = [part for part in parts if part.name[2] == "recorded"]
    print("| asked about | seen | calibration error | unknown accepted | known rejected |")
    print("| --- | --- | --- | --- | --- |")
    for fold in FOLDS:
        others = [part for part in recorded if part.name[0] != fold]
        tell(fold, [part for part in parts if part.name[0] == fold], *fit(others))
    weight, bias = fit(recorded)
    tell("all, fitted on all", parts, weight, bias)
    print(f"_SCORE = ({', '.join(f'{value:.2f}' for value in weight)})\n_SCORE_BIAS = {bias:.2f}")


if __name__ == "__main__":
    main()
