"""What each addition of recipe `default` is worth on actions held back from `train`.

    python tools/ablation.py FOLDER --splits FILE --work FOLDER [--seeds 3] [--steps 300]

FOLDER holds the collections. Every line trains the recipe with one thing switched off, once a
seed, on the fold `classes 1` of tools/folds.py, and asks about the actions that the fold holds
back: 5-way or all but two, one clip each, other performers; once with the clips as they are, once
with enrolled and asked clips as a simulated camera sees them (tools/monocular.py). Prints a table
in Markdown, mean over collections, then mean and standard deviation over seeds. What is finished
is kept in --work, so that the same command goes on. About a minute a line and seed on one core.
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import torch
from folds import fold_splits, read_folder, thinned
from monocular import estimated
from robustness import disturbed

from actioncli.clips.clip import Clip
from actioncli.clips.collection import Collection
from actioncli.evaluation.protocol import evaluate
from actioncli.evaluation.splits import Splits
from actioncli.model.weights import Weights, read_weights
from actioncli.recognition.recognizer import Recognizer
from actioncli.training.data import training_set
from actioncli.training.loop import train
from actioncli.training.recipes import RECIPES, Recipe
from actioncli.training.validation import Validation

FOLD, EPISODES = "classes 1", 30
# Of one performer in one class.
CLIPS = 2
FIGURES = ("closed_set_accuracy", "auroc", "oscr")


def model(**changes: object) -> Callable[[Recipe], Recipe]:
    """Another model."""
    return lambda recipe: replace(recipe, config=replace(recipe.config, **changes))


def preparation(**changes: object) -> Callable[[Recipe], Recipe]:
    """Another preparation."""

    def change(recipe: Recipe) -> Recipe:
        return model(preparation=replace(recipe.config.preparation, **changes))(recipe)

    return change


def training(**changes: object) -> Callable[[Recipe], Recipe]:
    """Another way to train."""
    return lambda recipe: replace(recipe, **changes)


LINES: Mapping[str, Callable[[Recipe], Recipe]] = {
    "recipe `default`": lambda recipe: recipe,
    "without estimator's errors": training(estimated=0.0),
    "without any augmentation": training(disturbed=False),
    "5 ways": training(ways=5),
    "16 frames": preparation(frames=16),
    "frames equidistant in time": preparation(motion=0.0),
    "recorded heading": preparation(heading=False),
    "joint positions alone": model(body_features=False),
    "the paper's MLP as Ψ": model(convolutions=0),
    "attention one way": model(both_ways=False),
    "attention prefers near places": model(near_pairs=True),
    "squared distance": model(distance="squared"),
    "joint positions of recorded proportions, T and discriminator alone": lambda recipe: model(
        body_features=False, warp_width=0, neighbours=0, mirrored=0.0
    )(preparation(size="torso")(recipe)),
}
# What is done with the trained network of a line, not its training.
_ALONE = {"warp_width": 0, "neighbours": 0, "mirrored": 0.0}
CLOSING: Mapping[str, tuple[str, Mapping[str, object]]] = {
    "without cohort": ("recipe `default`", {"neighbours": 0}),
    "without mirrored queries": ("recipe `default`", {"mirrored": 0.0}),
    "T and discriminator alone": ("recipe `default`", _ALONE),
    "joint positions, T and discriminator alone": ("joint positions alone", _ALONE),
}


class Seen(Recognizer):
    """A recogniser that sees all clips, enrolled and asked, through the simulated camera."""

    def embed(self, clips: Sequence[Clip]) -> np.ndarray:
        return super().embed([disturbed(clip, estimated) for clip in clips])


def measured(
    weights: Weights, collections: Sequence[Collection], splits: Splits
) -> dict[str, list[float]]:
    """Closed accuracy, AUROC and OSCR of both views of the clips."""
    found = {}
    for view, scorer in (("recorded", Recognizer(weights)), ("camera", Seen(weights))):
        mean = evaluate(scorer, collections, episodes=EPISODES, splits=splits).means[0]
        found[view] = [float(mean[figure].mean) for figure in FIGURES]
    return found


def narrowed(weights: Weights, changes: Mapping[str, object]) -> Weights:
    """The same network with parts of the score left out."""
    config = replace(weights.config, **changes)
    tensors = dict(weights.tensors)
    if not config.warp_width:
        tensors = {
            name: tensor
            for name, tensor in tensors.items()
            if not name.startswith(("warp.", "score.", "cohort"))
        }
    return replace(weights, config=config, tensors=tensors)


def main() -> None:
    """Train what is missing, then print the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("folder", type=Path)
    parser.add_argument("--splits", type=Path, required=True)
    parser.add_argument("--work", type=Path, required=True)
    parser.add_argument("--seeds", type=int, default=3)
    parser.add_argument("--steps", type=int, default=300)
    parser.add_argument("--lines", nargs="+", default=list(LINES), choices=list(LINES))
    asked = parser.parse_args()
    torch.set_num_threads(1)
    asked.work.mkdir(parents=True, exist_ok=True)
    by_name, splits = read_folder(asked.folder, asked.splits)
    collections = list(by_name.values())
    splits = fold_splits(splits, FOLD)
    data = training_set(collections, splits)
    held = {
        name: replace(split, train=split.benchmark) for name, split in splits.by_collection.items()
    }
    validation = Validation(training_set(collections, Splits(splits.source, held)), 0)
    measurable = [
        thinned(each, CLIPS) for each in collections if len(held[each.name].benchmark) >= 4
    ]
    table: dict[str, list[dict[str, list[float]]]] = {}
    for seed in range(asked.seeds):
        for line in asked.lines:
            kept = asked.work / f"{list(LINES).index(line):02d}-seed{seed}.json"
            recipe = LINES[line](
                replace(RECIPES["default"], steps=asked.steps, validate_every=asked.steps)
            )
            told = json.loads(json.dumps(recipe.as_json()))
            found = json.loads(kept.read_text()) if kept.exists() else {}
            if found.get("recipe") != told:
                out = kept.with_suffix(".safetensors")
                train(recipe, data, validation, out, seed, list(by_name))
                weights = read_weights(out)
                rows = {line: measured(weights, measurable, splits)}
                for other, (of, changes) in CLOSING.items():
                    if of == line:
                        rows[other] = measured(narrowed(weights, changes), measurable, splits)
                found = {"recipe": told, "figures": rows}
                kept.write_text(json.dumps(found))
            for name, figures in found["figures"].items():
                table.setdefault(name, []).append(figures)
            print(f"{line}, seed {seed}: {table[line][-1]}", flush=True)
    tell(table)


def tell(table: Mapping[str, Sequence[Mapping[str, Sequence[float]]]]) -> None:
    """Print the table."""
    print("\n| | closed accuracy | AUROC | OSCR | OSCR, simulated camera |")
    print("| --- | --- | --- | --- | --- |")
    for name in dict.fromkeys([*LINES, *CLOSING]):
        if name not in table:
            continue
        seeds = np.array([[*each["recorded"], each["camera"][-1]] for each in table[name]])
        spread = seeds.std(axis=0, ddof=1) if len(seeds) > 1 else np.zeros(4)
        cells = [f"{m:.3f} ± {s:.3f}" for m, s in zip(seeds.mean(axis=0), spread, strict=True)]
        print(f"| {name} | {' | '.join(cells)} |")


if __name__ == "__main__":
    main()
