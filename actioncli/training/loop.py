"""The training loop: steps, looks at validation classes, checkpoints."""

from __future__ import annotations

import contextlib
import json
import math
import signal
import threading
import time
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass
from hashlib import sha256
from pathlib import Path
from typing import Any, Generic, TypeVar

import numpy as np
import torch
from torch import Tensor

from actioncli._version import __version__
from actioncli.errors import WeightsError
from actioncli.files import output_lock
from actioncli.model.weights import write_weights
from actioncli.training.checkpoint import (
    TrainingState,
    load_checkpoint,
    new_optimizer,
    save_checkpoint,
)
from actioncli.training.data import TrainingSet

CHECKPOINT_SECONDS = 60.0


@dataclass(frozen=True, slots=True)
class Progress:
    """What a progress line shows after a step.

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


Report = Callable[[Progress], None]


@dataclass(frozen=True, slots=True)
class Recipe:
    """How to train.

    Attributes:
        name: as given to `--recipe`.
        steps: optimiser steps.
        ways: actions of an episode.
        rate: peak learning rate of AdamW.
        weight_decay: of matrices.
        warm: steps in which the rate rises to its peak.
        floor: share of the peak to which the rate then falls, as a half cosine.
        validate_every: steps between looks at the validation classes.
    """

    name: str
    steps: int
    ways: int
    rate: float
    weight_decay: float
    warm: int
    floor: float
    validate_every: int


R = TypeVar("R", bound=Recipe)


class Run(ABC, Generic[R]):
    """One recipe on its data: what `train` asks for."""

    def __init__(
        self,
        recipe: R,
        data: TrainingSet,
        held: TrainingSet,
        seed: int,
        sources: Sequence[str],
        device: str = "cpu",
    ) -> None:
        """Take what decides about the weights.

        Args:
            recipe: what to do.
            data: training clips.
            held: clips of other classes, to validate on.
            seed: of initial tensors and steps; what step n draws depends on nothing but both.
            sources: names of the collections, for the header of the weights.
            device: where torch computes.
        """
        self.recipe, self.data, self.held = recipe, data, held
        self.seed, self.sources, self.device = seed, sources, device

    @property
    def fingerprint(self) -> str:
        """Hexadecimal; a checkpoint of a run with another one is refused."""
        identity = [asdict(self.recipe), self.seed, self.device]
        identity += [self.data.fingerprint, self.held.fingerprint]
        return sha256(json.dumps(identity, sort_keys=True).encode()).hexdigest()

    def start(
        self, shapes: Mapping[str, tuple[int, ...]], constants: Mapping[str, Any]
    ) -> TrainingState:
        """Uniform in ±1/√(inputs of the layer), norms at one: PyTorch's usual start.

        Args:
            shapes: of all tensors.
            constants: value of the tensors that begin otherwise.
        """
        rng = np.random.default_rng([self.seed, 0x1417])
        params: dict[str, Tensor] = {}
        fan_in = 1
        for name, shape in shapes.items():
            if name in constants or name.endswith(("scale", "shift")):
                values = np.full(shape, constants.get(name, float(name.endswith("scale"))))
            elif name == "positions":
                values = 0.02 * rng.standard_normal(shape)
            else:
                fan_in = shape[-2] if len(shape) > 1 else fan_in
                values = rng.uniform(-1, 1, shape) / math.sqrt(fan_in)
            tensor = torch.tensor(values, dtype=torch.float32, device=self.device)
            params[name] = torch.nn.Parameter(tensor)
        # In the order in which a checkpoint gives them back: sums of floats depend on it.
        params = dict(sorted(params.items()))
        best = {name: tensor.detach().clone() for name, tensor in params.items()}
        return TrainingState(0, params, new_optimizer(params), best, -math.inf, [])

    @staticmethod
    def keep_best(state: TrainingState, figures: dict[str, float]) -> None:
        """Note the figures of a step, and keep its weights if `score` is the best so far."""
        state.history.append({"step": state.step, **figures})
        if figures["score"] > state.score:
            state.score = figures["score"]
            state.best = {name: tensor.detach().clone() for name, tensor in state.params.items()}

    @abstractmethod
    def prepare(self) -> TrainingState:
        """Prepare all clips once, and give the state before the first step.

        Raises:
            UsageError: too few classes for the recipe.
        """

    @abstractmethod
    def loss(self, state: TrainingState, rng: np.random.Generator) -> tuple[Tensor, float]:
        """The loss of a step, and the share of queries whose nearest action is right."""

    def step(self, state: TrainingState) -> None:
        """Take the step whose gradients are there, with norm at most 1, and count it."""
        recipe = self.recipe
        torch.nn.utils.clip_grad_norm_(state.params.values(), 1.0)
        wave = (1 + math.cos(math.pi * state.step / recipe.steps)) / 2
        fallen = recipe.floor + (1 - recipe.floor) * wave
        rate = recipe.rate * min(1.0, (state.step + 1) / recipe.warm) * fallen
        groups = state.optimizer.param_groups
        for group, decay in zip(groups, (recipe.weight_decay, 0), strict=True):
            group["lr"], group["weight_decay"] = rate, decay
        state.optimizer.step()
        state.optimizer.zero_grad()
        state.step += 1

    @abstractmethod
    def validate(self, state: TrainingState) -> None:
        """Look at the validation classes, and add the figures to the state's history."""

    @abstractmethod
    def result(self, state: TrainingState) -> tuple[dict[str, Any], dict[str, Any]]:
        """Of a complete run the tensors of the weights file, and their validation figures."""


