"""Short runs on the small world, for `torchrun`: short_runs.py FOLDER.

Writes NAME.safetensors and NAME.json, the loss of each step, for each of `RUNS`. The run `cut` is
interrupted after some steps and leaves its checkpoint. RANK.ended tells whether a process had left
the others when it ended.
"""

from __future__ import annotations

import atexit
import contextlib
import json
import os
import signal
import sys
from dataclasses import replace
from pathlib import Path
from unittest.mock import patch

import torch
from conftest import small_world

from actioncli.training import objectives
from actioncli.training.data import hold_out
from actioncli.training.loop import Progress, train
from actioncli.training.recipes import RECIPES, Recipe
from actioncli.training.validation import Validation

# The number of episodes and of queries is odd: shares are not the same.
PAPER = replace(RECIPES["paper"], steps=5, batch=3, ways=3, validate_every=5)
DEFAULT = replace(RECIPES["default"], steps=3, ways=5, validate_every=3)
RUNS = {"paper": PAPER, "default": DEFAULT, "default in float32": DEFAULT, "cut": PAPER}
CUT_AFTER = 2


def losses_of(name: str, folder: Path) -> list[float]:
    """Train and give the loss of each step, as the first process hears of it."""
    means: list[float] = []

    def listen(now: Progress) -> None:
        means.append(now.loss)
        if name == "cut" and now.step == CUT_AFTER:
            os.kill(os.getpid(), signal.SIGINT)

    recipe: Recipe = RUNS[name]
    data, held = hold_out(small_world(), 0)
    plain = patch.object(objectives.torch, "autocast", lambda *_, **__: contextlib.nullcontext())
    with plain if "float32" in name else contextlib.nullcontext():
        out = folder / f"{name}.safetensors"
        train(recipe, data, Validation(held, 0), out, 0, ["world"], listen)
    sums = [mean * (step + 1) for step, mean in enumerate(means)]
    return [after - before for before, after in zip([0.0, *sums], sums, strict=False)]


def main(folder: Path) -> None:
    """All runs, one after another."""
    torch.set_num_threads(1)
    # What is registered first is called last.
    atexit.register(
        lambda: (folder / f"{os.environ['RANK']}.ended").write_text(
            str(not torch.distributed.is_initialized())
        )
    )
    for name in RUNS:
        losses = []
        with contextlib.suppress(KeyboardInterrupt):
            losses = losses_of(name, folder)
        if losses:
            (folder / f"{name}.json").write_text(json.dumps(losses))


if __name__ == "__main__":
    main(Path(sys.argv[1]))
