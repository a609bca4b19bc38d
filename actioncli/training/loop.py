"""The training loop: episodes, steps, looks at validation classes, checkpoints."""

from __future__ import annotations

import contextlib
import json
import math
import signal
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import asdict, dataclass, replace
from functools import partial
from hashlib import sha256
from pathlib import Path
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from actioncli._version import __version__
from actioncli.errors import UsageError, WeightsError
from actioncli.files import output_lock
from actioncli.model.config import ModelConfig
from actioncli.model.trx_os import parameter_shapes, positional_encoding
from actioncli.model.weights import Weights, write_weights
from actioncli.training.checkpoint import (
    TrainingState,
    load_checkpoint,
    new_optimizer,
    save_checkpoint,
)
from actioncli.training.closing import close
from actioncli.training.data import TrainingSet
from actioncli.training.distributed import joined
from actioncli.training.objectives import objective
from actioncli.training.recipes import Recipe
from actioncli.training.validation import Validation

CHECKPOINT_SECONDS = 60.0


@dataclass(frozen=True, slots=True)
class Progress:
    """What a progress line tells after a step.

    Attributes:
        step, steps: how far the run is.
        loss, accuracy: running means over about the last 50 steps.
        seconds_left: at the pace since this process began.
        validation: figures of the last look at the validation classes, if any.
        unsaved: why the checkpoint could not be written when that was last tried; None where it
            could.
    """

    step: int
    steps: int
    loss: float
    accuracy: float
    seconds_left: float
    validation: dict[str, float] | None
    unsaved: str | None


def train(
    recipe: Recipe,
    data: TrainingSet,
    validation: Validation,
    out: Path,
    seed: int,
    sources: Sequence[str],
    report: Callable[[Progress], None] = lambda _: None,
) -> Path:
    """Train, or go on with an interrupted run, and write the best weights.

    The state is kept in `OUT.checkpoint` at least once a minute, at every validation and on
    Ctrl-C; it is deleted when the run is complete. Where it cannot be written, the run goes on
    and tries again a minute later. A resumed run ends with the same weights as
    one that was never interrupted (same machine, same number of threads).

    Under `torchrun` its processes share each step; the first one validates, reports and writes.
    Losses and weights are those of one process but for the order in which floats are added, and
    a run may go on with another number of processes.

    Args:
        recipe: what to do.
        data: training clips.
        validation: clips of other classes; the weights that do best on them are kept.
        out: where the weights go.
        seed: of initial tensors and episodes.
        sources: names of the collections, for the header.
        report: called after each step.

    Raises:
        UsageError: too few classes for the recipe's episodes.
        WeightsError: the weights, or after Ctrl-C the checkpoint, cannot be written; the
            checkpoint belongs to another run; or another run is writing them.
    """
    usable = sum(len(rows) > 1 for rows in data.members.values())
    if usable <= recipe.ways:
        raise UsageError(
            f"recipe {recipe.name} needs more than {recipe.ways} classes with at least 2 clips "
            f"to train on; the collections have {usable}."
        )
    identity = [recipe.as_json(), seed, data.fingerprint, validation.data.fingerprint]
    fingerprint = sha256(json.dumps(identity, sort_keys=True).encode()).hexdigest()
    checkpoint = out.with_name(out.name + ".checkpoint")
    processes = joined()
    with (
        output_lock(out, "train", WeightsError) if processes.first else contextlib.nullcontext(),
        interrupts_noted() as interrupted,
    ):
        processes.wait()  # until the first one has made its claim
        descend = objective(recipe, data, processes)
        state = load_checkpoint(checkpoint, fingerprint)
        if state is None:
            state = _new_state(recipe.config, seed)
        processes.check_same("recipe, seed, data and checkpoint", f"{fingerprint} {state.step}")
        step = processes.together(state.params, partial(descend.loss, state.params))
        begun, first_step, saved = time.monotonic(), state.step, time.monotonic()
        loss = accuracy = 0.0
        unsaved: str | None = None
        try:
            while state.step < recipe.steps:
                share, accuracy_share = step(np.random.default_rng([seed, state.step]))
                share.backward()  # type: ignore[no-untyped-call]  # torch declares no types here
                _step(recipe, state)
                state.step += 1
                # All processes hear of an interrupt at the end of the same step.
                now = processes.gather(
                    share.item() / processes.count, accuracy_share, interrupted.is_set()
                ).sum(axis=0)
                done = state.step - first_step
                blend = max(1 / 50, 1 / done)
                loss += blend * (float(now[0]) - loss)
                accuracy += blend * (float(now[1]) - accuracy)
                if processes.first:
                    if state.step % recipe.validate_every == 0 or state.step == recipe.steps:
                        _validate(state, recipe.config, validation)
                    if time.monotonic() - saved > CHECKPOINT_SECONDS:
                        unsaved = None
                        try:
                            save_checkpoint(checkpoint, state, fingerprint)
                        except WeightsError as error:
                            # A disk may be full for a while; hours of work end for less.
                            unsaved = str(error)
                        saved = time.monotonic()
                    pace = (time.monotonic() - begun) / done
                    report(
                        Progress(
                            state.step,
                            recipe.steps,
                            loss,
                            accuracy,
                            pace * (recipe.steps - state.step),
                            state.history[-1] if state.history else None,
                            unsaved,
                        )
                    )
                if now[2]:
                    raise KeyboardInterrupt
        except KeyboardInterrupt:
            if processes.first:
                save_checkpoint(checkpoint, state, fingerprint)
            raise
        if processes.first:
            _write(out, recipe, state, data, seed, sources)
            checkpoint.unlink(missing_ok=True)
    return out


