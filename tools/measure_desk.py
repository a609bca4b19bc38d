"""People seen whole and as at a desk: what is enrolled one way and asked the other.

    python tools/measure_desk.py videos/ --legs squat lunge walk --not-seen push_up

`videos/` holds `label/video.*` of standing people. Each video is cut off below the upper 55 % of
the person; the clips of both are enrolled and asked in all ways at 0.5, the person's own and
others'. Prints how many are refused as an example at a desk, and how many are accepted.
"""

from __future__ import annotations

import argparse
import tempfile
from pathlib import Path

import numpy as np

from actioncli import Clip, ClipError, Recognizer, read_clip
from actioncli.clips.checks import require_usable
from actioncli.pose import VIDEO_SUFFIXES
from actioncli.pose.frames import VideoFile
from actioncli.pose.mp4 import mp4_writer
from actioncli.pose.video import read_poses

UPPER, TAU = 0.55, 0.5
NOSE, SHOULDERS, FEET = 0, [11, 12], [27, 28, 29, 30]


def at_a_desk(video: Path, folder: Path) -> Path:
    """The video with the upper part of the person alone."""
    poses = read_poses(video)
    height = poses.points[..., 1]
    nose, shoulders = height[:, NOSE], height[:, SHOULDERS].mean(axis=1)
    # The top of the head is about as far above the nose as half the way to the shoulders.
    head = np.quantile(nose - 0.6 * (shoulders - nose), 0.02)
    seen = poses.visibility[:, FEET[:2]].max(axis=1) > 0.3
    feet = np.quantile(height[seen][:, FEET], 0.98) if seen.any() else poses.size[1]
    wide, high = poses.size[0] // 2 * 2, min(int(head + UPPER * (feet - head)), poses.size[1])
    file, out = VideoFile(video), folder / f"{video.stem}.mp4"
    with mp4_writer(out, file.fps, ["mp4v"]) as write:
        for frame in file.frames():
            write(np.ascontiguousarray(frame.image[: high // 2 * 2, :wide]))
    return out


def is_refused(clip: Clip) -> bool:
    """Whether it may not be enrolled."""
    try:
        require_usable(clip)
    except ClipError:
        return True
    return False


def main() -> None:
    """See the module."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("videos", type=Path)
    parser.add_argument("--legs", nargs="+", default=["squat", "lunge", "walk"])
    parser.add_argument("--not-seen", nargs="+", default=["push_up", "stand"])
    given = parser.parse_args()
    found = [path for path in given.videos.glob("*/*") if path.suffix in VIDEO_SUFFIXES]
    paths = sorted(path for path in found if path.parent.name not in given.not_seen)
    labels = np.array([path.parent.name for path in paths])
    with tempfile.TemporaryDirectory() as folder:
        cut = [read_clip(at_a_desk(path, Path(folder))) for path in paths]
    recognizer = Recognizer()
    whole, desk = (recognizer.embed(clips) for clips in ([*map(read_clip, paths)], cut))
    refused, of_legs = np.array([*map(is_refused, cut)]), np.isin(labels, given.legs)
    for name, rows in (("arms", ~of_legs), ("legs", of_legs)):
        print(f"{name}: {refused[rows].sum()} of {rows.sum()} refused as an example at a desk")
    print("\n| enrolled, asked | actions of | the same clip | other people |\n|" + " --- |" * 4)
    same, itself = labels[:, None] == labels, np.eye(len(labels), dtype=bool)
    for name, enrolled, asked in (
        ("whole, whole", whole, whole),
        ("whole, at a desk", whole, desk),
        ("at a desk, whole", desk, whole),
    ):
        actions = {str(row): enrolled[[row]] for row in range(len(enrolled))}
        accepted = recognizer.compare(asked, actions).confidence > TAU
        for limbs, rows in (("arms", ~of_legs), ("legs", of_legs)):
            cells = [accepted[pairs & rows[:, None]] for pairs in (itself, same & ~itself)]
            print(f"| {name} | {limbs} |", " | ".join(f"{c.sum()} of {c.size}" for c in cells), "|")


if __name__ == "__main__":
    main()
