"""Short runs of recipe `default` with a piece taken out, measured on held-out classes.

    python tools/ablation.py collections/*.npz --splits tools/splits.json --out lines.jsonl

Each run takes 1,500 steps of one task (five minutes on an idle core; a full run takes 3,600 of
three). Prints, and adds to the file, closed accuracy, AUROC and OSCR over three draws of episodes
of the classes that training holds out, and which share of changed clips of theirs is accepted
where 1 % of something else is. Lines that are in the file are not run again.
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Callable
from contextlib import ExitStack
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any
from unittest.mock import patch

import numpy as np
import torch

from actioncli.clips.collection import read_collection
from actioncli.clips.parts import prepare_parts
from actioncli.evaluation.splits import read_splits
from actioncli.model import parts, parts_tokens
from actioncli.training import augment, default, negatives
from actioncli.training.augment import Batch
from actioncli.training.data import TrainingSet, hold_out, training_set
from actioncli.training.loop import arrays
from actioncli.training.tasks import CHANGED
from actioncli.training.validation import Validation

STEPS, OF_CLASS, DRAWS = 1500, 10, 3
HERE = "actioncli.training"


def _same(batch: Batch, chance: torch.Generator) -> Batch:
    return batch


# What is replaced, and fields of the recipe that are changed.
LINES: dict[str, tuple[dict[str, Any], dict[str, Any]]] = {
    "as it is": ({}, {}),
    "no camera's errors": (
        {f"{HERE}.default.augment": partial(augment.augment, estimated=0.0)},
        {},
    ),
    "postures not transplanted": ({f"{HERE}.augment._transplanted": _same}, {}),
    "every part seen": ({f"{HERE}.augment._unseen": _same}, {}),
    "ends and tempo as recorded": ({f"{HERE}.augment._warped": _same}, {}),
    "no negatives made of the action": ({}, {"negative": 0.0}),
    "all wrong actions weigh alike": ({}, {"hard": 0.0}),
}


def run(line: str, seed: int, data: TrainingSet, held: TrainingSet) -> dict[str, Any]:
    """Train, and measure."""
    replaced, fields = LINES[line]
    recipe = replace(default.DefaultRecipe(), steps=STEPS, tasks=1, averaging=0.995, **fields)
    with ExitStack() as stack:
        for name, other in replaced.items():
            stack.enter_context(patch(name, other))
        training = default.DefaultRun(recipe, data, held, seed, [])
        state = training.prepare()
        while state.step < STEPS:
            loss, _ = training.loss(state, np.random.default_rng([seed, state.step]))
            loss.backward()
            training.step(state)
            if state.step % 100 == 0:
                print(f"{line}, seed {seed}: step {state.step} of {STEPS}", flush=True)
    tensors = arrays(state.best)
    draws = [Validation(held, recipe.config, draw).figures(tensors) for draw in range(DRAWS)]
    found = {name: float(np.mean([each[name] for each in draws]))
             for name in ("closed_accuracy", "auroc", "oscr")}  # fmt: skip
    fitted = Validation(held, recipe.config, seed).confidence(tensors)
    sure = fitted["confidence.scale"][0], fitted["confidence.shift"][0]
    accepted = changed(training, tensors, held, lambda logit: sure[0] * logit + sure[1] > 0)
    return {"line": line, "seed": seed, **found, **accepted}


def changed(
    training: default.DefaultRun,
    tensors: dict[str, Any],
    held: TrainingSet,
    accept: Callable[[torch.Tensor], torch.Tensor],
) -> dict[str, float]:
    """Shares of changed clips that are accepted as what they were made of."""
    config, tasks = training.recipe.config, training._tasks
    rng, chance = np.random.default_rng(0), torch.Generator().manual_seed(0)
    rows = [row for of in held.members.values() for row in rng.permutation(of)[:OF_CLASS]]
    rows = rng.permutation(rows).tolist()
    prepared = prepare_parts([held.clips[row] for row in rows], config.preparation)
    batch = Batch(*map(torch.from_numpy, prepared))
    params = {name: torch.from_numpy(tensor) for name, tensor in tensors.items()}

    def embedded(clips: Batch) -> parts.Embedded:
        return parts.embed(params, config, parts_tokens.tokens(config, *clips))

    found = {}
    with torch.no_grad():
        original = embedded(batch)
        for number, kind in enumerate(negatives.KINDS):
            made = negatives.negatives(batch, torch.full((len(rows),), number), chance)
            # As in training: what the change left as it was is no other action.
            far = negatives.apart(made, batch) > CHANGED * tasks.typical
            logits = parts.paired_logits(params, config, embedded(made), original)
            found[kind] = accept(logits)[far].float().mean().item()
    return found


def main() -> None:
    """See the module."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("collections", type=Path, nargs="+")
    parser.add_argument("--splits", type=Path, required=True)
    parser.add_argument("--seeds", type=int, nargs="+", default=[0, 1])
    parser.add_argument("--lines", nargs="+", default=[*LINES], choices=[*LINES])
    parser.add_argument("--out", type=Path, required=True)
    given = parser.parse_args()
    torch.set_num_threads(1)
    read = [read_collection(path) for path in given.collections]
    data, held = hold_out(training_set(read, read_splits(given.splits)), 0)
    lines = given.out.read_text().splitlines() if given.out.exists() else []
    done = {(each["line"], each["seed"]) for each in map(json.loads, lines)}
    for seed in given.seeds:
        for line in given.lines:
            if (line, seed) not in done:
                found = run(line, seed, data, held)
                print(json.dumps(found), flush=True)
                with given.out.open("a") as file:
                    file.write(json.dumps(found) + "\n")


if __name__ == "__main__":
    main()
