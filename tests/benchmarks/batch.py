"""`classify` of 1,000 files against five actions, beside reading those files with numpy.load.

    python tests/benchmarks/batch.py [--clips 1000] [--rounds 3]

The files are as people keep poses: 90 to 130 frames of the 30 joints of MeTRAbs, as float32 (what
MeTRAbs gives) with names and frame rate, not compressed (as the example clips) and compressed, as
float64 (what NumPy makes of them), and as `extract` writes them, with unit, axis and confidence.
`classify` is the whole process, Python's start and the store included; numpy.load reads every
array of every file, in this process, where numpy is loaded already. Rounds are interleaved.
Two threads at most. Processor time is what an idle machine would need on one core.
"""

import argparse
import os
import resource
import statistics
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np
from startup import EXAMPLES, fill

import actioncli
from actioncli.clips.write import write_clip

LIMIT = 3.0
KINDS = ("uncompressed", "float32", "float64", "extract")


def make(folder: Path, clips: int, kind: str) -> list[Path]:
    """Example clips at other speeds, with the noise of a pose estimator."""
    random = np.random.default_rng(0)
    shown = [actioncli.read_clip(path) for path in sorted(EXAMPLES.glob("*/*.npz"))]
    paths = []
    for number in range(clips):
        clip = shown[number % len(shown)]
        at = np.linspace(0, len(clip) - 1, int(random.integers(90, 131)))
        before = np.minimum(at.astype(int), len(clip) - 2)
        share = (at - before)[:, None, None]
        joints = clip.joints[before] * (1 - share) + clip.joints[before + 1] * share
        joints = joints + random.normal(0, 0.003, joints.shape)
        paths.append(folder / f"{number:04}.npz")
        if kind == "extract":
            seen = random.uniform(0.5, 1, joints.shape[:2])
            write_clip(paths[-1], actioncli.Clip(joints, clip.joint_names, 30, seen))
            continue
        save = np.savez if kind == "uncompressed" else np.savez_compressed
        save(
            paths[-1],
            poses3d=(1000 * joints).astype("float64" if kind == "float64" else "float32"),
            joint_names=np.array(clip.joint_names),
            fps=np.float64(30),
        )
    return paths


def processor() -> float:
    """Seconds of processor time that this process and its children used."""
    used = [resource.getrusage(who) for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN)]
    return sum(each.ru_utime + each.ru_stime for each in used)


def main() -> None:
    parser = argparse.ArgumentParser()
    parser.add_argument("--clips", type=int, default=1000)
    parser.add_argument("--rounds", type=int, default=3)
    given = parser.parse_args()
    with tempfile.TemporaryDirectory() as name:
        store = Path(name) / "support.db"
        fill(store)
        command = [sys.executable, "-m", "actioncli", "--store", str(store), "classify", "--json"]
        environment = {**os.environ, "OMP_NUM_THREADS": "2", "OPENBLAS_NUM_THREADS": "2"}
        for kind in KINDS:
            folder = Path(name) / kind
            folder.mkdir()
            paths = make(folder, given.clips, kind)

            def load(paths: list[Path] = paths) -> None:
                for path in paths:
                    with np.load(path) as file:
                        for key in file.files:
                            file[key]

            def classify(folder: Path = folder) -> None:
                done = subprocess.run(
                    [*command, str(folder)], env=environment, capture_output=True, check=False
                )
                if done.returncode not in (0, 1):
                    sys.exit(done.stderr.decode())

            seconds: dict[str, list[tuple[float, float]]] = {"numpy.load": [], "classify": []}
            # The first round fills the disk cache and the store's embeddings and is not counted.
            for turn in range(given.rounds + 1):
                for what, run in (("numpy.load", load), ("classify", classify)):
                    begun, used = time.perf_counter(), processor()
                    run()
                    if turn:
                        seconds[what].append((time.perf_counter() - begun, processor() - used))
            wall, used = (
                [statistics.median(times[at] for times in seconds[what]) for what in seconds]
                for at in (0, 1)
            )
            print(
                f"{kind}: numpy.load {wall[0]:.2f} s, classify {wall[1]:.2f} s, ratio "
                f"{wall[1] / wall[0]:.1f} (at most {LIMIT:g}); processor time {used[0]:.2f} s, "
                f"{used[1]:.2f} s, ratio {used[1] / used[0]:.1f}",
                flush=True,
            )


if __name__ == "__main__":
    main()