def train(run: Run[Any], out: Path, report: Report = lambda _: None) -> Path:
    """Train, or go on with an interrupted run, and write the weights.

    The state is kept in `OUT.checkpoint` at least once a minute and on Ctrl-C; it is deleted when
    the run is complete. Where it cannot be written, the run goes on and tries again a minute
    later. A resumed run ends with the same weights as one that was never interrupted (same
    machine, same number of threads).

    Args:
        run: what is trained, and on what.
        out: where the weights go.
        report: called after each step.

    Raises:
        UsageError: too few classes for the recipe.
        WeightsError: the weights, or after Ctrl-C the checkpoint, cannot be written; the
            checkpoint belongs to another run; or another run is writing them.
    """
    checkpoint, recipe = out.with_name(out.name + ".checkpoint"), run.recipe
    with output_lock(out, "train", WeightsError), interrupts_noted() as interrupted:
        state = run.prepare()
        fingerprint = run.fingerprint
        state = load_checkpoint(checkpoint, fingerprint, run.device) or state
        begun, first_step, saved = time.monotonic(), state.step, time.monotonic()
        means = np.zeros(2)
        unsaved: str | None = None
        try:
            while state.step < recipe.steps:
                loss, accuracy = run.loss(state, np.random.default_rng([run.seed, state.step]))
                loss.backward()  # type: ignore[no-untyped-call]  # torch declares no types here
                run.step(state)
                done = state.step - first_step
                means += max(1 / 50, 1 / done) * (np.array([loss.item(), accuracy]) - means)
                if state.step % recipe.validate_every == 0 or state.step == recipe.steps:
                    run.validate(state)
                if time.monotonic() - saved > CHECKPOINT_SECONDS:
                    unsaved = None
                    try:
                        save_checkpoint(checkpoint, state, fingerprint)
                    except WeightsError as error:
                        # A disk may be full for a while; hours of work end for less.
                        unsaved = str(error)
                    saved = time.monotonic()
                left = (time.monotonic() - begun) / done * (recipe.steps - state.step)
                shown = state.history[-1] if state.history else None
                mean_loss, mean_accuracy = means.tolist()
                at = (state.step, recipe.steps, mean_loss, mean_accuracy, left)
                report(Progress(*at, shown, unsaved))
                if interrupted.is_set():
                    raise KeyboardInterrupt
        except KeyboardInterrupt:
            save_checkpoint(checkpoint, state, fingerprint)
            raise
        tensors, figures = run.result(state)
        metadata = {
            "actioncli": __version__,
            "recipe": asdict(recipe),
            "seed": run.seed,
            "best_step": figures["step"],
            "validation": figures,
            "classes": len(run.data.members),
            "clips": len(run.data.clips),
            "sources": list(run.sources),
        }
        write_weights(out, recipe.config, tensors, metadata)
        checkpoint.unlink(missing_ok=True)
    return out


def arrays(tensors: dict[str, Tensor]) -> dict[str, np.ndarray[Any, Any]]:
    """Tensors as numpy arrays, wherever they are."""
    return {name: tensor.detach().cpu().numpy() for name, tensor in tensors.items()}


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
