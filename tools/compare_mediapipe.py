"""Compare body and hands with mediapipe 0.10.21: landmarks on stills, hands found, and speed.

Needs an environment of its own (Python 3.11 or 3.12), because mediapipe pins an old numpy:

    pip install mediapipe==0.10.21 onnxruntime
    PYTHONPATH=. python tools/compare_mediapipe.py VIDEOS --heavy pose_landmark_heavy.tflite

VIDEOS is a folder, and `--hands` names films below it in which hands are followed frame by frame.
mediapipe 0.10.21 lacks the network of complexity 2; the npm package
`@mediapipe/pose` 0.5.1675469404 has it, and `--heavy` names its file, which is put where mediapipe
looks for it; without it, only hands are compared. Prints tables in Markdown.
"""

from __future__ import annotations

import argparse
import os
import shutil
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import cv2
import mediapipe
import numpy as np

from actioncli.clips.clip import FloatArray
from actioncli.pose.detector import PersonDetector
from actioncli.pose.hands import SIDES, HandFinder, HandFollower
from actioncli.pose.landmarks import Body, LandmarkEstimator
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


def hands_of(found: Any, image: Image) -> list[FloatArray | None]:
    """The left and the right hand (21, 2) of Holistic's answer, pixels."""
    size = image.shape[1::-1]
    lists = (found.left_hand_landmarks, found.right_hand_landmarks)
    return [
        None if one is None else np.array([(p.x, p.y) for p in one.landmark], np.float32) * size
        for one in lists
    ]


def apart(ours: Body | None, theirs: Sequence[FloatArray | None]) -> tuple[list[bool], list[float]]:
    """For each hand whether both found it or neither did, and how far the typical joint is from
    theirs, in shares of the hand's size."""
    same, errors = [], []
    for (_, own), hand in zip(SIDES, theirs, strict=True):
        seen = ours is not None and ours.visibility[own.start] > 0
        same.append(seen == (hand is not None))
        if seen and hand is not None and ours is not None:
            size = float(np.linalg.norm(np.ptp(hand, axis=0)))
            away = np.linalg.norm(ours.points[own] - hand, axis=1)
            errors.append(float(np.median(away)) / size)
    return same, errors


def hands_of_stills(images: Sequence[tuple[str, Image]]) -> str:
    """A row: stills, hands that both found, the same answer, typical and largest difference."""
    detect, estimate, find = PersonDetector(), LandmarkEstimator("fast"), HandFinder()
    same, errors, stills = [], [], 0
    with mediapipe.solutions.holistic.Holistic(static_image_mode=True) as reference:
        for _, image in images:
            found = reference.process(cv2.cvtColor(image, cv2.COLOR_BGR2RGB))
            people = detect(image)
            if found.pose_landmarks is None or not people:
                continue
            body = HandFollower(find)(image, estimate(image, people[0].region), 0.0)
            both, off = apart(body, hands_of(found, image))
            stills, same, errors = stills + 1, same + both, errors + off
    difference = f"{np.median(errors):.2%} | {max(errors):.2%}"
    return f"| {stills} stills | {len(errors)} | {np.mean(same):.1%} | {difference} |"


def hands_of_film(path: Path, frames: int) -> tuple[str, FloatArray]:
    """A row as of stills, and the seconds of processor time that mediapipe and we took for each
    frame in which both hands are in view.

    Of all threads, on one core: so other programs disturb it little.
    """
    tracker = Tracker(PersonDetector(), LandmarkEstimator("fast"), 1, HandFinder())
    same: list[bool] = []
    errors: list[float] = []
    times: list[tuple[float, float]] = []
    capture = cv2.VideoCapture(str(path))
    with mediapipe.solutions.holistic.Holistic() as reference:
        for n in range(frames):
            read, image = capture.read()
            if not read:
                break
            rgb = cv2.cvtColor(image, cv2.COLOR_BGR2RGB)
            start = time.process_time()
            found = reference.process(rgb)
            middle = time.process_time()
            seen = tracker(image, n / 30)
            end = time.process_time()
            both, off = apart(seen[0].bodies[-1] if seen else None, hands_of(found, image))
            same, errors = same + both, errors + off
            if len(off) == 2 and n > 9:
                times.append((middle - start, end - middle))
    name = f"{path.parent.name}/{path.name}"
    row = f"{np.mean(same):.1%} | {np.median(errors):.2%} | {max(errors):.2%}"
    return f"| {name} | {len(errors)} | {row} |", np.array(times, np.float32).reshape(-1, 2)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("videos", type=Path)
    parser.add_argument("--heavy", type=Path, help="pose_landmark_heavy.tflite")
    parser.add_argument("--hands", type=Path, nargs="*", default=[], help="films, below the folder")
    parser.add_argument("--stills", type=int, default=20)
    parser.add_argument("--frames", type=int, default=120, help="frames of the clips")
    arguments = parser.parse_args()
    videos = sorted(path for path in arguments.videos.rglob("*") if path.is_file())
    images = stills(videos, arguments.stills)
    if arguments.heavy is not None:
        bodies(videos[0], images, arguments.heavy, arguments.frames)

    cores = sorted(os.sched_getaffinity(0))
    os.sched_setaffinity(0, cores[:1])
    print("\n| hands of | seen by both | same answer | off, median | off, largest |")
    print("| --- | --- | --- | --- | --- |")
    print(hands_of_stills(images), flush=True)
    rates = []
    for name in arguments.hands:
        row, times = hands_of_film(arguments.videos / name, arguments.frames)
        print(row, flush=True)
        if len(times):
            theirs, ours = 1 / np.quantile(times, 0.1, axis=0)
            rates.append(f"| {name} | {theirs:.1f} | {ours:.1f} | {ours / theirs:.2f} |")
    print("\n| both hands in view | Holistic (frames/s) | actioncli (frames/s) | factor |")
    print("| --- | --- | --- | --- |")
    print("\n".join(rates))


def bodies(video: Path, images: Sequence[tuple[str, Image]], heavy: Path, frames: int) -> None:
    """Print how far bodies are from mediapipe's, and frames a second on one core and on two."""
    modules = Path(mediapipe.__file__).parent / "modules" / "pose_landmark"
    shutil.copyfile(heavy, modules / "pose_landmark_heavy.tflite")
    print("| network | stills | worst joint, median (mm) | worst joint, largest (mm) |")
    print("| --- | --- | --- | --- |")
    for name, quality, complexity in NETWORKS:
        worst = accuracy(images, quality, complexity)
        print(f"| {name} | {len(worst)} | {np.median(worst):.2f} | {max(worst):.2f} |", flush=True)

    clip = []
    capture = cv2.VideoCapture(str(video))
    while len(clip) < frames and (frame := capture.read())[0]:
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