def _write(
    out: Path,
    recipe: Recipe,
    state: TrainingState,
    data: TrainingSet,
    seed: int,
    sources: Sequence[str],
) -> None:
    """Write the weights that did best."""
    best = max(state.history, key=lambda entry: entry["score"])
    learned = {name: state.best[name].numpy() for name in parameter_shapes(recipe.config)}
    arrays = close(recipe.config, learned, data, seed)
    metadata: dict[str, Any] = {
        "actioncli": __version__,
        "recipe": recipe.as_json(),
        "seed": seed,
        "best_step": best["step"],
        "validation": best,
        "classes": len(data.members),
        "clips": len(data.clips),
        "sources": list(sources),
    }
    write_weights(out, recipe.config, arrays, metadata)


@contextlib.contextmanager
def interrupts_noted() -> Iterator[threading.Event]:
    """Ctrl-C, and what is to be like it, sets the event: in the middle of a step the state is
    neither old nor new."""
    noted = threading.Event()
    raising = [
        each
        for each in signal.valid_signals()
        if signal.getsignal(each) is signal.default_int_handler
        and threading.current_thread() is threading.main_thread()
    ]
    for each in raising:
        signal.signal(each, lambda *_: noted.set())
    try:
        yield noted
    finally:
        for each in raising:
            signal.signal(each, signal.default_int_handler)


def _step(recipe: Recipe, state: TrainingState) -> None:
    torch.nn.utils.clip_grad_norm_(state.params.values(), 1.0)
    for group, decay in zip(state.optimizer.param_groups, (recipe.weight_decay, 0), strict=True):
        group["lr"], group["weight_decay"] = _rate(recipe, state.step), decay
    state.optimizer.step()
    state.optimizer.zero_grad()


def _validate(state: TrainingState, config: ModelConfig, validation: Validation) -> None:
    """Look at the unseen classes with T and discriminator alone: the rest is added at the end."""
    plain = replace(config, warp_width=0, neighbours=0, mirrored=0.0)
    arrays = {name: state.params[name].detach().numpy() for name in parameter_shapes(plain)}
    figures = validation.figures(Weights(plain, arrays, {}, f"step-{state.step}", Path()))
    state.history.append({"step": state.step, **asdict(figures)})
    if figures.score > state.score:
        state.score = figures.score
        state.best = {name: tensor.detach().clone() for name, tensor in state.params.items()}


def _rate(recipe: Recipe, step: int) -> float:
    warm = min(1.0, (step + 1) / 50)
    return recipe.rate * warm * (0.03 + 0.485 * (1 + math.cos(math.pi * step / recipe.steps)))


def _new_state(config: ModelConfig, seed: int) -> TrainingState:
    """Uniform in ±1/√(inputs of the layer), norms at one: PyTorch's usual start."""
    rng = np.random.default_rng([seed, 0x1417])
    params: dict[str, Tensor] = {}
    fan_in = 1
    for name, shape in parameter_shapes(config).items():
        values: NDArray[np.floating[Any]]
        if name.endswith("scale"):
            values = np.ones(shape)
        elif name.endswith("shift"):
            values = np.zeros(shape)
        elif name == "positions":
            values = positional_encoding(*shape)
        elif name == "attention.decay":
            values = np.full(shape, math.log(10))
        else:
            fan_in = shape[0] if len(shape) == 2 else fan_in
            values = rng.uniform(-1, 1, shape) / math.sqrt(fan_in)
        params[name] = torch.nn.Parameter(torch.tensor(values, dtype=torch.float32))
    # In the order in which a checkpoint gives them back: sums of floats depend on it.
    params = dict(sorted(params.items()))
    return TrainingState(0, params, new_optimizer(params), {}, -math.inf, [])
