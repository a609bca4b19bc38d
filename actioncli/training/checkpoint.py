"""Checkpoints: a run's whole state in one safetensors file, so that it can go on exactly."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import torch
from torch import Tensor

from actioncli.errors import WeightsError
from actioncli.files import replacing


@dataclass(slots=True)
class TrainingState:
    """State after `step` steps.

    Attributes:
        params: the model's tensors, each a `torch.nn.Parameter`.
        optimizer: Adam over `params`, in their order.
        best: the tensors that did best on the validation classes so far.
        score: the validation score of `best`.
        history: one entry for each look at the validation classes.
    """

    step: int
    params: dict[str, Tensor]
    optimizer: torch.optim.AdamW
    best: dict[str, Tensor]
    score: float
    history: list[dict[str, Any]]


def save_checkpoint(path: Path, state: TrainingState, fingerprint: str) -> None:
    """Replace the checkpoint at once: a kill leaves the old one or the new one."""
    from safetensors import SafetensorError
    from safetensors.torch import save_file

    tensors = {f"param/{name}": tensor.detach() for name, tensor in state.params.items()}
    tensors |= {f"best/{name}": tensor for name, tensor in state.best.items()}
    for name, tensor in state.params.items():
        for key, moment in state.optimizer.state[tensor].items():
            tensors[f"adam/{key}/{name}"] = moment
    header = {
        "fingerprint": fingerprint,
        "step": str(state.step),
        "score": repr(state.score),
        "history": json.dumps(state.history),
    }
    try:
        with replacing(path) as part:
            save_file({name: t.contiguous() for name, t in tensors.items()}, part, metadata=header)
    except (SafetensorError, OSError) as error:
        reason = getattr(error, "strerror", None) or error
        raise WeightsError(f"{path}: cannot write the checkpoint: {reason}.") from error


def load_checkpoint(path: Path, fingerprint: str, device: str) -> TrainingState | None:
    """The state to go on from, on a device of torch, or None where there is no checkpoint.

    Raises:
        WeightsError: the checkpoint is damaged or belongs to another run.
    """
    from safetensors import SafetensorError, safe_open

    if not path.exists():
        return None
    try:
        with safe_open(path, framework="pt") as opened:
            header = opened.metadata() or {}
            # Copies, because tensors in the file's memory are aligned otherwise, and sums over
            # them are then added up in another order. `opened` is no mapping: it has only keys.
            tensors = {name: opened.get_tensor(name).clone() for name in opened.keys()}  # noqa: SIM118
    except (SafetensorError, OSError) as error:
        raise WeightsError(f"{path}: damaged checkpoint ({error}); delete it.") from error
    if header.get("fingerprint") != fingerprint:
        raise WeightsError(
            f"{path}: the checkpoint of a run with another recipe, seed or data; "
            "delete it to begin anew, or name another --out."
        )

    def group(prefix: str) -> dict[str, Tensor]:
        return {
            # AdamW counts its steps on the processor, wherever it computes.
            name.removeprefix(prefix): tensor if "/step/" in prefix else tensor.to(device)
            for name, tensor in sorted(tensors.items())
            if name.startswith(prefix)
        }

    params: dict[str, Tensor] = {
        name: torch.nn.Parameter(tensor) for name, tensor in group("param/").items()
    }
    optimizer = new_optimizer(params)
    for key in ("step", "exp_avg", "exp_avg_sq"):
        for name, moment in group(f"adam/{key}/").items():
            optimizer.state[params[name]][key] = moment
    return TrainingState(
        step=int(header["step"]),
        params=params,
        optimizer=optimizer,
        best=group("best/"),
        score=float(header["score"]),
        history=json.loads(header["history"]),
    )


def new_optimizer(params: dict[str, Tensor]) -> torch.optim.AdamW:
    """AdamW; rate and weight decay are set by the loop. Only matrices decay."""
    groups = [[p for p in params.values() if (p.ndim > 1) is decays] for decays in (True, False)]
    return torch.optim.AdamW([{"params": group} for group in groups], betas=(0.9, 0.98))
