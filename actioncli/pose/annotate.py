"""The video once more, with skeleton and verdict drawn on it."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path

import cv2
import numpy as np

from actioncli.clips.clip import FloatArray
from actioncli.clips.edit import resample
from actioncli.clips.skeleton import HAND_PARENTS
from actioncli.errors import ClipError
from actioncli.files import replacing
from actioncli.pose.frames import VideoFile
from actioncli.pose.landmarks import LANDMARK_COUNT
from actioncli.pose.lettering import text_width, write_text
from actioncli.pose.mp4 import mp4_writer
from actioncli.pose.poses import LONGEST_GAP, Poses
from actioncli.pose.region import Image
from actioncli.pose.sides import ALL_NAMES
from actioncli.pose.video import Progress

# Bones by name, with `?` for either side; left is drawn in one colour, right in another.
_MIDDLE = ("lsho rsho", "lhip rhip")
_SIDED = (
    "?sho ?elb", "?elb ?wri", "?wri ?index", "?sho ?hip", "?hip ?kne", "?kne ?ank", "?ank ?heel",
    "?heel ?foo", "?ank ?foo", "?ear ?eye", "nose ?eye",
)  # fmt: skip
# Blue, green, red, as OpenCV has them: they stay apart for the colour-blind too.
_COLOURS = {"l": (230, 159, 0), "r": (0, 94, 213), "m": (240, 240, 240)}
_LEAST_VISIBLE = 0.5
# Accepted and rejected: colour, and strokes from point to point in a square of side 1, y down.
_SIGNS = {
    "✓": ((155, 199, 53), [[(0, 0.55), (0.35, 0.9), (1, 0.1)]]),
    "✗": ((125, 133, 242), [[(0.1, 0.1), (0.9, 0.9)], [(0.1, 0.9), (0.9, 0.1)]]),
}
# Frames written for each that was looked at, of which there are up to 15 a second: a header may
# state times of years.
_MOST_PER_LOOK = 100


def bones() -> list[tuple[int, int, tuple[int, int, int]]]:
    """Columns of both ends and the colour of each bone; those of hands are the last."""
    named = [(bone, "m") for bone in _MIDDLE]
    fingers = [f"?hand{parent} ?hand{joint}" for joint, parent in enumerate(HAND_PARENTS, 1)]
    named += [(bone.replace("?", side), side) for bone in (*_SIDED, *fingers) for side in "lr"]
    found = []
    for bone, side in named:
        start, end = (ALL_NAMES.index(joint) for joint in bone.split())
        found.append((start, end, _COLOURS[side]))
    return found


def annotate_video(
    video: Path,
    output: Path,
    poses: Poses,
    lines: Callable[[float], Sequence[str]],
    progress: Callable[[Progress], None] | None = None,
) -> int:
    """Write an MP4 of the looked-at part of a video with the followed person's skeleton.

    Args:
        lines: text for the upper left corner at a time of the video; one that begins with ✓ or ✗
            has its colour.
        progress: called now and then while frames are drawn.

    Returns:
        How many frames were written.

    Raises:
        ClipError: the video cannot be read, or the file not be written.
    """
    source = VideoFile(video)
    start, end = float(poses.frames[0]), float(poses.frames[-1])
    if (end - start) * source.fps > _MOST_PER_LOOK * len(poses.frames):
        raise ClipError(
            f"{video}: has {len(poses.frames)} frames in {end - start:,.0f} s, and would have to "
            "be filled up to be drawn; narrow the time down with --start and --end."
        )
    count = 0
    with (
        replacing(output, suffix=".mp4", failure=ClipError) as part,
        mp4_writer(part, source.fps, ("mp4v",)) as write,
    ):
        for looked, frame in enumerate(source.frames(start, end), 1):
            if progress is not None:
                progress(Progress(looked, frame.time - start, end - start))
            image = frame.image.copy()
            _draw(image, poses, frame.time)
            _write(image, lines(frame.time))
            # The file's frame rate is constant: a frame stays until the next one's time.
            while count <= round((frame.time - start) * source.fps):
                write(image)
                count += 1
    return count


def _draw(image: Image, poses: Poses, time: float) -> None:
    """The skeleton at a time, between the neighbouring poses."""
    nearest = int(np.abs(poses.times - time).argmin())
    if abs(poses.times[nearest] - time) > LONGEST_GAP / 2 or len(poses.times) < 2:
        return
    now = np.array([time])
    points: FloatArray = resample(poses.points, poses.times, now)[0]
    # A hand that comes or goes has no place in between.
    seen = (poses.visibility >= _LEAST_VISIBLE).astype(np.float32)
    visible = resample(seen, poses.times, now)[0] > 1 - 1e-6
    width = max(2, round(min(image.shape[:2]) / 200))
    # Fixed point with 3 binary digits, so that the skeleton does not tremble.
    at = [(int(x), int(y)) for x, y in np.rint(points.clip(-1e4, 1e5) * 8)]
    for start, end, colour in bones():
        if end < len(visible) and visible[start] and visible[end]:
            wide = width if end < LANDMARK_COUNT else max(1, width // 3)
            cv2.line(image, at[start], at[end], (0, 0, 0), wide + 2, cv2.LINE_AA, 3)
            cv2.line(image, at[start], at[end], colour, wide, cv2.LINE_AA, 3)


def _write(image: Image, lines: Sequence[str]) -> None:
    if not lines:
        return
    scale = max(0.5, min(image.shape[:2]) / 700)
    step = round(34 * scale)
    texts = [line.lstrip("✓✗ ") for line in lines]
    indent = step if any(line[:1] in _SIGNS for line in lines) else 0
    # A long label in a narrow video becomes smaller, rather than be cut off.
    room = image.shape[1] - step - indent
    width = max(text_width(text, 0.9 * step) for text in texts)
    size = 0.9 * step * min(1, room / max(width, 1))
    right, bottom = min(width, room) + step + indent, step * len(texts) + step // 2
    cv2.rectangle(image, (0, 0), (right, bottom), (0, 0, 0), -1)
    for n, (line, text) in enumerate(zip(lines, texts, strict=True), 1):
        colour, strokes = _SIGNS.get(line[:1], ((255, 255, 255), []))
        corner, side = np.array([step / 2, step * (n - 0.65)]), 0.65 * step
        points = [np.rint(corner + side * np.array(stroke)).astype(np.int32) for stroke in strokes]
        cv2.polylines(image, points, False, colour, max(2, round(3 * scale)), cv2.LINE_AA)
        write_text(image, (step // 2 + indent, step * n), text, size, colour)
