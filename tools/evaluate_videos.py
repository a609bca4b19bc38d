"""Measure recognition on videos of people: one clip enrolled an action, everything else asked.

    python tools/evaluate_videos.py FOLDER --actions jumping_jack squat lunge push_up

FOLDER holds ACTION/PERSON.*. Every way to enrol one clip of each of the actions is tried; the
other clips of these actions are to be recognised, all remaining actions rejected. Then, for
`watch`, one clip each is enrolled and all others are joined into one video, in an order drawn from
`--seed`; its events are compared with what was joined, over several such videos. Last, an action is
enrolled by one of its repetitions in a video, and counted in that video among all others.
`repetitions.csv` holds what a person counted on stills, 8 to 24 a second: whole repetitions, each
from the posture in which the enrolled one begins, of the same side; of punches pairs, of a walk
strides. Prints tables in Markdown.
"""

from __future__ import annotations

import argparse
import csv
import itertools
import tempfile
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
from measure_live import ENROLLED, Looks, Performance, Score, told

from actioncli.clips.clip import Clip
from actioncli.live.events import STRIDE, Event, EventDetector
from actioncli.live.stream import PoseStream, file_frames
from actioncli.pose import ReadOptions
from actioncli.pose.frames import VideoFile
from actioncli.pose.region import Image
from actioncli.pose.video import clip_of, read_poses
from actioncli.recognition.recognizer import Recognizer
from actioncli.recognition.support import SupportSet
from actioncli.recognition.threshold import DEFAULT_TAU

# The joined video: size, frame rate, and seconds that a clip may take of it.
SIZE, FPS, LONGEST = (640, 480), 25, 8.0
# Seconds of poses that are remembered; windows are shorter.
REMEMBERED = 9.0
# How often the action is done in each video, and when one of these begins and ends, seconds.
COUNTED = Path(__file__).with_name("repetitions.csv")
# Poses a second.
RATE = 15
TAUS = (0.1, 0.2, 0.3, 0.4, 0.5)


@dataclass(frozen=True)
class Recording:
    """One clip of the folder."""

    label: str
    path: Path
    clip: Clip


def enrolments(
    recordings: Sequence[Recording], actions: Sequence[str]
) -> Iterator[tuple[Recording, ...]]:
    """Every way to choose one recording of each action."""
    choices = [[one for one in recordings if one.label == action] for action in actions]
    return itertools.product(*choices)


def classification(
    recognizer: Recognizer, recordings: Sequence[Recording], actions: Sequence[str]
) -> str:
    """A row: nearest right, accepted right, unknown rejected, and areas under the curves."""
    known: list[tuple[bool, float]] = []
    unknown: list[float] = []
    embedded = {one.path: recognizer.embed([one.clip]) for one in recordings}
    for chosen in enrolments(recordings, actions):
        support = {one.label: embedded[one.path] for one in chosen}
        asked = [one for one in recordings if one not in chosen]
        queries = np.concatenate([embedded[one.path] for one in asked])
        compared = recognizer.compare(queries, support)
        for one, distance, confidence in zip(
            asked, compared.distance, compared.confidence, strict=True
        ):
            nearest = int(distance.argmin())
            sure = float(confidence[nearest])
            if one.label in actions:
                known.append((str(compared.labels[nearest]) == one.label, sure))
            else:
                unknown.append(sure)
    right = np.array([correct for correct, _ in known])
    sure = np.array([confidence for _, confidence in known])
    apart = np.mean(sure[:, np.newaxis] > np.array(unknown))
    return (
        f"{right.mean():.2f} | {(right & (sure > DEFAULT_TAU)).mean():.2f} | "
        f"{np.mean(np.array(unknown) <= DEFAULT_TAU):.2f} | {apart:.2f} | "
        f"{len(known)} + {len(unknown)}"
    )


def letterboxed(image: Image) -> Image:
    """The whole picture in the joined video's size, on black."""
    height, width = image.shape[:2]
    scale = min(SIZE[0] / width, SIZE[1] / height)
    small = cv2.resize(image, (round(width * scale), round(height * scale)))
    out = np.zeros((SIZE[1], SIZE[0], 3), np.uint8)
    top, left = (SIZE[1] - small.shape[0]) // 2, (SIZE[0] - small.shape[1]) // 2
    out[top : top + small.shape[0], left : left + small.shape[1]] = small
    return out


