"""Fit the constants of the default recipe's score (`_SCORE` in actioncli/training/closing.py).

    python tools/fit_score.py FOLDER --splits FILE --work FOLDER [--steps 3000]

FOLDER holds the collections. Two models are trained, each without three collections and without
what looks like their actions elsewhere; then each is asked about the train classes of those three,
which it has never seen, by performers, sensors and actions. Logistic regression on the queries and
their nearest actions, as many unknown queries as known ones, gives the weights; the bias is where
as many unknown queries are accepted as known ones rejected, mean over collections. Benchmark
classes are not touched. About ten minutes a model on one core; finished models are kept in --work.
"""

from __future__ import annotations

import argparse
from collections.abc import Mapping, Sequence
from dataclasses import replace
from fnmatch import fnmatch
from pathlib import Path

import numpy as np
import torch
from numpy.typing import NDArray
from torch.nn import functional

from actioncli.clips.collection import Collection, read_collection
from actioncli.evaluation.episodes import Protocol, Sampler, possible_ways
from actioncli.evaluation.metrics import reliability
from actioncli.evaluation.splits import Split, Splits, read_splits
from actioncli.model import compare
from actioncli.model.compare import sigmoid
from actioncli.recognizer import Recognizer
from actioncli.training.closing import unit_distance
from actioncli.training.data import hold_out, training_set
from actioncli.training.loop import train
from actioncli.training.recipes import RECIPES
from actioncli.training.validation import Validation

# Collections that a model does without, and what looks like their actions in the others.
FOLDS: Mapping[str, tuple[Sequence[str], Mapping[str, Sequence[str]]]] = {
    "B": (
        ("kard", "msr_action3d", "ui_prmd_vicon"),
        {
            "kinder_gator": ["walk*"],
            "utd_mhad": ["walk", "catch", "tennis_serve"],
            "msrc12": ["lift_outstretched_arms"],
            "bandai_namco": ["walk*", "dash", "bye*", "wave*"],
            "cad60": ["drinking_water"],
            "cmu_mocap_subset": ["*walk*"],
            "cc0_animations": [
                "walk*", "skeletons_walking", "lie_standup", "skeletons_awaken_standing",
                "waving", "thow_object", "consume_item",
            ],
        },
    ),
    "K": (
        ("kinder_gator", "utd_mhad", "msrc12"),
        {
            "kard": ["walk", "draw_tick"],
            "msr_action3d": ["tennis_serve", "tennis_swing", "hand_catch"],
            "ui_prmd_vicon": ["standing_straight_leg_raise"],
            "bandai_namco": ["walk*", "dash"],
            "cmu_mocap_subset": ["*walk*", "*basketball*shoot*"],
            "cc0_animations": [
                "walk*", "skeletons_walking", "ranged_1h_shoot*", "pistol_shoot",
            ],
        },
    ),
}  # fmt: skip
EPISODES, WAYS = 100, 5
# Weights by which the nearest action is found while the constants are fitted.
START = np.array([1.7, 3.7, 6.1, 0.2])

# What the discriminator's weight becomes after the fit: beside the others it is fitted slightly
# below zero, but of -0.13, 0 and 0.1 the last did best (OSCR .757, .759, .760).
DISCRIMINATOR = 0.1

# Terms (M, 4), whether the nearest action is right (M,), whether the query is known (M,), weights.
Samples = tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]


def trained(
    fold: str, collections: Sequence[Collection], splits: Splits, out: Path, steps: int
) -> Path:
    """Weights of a model that never saw the fold's collections."""
    if out.exists():
        return out
    without, alike = FOLDS[fold]
    kept = {
        name: Split(
            tuple(
                label
                for label in split.train
                if name not in without
                and not any(fnmatch(label, pattern) for pattern in alike.get(name, ()))
            ),
            (),
            (),
        )
        for name, split in splits.by_collection.items()
    }
    data, held = hold_out(training_set(collections, Splits(f"fold {fold}", kept)), 0)
    recipe = replace(RECIPES["default"], steps=steps)
    names = [collection.name for collection in collections]
    return train(recipe, data, Validation(held, 0), out, 0, names)


