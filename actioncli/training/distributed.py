"""One run on several processes, as `torchrun` starts them; without it, what does nothing.

Every process draws the same step and computes its share of the loss: some of the episodes, or
some of the queries. The shares add up to the loss of a single process, and so do their
gradients; all processes then take the same optimiser step. What is kept and told is the first
process's business.
"""

from __future__ import annotations

import atexit
import os
from collections.abc import Callable
from dataclasses import dataclass
from hashlib import sha256

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, distributed, nn

from actioncli.errors import UsageError

# From the generator of a step to this process's share of its loss and its accuracy.
Share = Callable[[np.random.Generator], tuple[Tensor, float]]


@dataclass(frozen=True, slots=True)
class Processes:
    """The processes of a run.

    Attributes:
        rank: this process's number among them; the first is 0.
        count: how many there are.
    """

    rank: int = 0
    count: int = 1

    @property
    def first(self) -> bool:
        """Whether this process validates, writes files and prints."""
        return self.rank == 0

    def share(self, items: int) -> slice:
        """The consecutive items that are this process's; no two shares differ by more than one.

        Raises:
            UsageError: there are more processes than items.
        """
        if self.count > items:
            raise UsageError(
                f"a step of this recipe can be shared by {items} processes, not by {self.count}; "
                "give torchrun a smaller --nproc-per-node."
            )
        begin, end = (rank * items // self.count for rank in (self.rank, self.rank + 1))
        return slice(begin, end)

    def gather(self, *values: float) -> NDArray[np.float64]:
        """Every process's numbers, (count, values); all processes must call this."""
        if self.count == 1:
            return np.array([values], float)
        ours = torch.tensor(values, dtype=torch.float64)
        each = [torch.empty_like(ours) for _ in range(self.count)]
        distributed.all_gather(each, ours)
        return torch.stack(each).numpy()

    def check_same(self, what: str, value: str) -> None:
        """Make sure that all processes, which must all call this, give the same value.

        Args:
            what: what the value tells, for the error.

        Raises:
            UsageError: they do not.
        """
        digest = int.from_bytes(sha256(value.encode()).digest()[:6])
        if len(np.unique(self.gather(digest))) > 1:
            raise UsageError(
                f"the processes of this run do not agree on {what}; give all machines the same "
                "command, the same files, and a folder for --out that they share."
            )

    def wait(self) -> None:
        """Go on when all processes have come here."""
        if self.count > 1:
            distributed.barrier()

    def together(self, params: dict[str, Tensor], share: Share) -> Share:
        """`share`, but descending its loss descends the sum of all processes' shares.

        Args:
            params: parameters that `share` reads; the first process's values go to all others.
            share: gives this process's share of a step's loss and accuracy.
        """
        if self.count == 1:
            return share
        return nn.parallel.DistributedDataParallel(
            _ShareModule(params, share, self.count), find_unused_parameters=True
        )


ALONE = Processes()


class _ShareModule(nn.Module):
    """A share as the module that `DistributedDataParallel` wants."""

    def __init__(self, params: dict[str, Tensor], share: Share, count: int) -> None:
        super().__init__()
        self._share, self._count = share, count
        for name, tensor in params.items():
            assert isinstance(tensor, nn.Parameter)
            self.register_parameter(name.replace(".", "/"), tensor)
        # A step may leave tensors out: the discriminator's, where no query is right. In a step
        # that uses all, PyTorch warns that looking for such tensors is a waste, unless one is
        # never used.
        self.register_parameter("never used", nn.Parameter(torch.zeros(())))

    def forward(self, rng: np.random.Generator) -> tuple[Tensor, float]:
        """Its loss is `count` times the share: what becomes of gradients is their mean."""
        loss, accuracy = self._share(rng)
        return loss * self._count, accuracy


def launched() -> Processes:
    """The processes that `torchrun` started, or this one alone."""
    if not distributed.is_torchelastic_launched():
        return ALONE
    return Processes(int(os.environ["RANK"]), int(os.environ["WORLD_SIZE"]))


def joined() -> Processes:
    """The processes of this run, able to talk to each other until this one ends."""
    processes = launched()
    if processes.count > 1 and not distributed.is_initialized():
        distributed.init_process_group("gloo")
        # Otherwise its threads may outlive what they use: a process then crashes at its end, now
        # and then, and torchrun kills the first one, which may not have written the weights yet.
        atexit.register(distributed.destroy_process_group)
    return processes