def join(
    parts: Sequence[Recording], path: Path, longest: float = LONGEST
) -> list[tuple[str, float, float]]:
    """Write the clips one after another; returns label, start and end of each."""
    writer = cv2.VideoWriter(str(path), cv2.VideoWriter.fourcc(*"mp4v"), FPS, SIZE)
    truth, written = [], 0
    for part in parts:
        start = written
        for frame in VideoFile(part.path).frames(end=longest):
            # Repeats frames of slow videos and leaves out some of fast ones.
            while written - start <= frame.time * FPS:
                writer.write(letterboxed(frame.image))
                written += 1
        truth.append((part.label, start / FPS, written / FPS))
    writer.release()
    return truth


def looks_at(path: Path, detector: EventDetector, quality: str) -> Looks:
    """What each look at a video says of each window and action, the last seconds, and when."""
    return [(detector.look(clip), clip, now) for clip, now in seen_in(path, quality)]


def seen_in(path: Path, quality: str) -> list[tuple[Clip | None, float]]:
    """The last seconds at each look at a video, and when."""
    poses = PoseStream(quality, seconds=REMEMBERED)
    seen: list[tuple[Clip | None, float]] = []
    for frame in file_frames(VideoFile(path)):
        poses.add(frame)
        if not seen or frame.time - seen[-1][1] >= STRIDE:
            seen.append((poses.clip(), frame.time))
    return seen


@dataclass
class Tally:
    """Events over several joined videos.

    Attributes:
        performed: performances of enrolled actions.
        right: events of the right label during one, the first of each.
        more: further events during a performance, which is of several repetitions.
        wrong: all other events.
    """

    performed: int = 0
    right: int = 0
    more: int = 0
    wrong: int = 0

    def add(self, events: Sequence[Event], truth: Sequence[tuple[str, float, float]]) -> None:
        """Count the events of a video against label, start and end of what was performed."""
        self.performed += len(truth)
        open_ = list(truth)
        for event in events:
            during = [
                one
                for one in truth
                if one[0] == event.label and event.start < one[2] and one[1] < event.end
            ]
            first = next((one for one in during if one in open_), None)
            if first is not None:
                open_.remove(first)
                self.right += 1
            elif during:
                self.more += 1
            else:
                self.wrong += 1

    def row(self) -> str:
        """Cells of a table."""
        events = self.right + self.wrong
        precision = f"{self.right / events:.2f}" if events else "-"
        recall = f"{self.right / self.performed:.2f}" if self.performed else "-"
        return (
            f"{precision} | {recall} | {self.performed} | {self.right} | {self.more} | {self.wrong}"
        )


def watching(
    recognizer: Recognizer,
    recordings: Sequence[Recording],
    actions: Sequence[str],
    quality: str,
    videos: int,
    seed: int,
) -> list[str]:
    """Rows: tau, and precision and recall of events over several joined videos."""
    tallies = {tau: Tally() for tau in TAUS}
    random = np.random.default_rng(seed)
    ways = list(enrolments(recordings, actions))
    for way in random.permutation(len(ways))[:videos]:
        chosen = ways[way]
        rest = [one for one in recordings if one not in chosen]
        parts = [rest[n] for n in random.permutation(len(rest))]
        support = SupportSet.from_clips({one.label: [one.clip] for one in chosen}, recognizer)
        detector = EventDetector(support)
        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder, "joined.mp4")
            truth = join(parts, path)
            looks = looks_at(path, detector, quality)
        for tau, tally in tallies.items():
            events = [event for event, _ in told(looks, support.with_tau(tau))]
            tally.add(events, [one for one in truth if one[0] in actions])
    return [f"{tau} | {tally.row()}" for tau, tally in tallies.items()]


