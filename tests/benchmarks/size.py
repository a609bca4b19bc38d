"""Support sets from 5 to 10,000 examples: warm latency, memory, cold start.

    python tests/benchmarks/size.py [--out docs/size.svg]

10,000 examples are the example clips, varied. Each size is measured in a process of its own;
`classify` is the whole command on one clip, reading the store included. Processor time of two
threads counts twice, and is what an idle machine would show on one; the wall clock is what this
machine showed.
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
from actioncli.clips.skeleton import DEFAULT_JOINTS, select_joints
from actioncli.clips.write import write_clip
from actioncli.report.plots import Axis, Plot, fitting

EXAMPLES = Path(__file__).parent.parent.parent / "examples"
# Actions and examples of each.
SIZES = ((5, 1), (100, 1), (1000, 1), (100, 100), (10000, 1))
LIMIT_SECONDS, LIMIT_MEGABYTES = 0.5, 1000
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
    found = {"wall": statistics.median(wall[1:]), "processor": statistics.median(processor[1:])}
    print(json.dumps({**found, "peak": peak}))


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
        plot.line(xs, [found[size][key] for size in sizes], series, name)
    drawing = re.search(r"<svg.*?</svg>", plot.html(), re.S)
    assert drawing
    legend = "".join(
        f'<text x="60" y="{28 + 16 * line}" style="fill:var(--s{line})">{name}</text>'
        for line, (_, name) in enumerate(drawn)
    )
    opened = '<svg xmlns="http://www.w3.org/2000/svg" '
    whole = drawing[0].replace("<svg ", opened, 1).replace(">", f">{STYLE}", 1)
    return whole.replace("</svg>", f"{legend}</svg>\n")


def main() -> None:
    parser = argparse.ArgumentParser()
    parser.add_argument("--out", type=Path)
    parser.add_argument("--fill", nargs=3)
    parser.add_argument("--query", type=Path)
    given = parser.parse_args()
    if given.fill:
        return fill(Path(given.fill[0]), int(given.fill[1]), int(given.fill[2]))
    if given.query:
        return query(given.query)
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