def samples(recognizer: Recognizer, collection: Collection, classes: Sequence[str]) -> Samples:
    """Queries of the collection's episodes, and the action nearest to each."""
    params, config = recognizer.weights.tensors, recognizer.weights.config
    shown = [at for at, label in enumerate(collection.labels) if label in classes]
    place = {clip: row for row, clip in enumerate(shown)}
    embedded = recognizer.embed([collection.clips[at] for at in shown])
    sampler = Sampler(
        collection.name, collection.labels, collection.subjects, classes, Protocol.CROSS_PERSON
    )
    ways = possible_ways(WAYS, len(classes))
    terms, hits, known, weights = [], [], [], []
    for number in range(EPISODES):
        episode = sampler.episode(ways, number)
        asked = embedded[[place[int(clip)] for clip in episode.queries]]
        actions = [embedded[[place[int(clip)] for clip in clips]] for clips in episode.support]
        each = compare.weighted(config, compare.score_parts(params, config, asked, actions))
        nearest = (each @ START).argmax(axis=1)
        terms.append(each[np.arange(len(nearest)), nearest])
        hits.append(nearest == episode.target)
        known.append(episode.target >= 0)
        weights.append(np.full(len(nearest), 1 / len(nearest) / EPISODES))
    asked_for, right = np.concatenate(known), np.concatenate(hits)
    return np.concatenate(terms), right.astype(float), asked_for, np.concatenate(weights)


def fit(parts: Sequence[Samples]) -> tuple[NDArray[np.float64], float]:
    """Weights (4,) of a logistic regression, slightly held towards zero, and the even bias."""
    x, y, _, share = (torch.tensor(np.concatenate(column)) for column in zip(*parts, strict=True))
    mean, spread = x.mean(dim=0), x.std(dim=0)
    scaled = (x - mean) / spread
    weight = torch.zeros(4, dtype=torch.float64, requires_grad=True)
    bias = torch.zeros(1, dtype=torch.float64, requires_grad=True)
    optimiser = torch.optim.LBFGS([weight, bias], max_iter=200, line_search_fn="strong_wolfe")

    def loss() -> torch.Tensor:
        optimiser.zero_grad()
        value = functional.binary_cross_entropy_with_logits(
            scaled @ weight + bias, y, weight=share / share.mean()
        )
        value = value + 1e-3 * weight.square().sum()
        value.backward()
        return value

    optimiser.step(loss)
    found = (weight / spread).detach().numpy()
    found[3] = DISCRIMINATOR
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
    each = [
        ((logit[~known] > 0).mean(), (logit[known] <= 0).mean())
        for logit, known in ((part[0] @ weight + bias, part[2]) for part in parts)
    ]
    accepts, rejects = np.mean(each, axis=0)
    return float(accepts), float(rejects)


def tell(name: str, parts: Sequence[Samples], weight: NDArray[np.float64], bias: float) -> None:
    """Print calibration error and the balance of errors at 0.5."""
    errors = [reliability(sigmoid(part[0] @ weight + bias), part[1]).ece for part in parts]
    accepts, rejects = rates(parts, weight, bias)
    print(
        f"{name}: calibration error {np.mean(errors):.3f} a collection, unknown accepted "
        f"{accepts:.3f}, known rejected {rejects:.3f}"
    )


def main() -> None:
    """Print the constants, and how those of one fold do on the other."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--splits", type=Path, required=True)
    parser.add_argument("--work", type=Path, required=True)
    parser.add_argument("--steps", type=int, default=3000)
    asked = parser.parse_args()
    asked.work.mkdir(parents=True, exist_ok=True)
    splits = read_splits(asked.splits)
    collections = {path.stem: read_collection(path) for path in sorted(asked.folder.glob("*.npz"))}
    by_fold: dict[str, list[Samples]] = {}
    for fold, (held, _) in FOLDS.items():
        out = asked.work / f"fold{fold}.safetensors"
        path = trained(fold, list(collections.values()), splits, out, asked.steps)
        recognizer = Recognizer(path)
        unit = unit_distance(recognizer.weights.config, recognizer.weights.tensors)
        for name in held:
            terms, hits, known, share = samples(
                recognizer, collections[name], splits.by_collection[name].train
            )
            terms = terms.astype(np.float64)
            terms[:, 0] += np.log(unit)
            by_fold.setdefault(fold, []).append((terms, hits, known, share))
    for fold, other in (("B", "K"), ("K", "B")):
        tell(f"fitted on {other}, asked {fold}", by_fold[fold], *fit(by_fold[other]))
    everything = [part for parts in by_fold.values() for part in parts]
    weight, bias = fit(everything)
    tell("fitted and asked on both", everything, weight, bias)
    print(f"_SCORE = ({', '.join(f'{value:.2f}' for value in weight)})\n_SCORE_BIAS = {bias:.2f}")


if __name__ == "__main__":
    main()
