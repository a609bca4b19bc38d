"""Training episodes a second against the plain formulation, same batch, one run.

    python tests/benchmarks/training.py

The plain formulation follows the paper to the letter: for each pair of a query and a support clip
it concatenates the features of all frame pairs of both, (120, 2D), and maps those. Forward and
backward pass, random motion (time does not depend on it); needs the extra `train`.
"""

import statistics
import time
from collections.abc import Callable

import numpy as np
import torch
from torch import Tensor
from torch.nn import functional

from actioncli.model import trx_os
from actioncli.model.config import ModelConfig
from actioncli.training.paper import PaperRecipe, episode_loss

ROUNDS = 10
RECIPE = PaperRecipe()
Params = dict[str, Tensor]


def plain_loss(
    params: Params, config: ModelConfig, support: Tensor, queries: Tensor, targets: Tensor
) -> Tensor:
    """The paper's loss, pair of clips by pair of clips, episode by episode."""
    width = config.width
    first, second = map(torch.tensor, trx_os.pair_indices(support.shape[2]))
    encoding = torch.from_numpy(trx_os.positional_encoding(support.shape[2], width))

    def tuples(frames: Tensor) -> Tensor:
        features = trx_os.psi(params, frames) + encoding
        return torch.cat([features[..., first, :], features[..., second, :]], dim=-1)

    def mapped(pairs: Tensor) -> tuple[Tensor, Tensor]:
        keys = pairs @ params["key.weight"] + params["key.bias"]
        norm = params["key.norm.scale"], params["key.norm.shift"]
        keys = functional.layer_norm(keys, keys.shape[-1:], *norm)
        return keys, pairs @ params["value.weight"] + params["value.bias"]

    losses = []
    for episode in range(len(support)):
        differences = []
        for query in queries[episode]:
            both = torch.stack([query.expand_as(support[episode]), support[episode]])
            (query_keys, keys), (query_values, values) = mapped(tuples(both))
            differences.append(
                query_values - trx_os.prototypes(trx_os.attention(query_keys, keys), values)
            )
        difference = torch.stack(differences)  # (Q, K, P, W)
        distances = trx_os.distance(difference)
        target = targets[episode]
        known, nearest = target >= 0, distances.argmin(dim=1)
        loss = functional.cross_entropy(-distances[known], target[known])
        chosen = difference[torch.arange(len(target)), nearest]
        yes, no = chosen[known & (nearest == target)], chosen[~known]
        z = min(len(yes), len(no))
        if z:
            logits = trx_os.discriminator(params, torch.cat([yes[:z], no[:z]]))
            answers = torch.cat([torch.ones(z), torch.zeros(z)])
            loss = loss + functional.binary_cross_entropy_with_logits(logits, answers)
        losses.append(loss)
    return torch.stack(losses).mean()


def main() -> None:
    config, batch, ways = RECIPE.config, RECIPE.batch, RECIPE.ways
    random = np.random.default_rng(0)
    params = {
        name: torch.tensor(
            random.uniform(-1, 1, shape) / shape[0] ** 0.5, dtype=torch.float32, requires_grad=True
        )
        for name, shape in trx_os.parameter_shapes(config).items()
    }
    frames = config.preparation.frames, len(config.preparation.joints), 3
    support = torch.tensor(random.normal(size=(batch, ways, *frames)), dtype=torch.float32)
    queries = torch.tensor(random.normal(size=(batch, 2 * ways, *frames)), dtype=torch.float32)
    targets = torch.tensor([[*range(ways), *[-1] * ways]] * batch)
    given = params, config, support, queries, targets
    contenders: dict[str, Callable[[], Tensor]] = {
        "actioncli": lambda: episode_loss(*given)[0],
        "plain": lambda: plain_loss(*given),
    }
    seconds: dict[str, list[float]] = {name: [] for name in contenders}
    for turn in range(ROUNDS + 1):
        for name, loss in contenders.items():
            start = time.perf_counter()
            loss().backward()
            if turn:
                seconds[name].append(time.perf_counter() - start)
    rate = {name: batch / statistics.median(times) for name, times in seconds.items()}
    for name, value in rate.items():
        print(f"{name:10}{value:8.1f} episodes a second")
    print(f"ratio {rate['actioncli'] / rate['plain']:.1f} (at least 3)")


if __name__ == "__main__":
    main()
