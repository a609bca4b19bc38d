"""Support sets from 5 to 10,000 examples: warm latency, memory, cold start; and what is lost.

    python tests/benchmarks/size.py [--out docs/size.svg]
    python tests/benchmarks/size.py --recall COLLECTION... [--queries 1000]

The first form needs nothing but the example clips: 10,000 examples are those clips, varied. Each
size is measured in a process of its own; `classify` is the whole command on one clip, reading the
store included. Processor time of two threads counts twice, and is what an idle machine would show
on one; the wall clock is what this machine showed.

The second form measures recall on recordings: how often `compare.scores`, which compares few of so
many actions in full, tells the same nearest action, of the same score, as exact computation. Exact
is the comparison of every action that could be nearer if T and Disc added `MOST` to its logit; of
100 recordings compared in full with 10,000 examples (infinity does that) the largest addition was
-0.2.
"""

import argparse
import json
import os
import re
import resource
import statistics
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np

import actioncli
from actioncli.clips.collection import read_collection
from actioncli.clips.skeleton import DEFAULT_JOINTS, select_joints
from actioncli.clips.write import write_clip
from actioncli.model import compare
from actioncli.report.plots import Axis, Plot, fitting

EXAMPLES = Path(__file__).parent.parent.parent / "examples"
# Actions and examples of each.
SIZES = ((5, 1), (100, 1), (1000, 1), (100, 100), (10000, 1))
LIMIT_SECONDS, LIMIT_MEGABYTES = 0.5, 1000
MOST = 1.0
# Of a logit, between comparison with more and with fewer others.
ROUNDING = 1e-4
SUPPORTS = (1000, 5000, 10000)
STYLE = """<style>
svg { --paper: #fff; --muted: #586069; --line: #d4d9de; --s0: #0072b2; --s1: #c34f00; --s2: #00785a;
  background: var(--paper); }
text { fill: var(--muted); font: 12px system-ui, sans-serif; }
@media (prefers-color-scheme: dark) {
  svg { --paper: #14171a; --muted: #a5adb5; --line: #373e45; --s0: #56b4e9; --s1: #f29544;
    --s2: #35c79b; }
}
</style>"""
WARM = 9


def fill(folder: Path, actions: int, each: int) -> None:
    """A store of varied example clips, embeddings included, and a query beside it."""
    recognizer = actioncli.Recognizer()
    clips = [actioncli.read_clip(path) for path in sorted(EXAMPLES.glob("*/*.npz"))]
    embeddings = recognizer.embed(clips)
    random = np.random.default_rng(0)

    def varied(given: list[actioncli.Clip]) -> np.ndarray:
        # Two motions blended and begun at another time; a like number of near copies would be
        # unlike any collection of recordings.
        one, other = embeddings[random.integers(len(embeddings), size=2)]
        share = np.float32(random.uniform(0.2, 0.8))
        blend = np.roll(share * one + (1 - share) * other, random.integers(16), axis=0)[None]
        return blend * random.normal(1, 0.05, blend.shape).astype(np.float32)

    def short(number: int) -> actioncli.Clip:
        clip = clips[number % len(clips)]
        # The clip itself is not read again; a few frames of it are as good as all.
        joints = select_joints(clip.joints[::14], clip.joint_names, DEFAULT_JOINTS)
        moved = joints + random.normal(0, 0.01, joints.shape)
        return actioncli.Clip(moved, DEFAULT_JOINTS, clip.fps)

    with actioncli.SupportStore(folder / "support.db") as store:
        examples = [short(n) for n in range(actions * each)]
        store.enroll_all(
            [(f"action {n // each:05}", clip) for n, clip in enumerate(examples)],
            embeddings=[varied([clip])[0] for clip in examples],
            weights_checksum=recognizer.weights.checksum,
        )
    write_clip(folder / "query.npz", clips[0])


def query(folder: Path) -> None:
    """Warm queries in this process, told as JSON."""
    recognizer = actioncli.Recognizer()
    clip = actioncli.read_clip(folder / "query.npz")
    with actioncli.SupportStore(folder / "support.db") as store:
        support = actioncli.SupportSet.load(store, recognizer).actions
    wall, processor = [], []
    for _ in range(WARM + 1):
        begun, used = time.perf_counter(), time.process_time()
        recognizer.classify(clip, support)
        wall.append(time.perf_counter() - begun)
        processor.append(time.process_time() - used)
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
    print(
        json.dumps(
            {
                "wall": statistics.median(wall[1:]),
                "processor": statistics.median(processor[1:]),
                "peak": peak,
            }
        )
    )


