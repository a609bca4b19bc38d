"""Compare our BlazePose with mediapipe 0.10.21: world landmarks on stills, and speed.

Needs an environment of its own (Python 3.11 or 3.12), because mediapipe pins an old numpy:

    pip install mediapipe==0.10.21 onnxruntime
    PYTHONPATH=. python tools/compare_mediapipe.py VIDEOS --heavy pose_landmark_heavy.tflite

VIDEOS is a folder. mediapipe 0.10.21 lacks the network of complexity 2; the npm package
`@mediapipe/pose` 0.5.1675469404 has it, and `--heavy` names its file, which is put where mediapipe
looks for it. Prints tables in Markdown.
"""

from __future__ import annotations

import argparse
import os
import shutil
import time
from collections.abc import Sequence
from pathlib import Path

import cv2
import mediapipe
import numpy as np

from actioncli.pose.detector import PersonDetector
from actioncli.pose.landmarks import LandmarkEstimator
from actioncli.pose.region import Image
from actioncli.pose.tracker import Tracker

NETWORKS = (("full", "fast", 1), ("heavy", "accurate", 2))


def stills(videos: Sequence[Path], count: int) -> list[tuple[str, Image]]:
    """Frames spread evenly over the videos, and over each one's length."""
    found = []
    for n in range(count):
        path = videos[n % len(videos)]
        rounds = -(-count // len(videos))
        capture = cv2.VideoCapture(str(path))
        frames = capture.get(cv2.CAP_PROP_FRAME_COUNT)
        capture.set(cv2.CAP_PROP_POS_FRAMES, int(frames * (n // len(videos) + 0.5) / rounds))
        read, image = capture.read()
        if read:
            found.append((f"{path.parent.name}/{path.name}", image))
    return found


def accuracy(images: Sequence[tuple[str, Image]], quality: str, complexity: int) -> list[float]:
    """Worst joint of each still on which mediapipe finds somebody, millimetres."""
    detect, estimate = PersonDetector(), LandmarkEstimator(quality)
    worst = []
    with mediapipe.solutions.pose.Pose(
        static_image_mode=True, model_complexity=complexity
    ) as reference:
        for name, image in images:
            theirs = reference.process(cv2.cvtColor(image, cv2.COLOR_BGR2RGB)).pose_world_landmarks
            ours = detect(image)
            if theirs is None or not ours:
                print(f"<!-- {name}: mediapipe {theirs is not None}, ours {bool(ours)} -->")
                continue
            expected = np.array([(p.x, p.y, p.z) for p in theirs.landmark])
            got = estimate(image, ours[0].region).world
            worst.append(1000 * float(np.linalg.norm(got - expected, axis=1).max()))
    return worst


def speeds(clip: Sequence[Image], quality: str, complexity: int) -> tuple[float, float]:
    """Frames per second of mediapipe's and of our tracking, on frames already decoded.

    Both take every frame in turn, so that whatever else the machine does disturbs both; the rate
    is that of the least disturbed tenth of the frames.
    """
    tracker = Tracker(PersonDetector(), LandmarkEstimator(quality))
    times: list[tuple[float, float]] = []
    with mediapipe.solutions.pose.Pose(model_complexity=complexity) as reference:
        for n, image in enumerate(clip):
            rgb = cv2.cvtColor(image, cv2.COLOR_BGR2RGB)
            start = time.perf_counter()
            reference.process(rgb)
            middle = time.perf_counter()
            tracker(image, n / 30)
            times.append((middle - start, time.perf_counter() - middle))
    theirs, ours = 1 / np.quantile(times[10:], 0.1, axis=0)
    return float(theirs), float(ours)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("videos", type=Path)
    parser.add_argument("--heavy", type=Path, required=True, help="pose_landmark_heavy.tflite")
    parser.add_argument("--stills", type=int, default=20)
    parser.add_argument("--frames", type=int, default=120, help="frames of the clip for speed")
    arguments = parser.parse_args()
    modules = Path(mediapipe.__file__).parent / "modules" / "pose_landmark"
    shutil.copyfile(arguments.heavy, modules / "pose_landmark_heavy.tflite")
    videos = sorted(path for path in arguments.videos.rglob("*") if path.is_file())

    images = stills(videos, arguments.stills)
    print("| network | stills | worst joint, median (mm) | worst joint, largest (mm) |")
    print("| --- | --- | --- | --- |")
    for name, quality, complexity in NETWORKS:
        worst = accuracy(images, quality, complexity)
        print(f"| {name} | {len(worst)} | {np.median(worst):.2f} | {max(worst):.2f} |", flush=True)

    clip = []
    capture = cv2.VideoCapture(str(videos[0]))
    while len(clip) < arguments.frames and (frame := capture.read())[0]:
        clip.append(np.asarray(frame[1], np.uint8))
    cores = sorted(os.sched_getaffinity(0))
    print("\n| network | cores | mediapipe (frames/s) | actioncli (frames/s) | factor |")
    print("| --- | --- | --- | --- | --- |")
    for count in range(1, min(2, len(cores)) + 1):
        os.sched_setaffinity(0, cores[:count])
        for name, quality, complexity in NETWORKS:
            theirs, ours = speeds(clip, quality, complexity)
            row = f"{theirs:.1f} | {ours:.1f} | {ours / theirs:.2f}"
            print(f"| {name} | {count} | {row} |", flush=True)


if __name__ == "__main__":
    main()
