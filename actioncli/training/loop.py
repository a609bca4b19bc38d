"""The training loop: steps, looks at validation classes, checkpoints."""

from __future__ import annotations

import contextlib
import math
import signal
import threading
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Protocol

import numpy as np
import torch
from torch import Tensor

from actioncli.errors import WeightsError
from actioncli.files import output_lock
from actioncli.training.checkpoint import TrainingState, load_checkpoint, save_checkpoint

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


class Schedule(Protocol):
    """What the loop reads of a recipe."""

    @property
    def steps(self) -> int:
        """Optimiser steps."""

    @property
    def validate_every(self) -> int:
        """Steps between looks at the validation classes."""


class Run(Protocol):
    """One recipe on its data, for `train`."""

    def start(self) -> TrainingState:
        """The state before the first step."""

    def loss(self, state: TrainingState, rng: np.random.Generator) -> tuple[Tensor, float]:
        """The loss of a step, and the share of queries whose nearest action is right."""

    def step(self, state: TrainingState) -> None:
        """Take the step whose gradients are there, and count it."""

    def validate(self, state: TrainingState) -> None:
        """Look at the validation classes, and add the figures to the state's history."""

    def write(self, state: TrainingState) -> None:
        """Write the weights of a complete run."""


def train(
    run: Run, schedule: Schedule, out: Path, seed: int, fingerprint: str, report: Report
) -> Path:
    """Train, or go on with an interrupted run, and write the weights.

    The state is kept in `OUT.checkpoint` at least once a minute and on Ctrl-C; it is deleted when
    the run is complete. Where it cannot be written, the run goes on and tries again a minute
    later. A resumed run ends with the same weights as one that was never interrupted (same
    machine, same number of threads).

    Args:
        run: what a step does.
        schedule: how many steps.
        out: where the weights go.
        seed: of the steps; what step n draws depends on nothing but seed and n.
        fingerprint: of recipe, seed and data; a checkpoint of another one is refused.
        report: called after each step.

    Raises:
        WeightsError: the weights, or after Ctrl-C the checkpoint, cannot be written; the
            checkpoint belongs to another run; or another run is writing them.
    """
    checkpoint = out.with_name(out.name + ".checkpoint")
    with output_lock(out, "train", WeightsError), interrupts_noted() as interrupted:
        state = load_checkpoint(checkpoint, fingerprint) or run.start()
        begun, first_step, saved = time.monotonic(), state.step, time.monotonic()
        means = np.zeros(2)
        unsaved: str | None = None
        try:
            while state.step < schedule.steps:
                loss, accuracy = run.loss(state, np.random.default_rng([seed, state.step]))
                loss.backward()  # type: ignore[no-untyped-call]  # torch declares no types here
                run.step(state)
                done = state.step - first_step
                means += max(1 / 50, 1 / done) * (np.array([loss.item(), accuracy]) - means)
                if state.step % schedule.validate_every == 0 or state.step == schedule.steps:
                    run.validate(state)
                if time.monotonic() - saved > CHECKPOINT_SECONDS:
                    unsaved = None
                    try:
                        save_checkpoint(checkpoint, state, fingerprint)
                    except WeightsError as error:
                        # A disk may be full for a while; hours of work end for less.
                        unsaved = str(error)
                    saved = time.monotonic()
                left = (time.monotonic() - begun) / done * (schedule.steps - state.step)
                shown = state.history[-1] if state.history else None
                mean_loss, mean_accuracy = means.tolist()
                at = (state.step, schedule.steps, mean_loss, mean_accuracy, left)
                report(Progress(*at, shown, unsaved))
                if interrupted.is_set():
                    raise KeyboardInterrupt
        except KeyboardInterrupt:
            save_checkpoint(checkpoint, state, fingerprint)
            raise
        run.write(state)
        checkpoint.unlink(missing_ok=True)
    return out


def descend(
    state: TrainingState, rate: float, weight_decay: float, steps: int, warm: int, floor: float
) -> None:
    """One step of AdamW: the rate rises for `warm` steps, then falls as a half cosine to `floor` of
    its peak; gradients are clipped to norm 1; only matrices decay."""
    torch.nn.utils.clip_grad_norm_(state.params.values(), 1.0)
    fallen = floor + (1 - floor) / 2 * (1 + math.cos(math.pi * state.step / steps))
    now = rate * min(1.0, (state.step + 1) / warm) * fallen
    for group, decay in zip(state.optimizer.param_groups, (weight_decay, 0), strict=True):
        group["lr"], group["weight_decay"] = now, decay
    state.optimizer.step()
    state.optimizer.zero_grad()
    state.step += 1


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