def measure(actions: int, each: int) -> dict[str, float]:
    """One size, in a store of its own."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        me = [sys.executable, __file__]
        subprocess.run([*me, "--fill", name, str(actions), str(each)], check=True)
        environment = {**os.environ, "OMP_NUM_THREADS": "2", "OPENBLAS_NUM_THREADS": "2"}
        told = subprocess.run(
            [*me, "--query", name], check=True, capture_output=True, text=True, env=environment
        )
        found: dict[str, float] = json.loads(told.stdout)
        command = [sys.executable, "-m", "actioncli", "--store", str(folder / "support.db")]
        before = resource.getrusage(resource.RUSAGE_CHILDREN)
        begun = time.perf_counter()
        subprocess.run(
            [*command, "classify", str(folder / "query.npz"), "--tau", "0"],
            check=True, capture_output=True, env=environment,
        )  # fmt: skip
        found["cold wall"] = time.perf_counter() - begun
        after = resource.getrusage(resource.RUSAGE_CHILDREN)
        found["cold"] = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
        return found


def curve(found: dict[tuple[int, int], dict[str, float]]) -> str:
    """Latency and cold start over the number of examples, as an SVG for light and dark."""
    sizes = [(actions, each) for actions, each in found if each == 1]
    xs = [float(np.log10(actions)) for actions, _ in sizes]
    decades = (0.0, 1.0, 2.0, 3.0, 4.0)
    kinds = {"processor": "warm query", "cold": "whole classify"}
    drawn = [
        (key, name) for key, name in kinds.items() if all(key in found[size] for size in sizes)
    ]
    plot = Plot(
        "Support sets of 5 to 10,000 examples",
        Axis("examples, as a power of ten", 0, 4, decades),
        fitting("seconds of processor time", 0, max(found[s][k] for s in sizes for k, _ in drawn)),
    )
    for series, (key, name) in enumerate(drawn):
        plot.line(xs, [found[size][key] for size in sizes], series, name, [4.0] * len(xs))
    drawing = re.search(r"<svg.*?</svg>", plot.html(), re.S)
    assert drawing
    legend = "".join(
        f'<text x="60" y="{28 + 16 * line}" style="fill:var(--s{line})">{name}</text>'
        for line, (_, name) in enumerate(drawn)
    )
    opened = '<svg xmlns="http://www.w3.org/2000/svg" '
    whole = drawing[0].replace("<svg ", opened, 1).replace(">", f">{STYLE}", 1)
    return whole.replace("</svg>", f"{legend}</svg>\n")


def recall(paths: list[Path], queries: int) -> None:
    """How often `compare.scores` tells the nearest of recordings and their mirror images."""
    recognizer = actioncli.Recognizer()
    config, params = recognizer.weights.config, recognizer.weights.tensors
    embedded, labels = [], []
    for path in paths:
        collection = read_collection(path)
        labels += [f"{collection.name}/{label}" for label in collection.labels]
        starts = range(0, len(collection), 64)
        embedded += [recognizer.embed(collection.clips[at : at + 64]) for at in starts]
    clips, names = np.concatenate(embedded), np.tile(labels, 2)
    width = config.view_width
    turned = [clips[..., width : 2 * width], clips[..., :width], clips[..., 2 * width :]]
    everything = np.concatenate([clips, np.concatenate(turned, axis=2)])
    actions = list(everything[:, None])
    # Other queries than those by which the constants of `compare` were chosen, seed 0.
    random = np.random.default_rng(1)
    asked = random.permutation(len(clips))[:queries]
    # Of each query: whether the nearest was told, whether the decision is the same at a confidence
    # of one half, and the nearest's place in the order of approximate logits.
    told: dict[tuple[int, bool], list[tuple[bool, bool, int]]] = {}
    for number, one in enumerate(asked, start=1):
        query = clips[one : one + 1]
        cheap = compare.approximate_logit(params, compare.warp(params, config, query, actions))[0]
        # Never the query itself or its mirror image.
        others = np.arange(len(everything)) % len(clips) != one
        full: dict[int, float] = {}
        for own, allowed in ((True, others), (False, others & (names != names[one]))):
            shuffled = random.permutation(np.flatnonzero(allowed))
            for size in SUPPORTS:
                picked = shuffled[:size]
                logit = compare.scores(params, config, query, [actions[k] for k in picked])[1][0]
                best = float(logit.max())
                ordered = picked[np.argsort(-cheap[picked])]
                possible = ordered[cheap[ordered] + MOST >= best]
                missing = [k for k in possible if k not in full]
                for at in range(0, len(missing), compare.EXACT):
                    # So few are always compared in full.
                    some = missing[at : at + compare.EXACT]
                    scored = compare.scores(params, config, query, [actions[k] for k in some])
                    full.update(zip(some, scored[1][0], strict=True))
                exact = np.array([full[k] for k in possible])
                found = bool(exact.max() <= best + ROUNDING)
                decided = found or (best <= 0 and exact.max() <= 0)
                told.setdefault((size, own), []).append((found, decided, int(exact.argmax())))
        if number % 50 == 0 or number == len(asked):
            for (size, own), of_queries in told.items():
                nearest, same, places = zip(*of_queries, strict=True)
                print(
                    f"{size:6} examples, own action {'in' if own else 'not in'} the support set: "
                    f"of {number} queries the nearest for {sum(nearest)}, the decision for "
                    f"{sum(same)}; it is at most number {max(places) + 1}",
                    flush=True,
                )


def main() -> None:
    parser = argparse.ArgumentParser()
    parser.add_argument("--out", type=Path)
    parser.add_argument("--recall", type=Path, nargs="+")
    parser.add_argument("--queries", type=int, default=1000)
    parser.add_argument("--fill", nargs=3)
    parser.add_argument("--query", type=Path)
    given = parser.parse_args()
    if given.fill:
        return fill(Path(given.fill[0]), int(given.fill[1]), int(given.fill[2]))
    if given.query:
        return query(given.query)
    if given.recall:
        return recall(given.recall, given.queries)
    found = {}
    for actions, each in SIZES:
        one = found[actions, each] = measure(actions, each)
        print(
            f"{actions:6} actions x {each:3}: warm {1e3 * one['processor']:7.1f} ms of processor "
            f"time ({1e3 * one['wall']:.0f} ms on the clock, at most {1e3 * LIMIT_SECONDS:g}), "
            f"peak {one['peak']:.0f} MB (at most {LIMIT_MEGABYTES}), classify "
            f"{one['cold']:.2f} s ({one['cold wall']:.2f} s on the clock)",
            flush=True,
        )
    if given.out:
        given.out.write_text(curve(found), encoding="utf-8")
    return None


if __name__ == "__main__":
    main()
