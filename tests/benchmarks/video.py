"""Frames a second of the whole way from a video to poses, beside the bare landmark network.

    python tests/benchmarks/video.py [VIDEO]

The way is decoding, detector, regions, landmarks and tracking, every frame of five seconds; the
bare network runs as often, on a picture that lies ready. VIDEO shows one person; without it a
recording beside the repository is taken, and without one there is nothing to measure. Rounds are
interleaved, and the best of each counts, so that a busy machine disturbs the ratio little.

As many videos are read, the way is also measured on each core by itself, at the same time; the bare
network still has all cores. Loading the networks is not counted.
"""

import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np

from actioncli.archives.processes import cores, in_processes
from actioncli.pose.detector import PersonDetector
from actioncli.pose.frames import VideoFile
from actioncli.pose.landmarks import SIDE, LandmarkEstimator
from actioncli.pose.networks import LANDMARKS, Network
from actioncli.pose.tracker import Tracker

ROUNDS = 5
SECONDS = 5.0  # of the video
# The network's share of the time; what is beside it may cost 15 %.
LIMIT = 0.85
ON_EACH_CORE = "--on-each-core"
RECORDINGS = Path(__file__).resolve().parents[3] / "shared" / "video"


def seconds(call: Callable[[], object]) -> float:
    start = time.perf_counter()
    call()
    return time.perf_counter() - start


def on_each_core(video: Path, quality: str) -> None:
    """Print the frames a second of the whole way on all cores together, each with a video."""

    def rate(_: int) -> float:
        detect, estimate = PersonDetector(), LandmarkEstimator(quality)
        best = 0.0
        for _ in range(ROUNDS):
            tracker, frames, begun = Tracker(detect, estimate), 0, time.perf_counter()
            for frame in VideoFile(video).frames(end=SECONDS):
                tracker(frame.image, frame.time)
                frames += 1
            best = max(best, frames / (time.perf_counter() - begun))
        return best

    print(sum(in_processes(rate, cores(), cores(), pinned=True)))


def measure(video: Path, quality: str) -> None:
    """Print two lines."""
    detect, estimate = PersonDetector(), LandmarkEstimator(quality)
    network = Network(LANDMARKS[quality])
    picture = np.random.default_rng(0).random((SIDE, SIDE, 3), np.float32)
    frames = 0

    def whole() -> None:
        nonlocal frames
        tracker, frames = Tracker(detect, estimate), 0
        for frame in VideoFile(video).frames(end=SECONDS):
            tracker(frame.image, frame.time)
            frames += 1

    def bare() -> None:
        for _ in range(frames):
            network(picture)

    whole()
    bare()
    rounds = [(seconds(whole), seconds(bare)) for _ in range(ROUNDS)]
    ours, plain = (frames / min(times) for times in zip(*rounds, strict=True))
    # In a process that has run no network, whose threads another process would lack.
    words = [sys.executable, __file__, ON_EACH_CORE, quality, str(video)]
    shared = float(subprocess.run(words, check=True, capture_output=True, text=True).stdout)
    for what, found in (("one video", ours), ("many", shared)):
        print(
            f"{quality:8} {what:9} {found:6.1f} frames/s, the network alone {plain:6.1f}, "
            f"ratio {found / plain:.2f} (at least {LIMIT:g})"
        )


def main() -> None:
    if ON_EACH_CORE in sys.argv:
        return on_each_core(Path(sys.argv[3]), sys.argv[2])
    given = [Path(argument) for argument in sys.argv[1:]]
    videos = given or sorted(RECORDINGS.glob("*/*"))
    if not videos:
        print(f"no video: name one, or put recordings into {RECORDINGS}")
        return None
    for quality in LANDMARKS:
        measure(videos[0], quality)
    return None


if __name__ == "__main__":
    main()
