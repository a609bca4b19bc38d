"""A warm query on one thread against 5 and 1,000 enrolled actions, beside the bare arithmetic.

    python tests/benchmarks/query.py

The query is a clip (preparation and embedding are part of the time), the support set its
embeddings, as the store hands them over. The bare arithmetic is what the equations need in
matrix products and exponentials of the same sizes, in plain numpy.
"""

import os

# Before numpy reads them.
os.environ.update(OMP_NUM_THREADS="1", OPENBLAS_NUM_THREADS="1", MKL_NUM_THREADS="1")

import statistics
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np

import actioncli
from actioncli.model.config import ModelConfig
from actioncli.model.trx_os import parameter_shapes
from actioncli.model.weights import Weights

EXAMPLES = Path(__file__).parent.parent.parent / "examples"
# Milliseconds a query may take, by number of enrolled actions.
LIMITS = {"paper": {5: 3.0, 1000: 350.0}, "default": {5: 6.0, 1000: 200.0}}
PAIRS, WIDTH, TUPLE, HIDDEN = 120, 128, 16, 256
BLOCK = 16


def bare(actions: int) -> Callable[[], object]:
    """The paper's comparison of one query with `actions` clips, nothing else."""
    random = np.random.default_rng(0)
    query, keys, values = (
        random.standard_normal((n, PAIRS, WIDTH), dtype=np.float32) for n in (1, actions, actions)
    )
    reduce = random.standard_normal((WIDTH, TUPLE), dtype=np.float32)
    judge = random.standard_normal((PAIRS * TUPLE, HIDDEN), dtype=np.float32)

    def run() -> object:
        for at in range(0, actions, BLOCK):
            block = slice(at, at + BLOCK)
            weights = np.exp(query @ np.swapaxes(keys[block], 1, 2) / WIDTH)
            difference = query - weights @ values[block] / weights.sum(axis=-1, keepdims=True)
            np.sqrt((difference * difference).sum(axis=-1)).mean(axis=-1)
            (difference @ reduce).reshape(len(difference), -1) @ judge
        return None

    return run


def milliseconds(call: Callable[[], object], rounds: int) -> float:
    """Median processor time of a call, after one that is not counted.

    On one thread that is the time on an idle machine, however busy this one is.
    """
    call()
    times = []
    for _ in range(rounds):
        start = time.thread_time()
        call()
        times.append(time.thread_time() - start)
    return 1e3 * statistics.median(times)


def untrained() -> actioncli.Recognizer:
    """The published model; time depends on its sizes alone."""
    config = ModelConfig()
    random = np.random.default_rng(0)
    tensors = {
        name: random.standard_normal(shape, dtype=np.float32) / np.float32(shape[0] ** 0.5)
        for name, shape in parameter_shapes(config).items()
    }
    return actioncli.Recognizer(Weights(config, tensors, {}, "paper", Path()))


def measure(recipe: str, recognizer: actioncli.Recognizer) -> None:
    """Print a line for each number of actions."""
    clips = [actioncli.read_clip(path) for path in sorted(EXAMPLES.glob("*/*.npz"))]
    embeddings = recognizer.embed(clips)
    random = np.random.default_rng(0)
    for actions, limit in LIMITS[recipe].items():
        picked = embeddings[random.integers(len(embeddings), size=actions)]
        varied = picked * random.normal(1, 0.05, picked.shape).astype(np.float32)
        support = {f"action {k}": varied[k : k + 1] for k in range(actions)}
        rounds = max(5, 500 // actions)
        ours = milliseconds(lambda s=support: recognizer.classify(clips[0], s), rounds)
        plain = milliseconds(bare(actions), rounds)
        print(
            f"{recipe:7} {actions:5} actions: {ours:7.1f} ms a query (at most {limit:g}), "
            f"bare arithmetic {plain:.1f} ms, ratio {ours / plain:.2f}"
        )


def main() -> None:
    measure("paper", untrained())
    measure("default", actioncli.Recognizer())


if __name__ == "__main__":
    main()