def counting(
    recognizer: Recognizer, recordings: Sequence[Recording], quality: str, seed: int
) -> list[str]:
    """Rows: tau, and how well sets are counted in all videos joined to one.

    For each set its action is enrolled by one of its repetitions, beside three other actions. Other
    people's performances of these actions are left out of account.
    """
    with COUNTED.open(newline="") as file:
        rows = {row["video"]: row for row in csv.DictReader(file)}
    random = np.random.default_rng(seed)
    parts = [recordings[n] for n in random.permutation(len(recordings))]
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder, "joined.mp4")
        truth = join(parts, path, longest=np.inf)
        seen = seen_in(path, quality)
    counts = [int(rows.get(_name(one), {"repetitions": 1})["repetitions"]) for one in parts]
    scores = {tau: Score() for tau in TAUS}
    for chosen in (at for at, count in enumerate(counts) if count > 1):
        enrolled = {parts[chosen].label: chosen}
        for at in random.permutation(len(parts)).tolist():
            if counts[at] > 1 and len(enrolled) < ENROLLED:
                enrolled.setdefault(parts[at].label, at)
        ones = {}
        for label, at in enrolled.items():
            row = rows[_name(parts[at])]
            start, end = float(row["start"]), float(row["end"])
            path = parts[at].path
            part = ReadOptions(start=start, end=end, quality=quality)
            ones[label] = [clip_of(read_poses(path, part, rate=RATE), path, whole=True)]
        support = SupportSet.from_clips(ones, recognizer)
        detector = EventDetector(support)
        looks: Looks = [(detector.look(clip), clip, now) for clip, now in seen]
        done = tuple(Performance(*truth[at], counts[at]) for at in enrolled.values())
        strangers = [
            (start, end)
            for at, (label, start, end) in enumerate(truth)
            if label in enrolled and at != enrolled[label]
        ]
        for tau, score in scores.items():
            events = [
                (event, now)
                for event, now in told(looks, support.with_tau(tau))
                if not any(start < event.end and event.start < end for start, end in strangers)
            ]
            score.add(seen[-1][1], done, events)
    return [" | ".join([f"{tau}", *score.cells()]) for tau, score in scores.items()]


def _name(recording: Recording) -> str:
    return f"{recording.label}/{recording.path.name}"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("folder", type=Path)
    parser.add_argument("--actions", nargs="+", required=True)
    parser.add_argument("--weights", type=Path)
    parser.add_argument("--qualities", nargs="+", default=["fast", "accurate"])
    parser.add_argument("--rates", nargs="*", type=float, default=[10, 15, 30])
    parser.add_argument("--videos", type=int, default=6, help="joined videos for watch")
    parser.add_argument("--seed", type=int, default=0, help="of their enrolments and orders")
    arguments = parser.parse_args()
    recognizer = Recognizer(arguments.weights)
    paths = sorted(path for path in arguments.folder.glob("*/*") if path.is_file())

    def read(quality: str, rate: float) -> list[Recording]:
        seen = ((p, read_poses(p, ReadOptions(quality=quality), rate=rate)) for p in paths)
        return [Recording(p.parent.name, p, clip_of(poses, p, whole=False)) for p, poses in seen]

    print("| quality | poses/s | nearest right | accepted right | unknown rejected | AUROC | n |")
    print("| --- | --- | --- | --- | --- | --- | --- |")
    for quality, rate in itertools.product(arguments.qualities, arguments.rates):
        row = classification(recognizer, read(quality, rate), arguments.actions)
        print(f"| {quality} | {rate:g} | {row} |", flush=True)
    if arguments.videos:
        print("\n| quality | tau | precision | recall | performances | right | more | wrong |")
        print("|" + " --- |" * 8)
    counted: dict[str, list[str]] = {}
    for quality in arguments.qualities if arguments.videos else ():
        recordings = read(quality, RATE)
        for row in watching(
            recognizer, recordings, arguments.actions, quality, arguments.videos, arguments.seed
        ):
            print(f"| {quality} | {row} |", flush=True)
        counted[quality] = counting(recognizer, recordings, quality, arguments.seed)
    if counted:
        print(
            "\n| quality | tau | false events an hour | performances told | repetitions told "
            "| sets within one | told after, s |"
        )
        print("|" + " --- |" * 7)
    for quality, rows in counted.items():
        for row in rows:
            print(f"| {quality} | {row} |")


if __name__ == "__main__":
    main()
