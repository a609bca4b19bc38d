"""From a video file to a clip."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from actioncli.clips.active import action_in
from actioncli.clips.clip import Clip
from actioncli.errors import ClipError, UsageError
from actioncli.pose import cache as pose_cache
from actioncli.pose.detector import PersonDetector
from actioncli.pose.frames import VideoFile
from actioncli.pose.hands import hand_finder
from actioncli.pose.landmarks import LANDMARK_COUNT, LandmarkEstimator
from actioncli.pose.networks import (
    DETECTOR,
    HAND_CROP,
    HAND_LANDMARKS,
    LANDMARKS,
    shipped_checksum,
)
from actioncli.pose.poses import Poses
from actioncli.pose.tracker import Track, Tracker

DEFAULT_QUALITY = "fast"
# Poses a second that recognition needs; more frames are not looked at.
SAMPLING_RATE = 15.0
# A person must be in at least this share of the frames.
LEAST_PRESENT = 0.5
# Tracks shorter than this share of the longest do not compete for having moved most.
_LEAST_TRACK = 0.3


@dataclass(frozen=True, slots=True)
class Progress:
    """How far reading has come: frames looked at, and seconds of the video of how many."""

    frames: int
    seconds: float
    total: float


def read_video_clip(
    path: str | Path,
    start: float | None = None,
    end: float | None = None,
    quality: str = DEFAULT_QUALITY,
    person: int | None = None,
    cache: bool = True,
    progress: Callable[[Progress], None] | None = None,
    rate: float | None = SAMPLING_RATE,
    hands: bool | None = None,
) -> Clip:
    """Read the skeleton of one person from a video.

    Args:
        start: seconds at which the action begins; None: found from the motion, as is `end`.
        end: seconds at which it ends.
        quality: "fast" (BlazePose full) or "accurate" (BlazePose heavy).
        person: who is followed, 1 for the leftmost; None: whoever moves most.
        cache: use and keep poses of the same content and settings.
        progress: called now and then while frames are looked at.
        rate: poses a second; None: every frame.
        hands: look for hands; None: see `hands.hand_finder`.

    Returns:
        A clip in layout `holistic_75`, or `blazepose_33` without hands; confidence is visibility.
        Its notes tell the part that was used, gaps, and whatever is doubtful.

    Raises:
        ClipError: not a video, no frames, or no person in most of them.
        UsageError: options that make no sense.
        WeightsError: a pose network is missing or damaged.
    """
    path = Path(path)
    poses = read_poses(path, start, end, quality, person, cache, progress, rate, hands)
    return clip_of(poses, path, whole=start is not None or end is not None)


def clip_of(poses: Poses, path: Path, whole: bool) -> Clip:
    """The clip of what was seen, or (not `whole`) of the action in it; see `active.action_in`.

    Raises:
        ClipError: no person in most of the frames.
    """
    present = len(poses.times) / max(len(poses.frames), 1)
    if present < LEAST_PRESENT:
        raise ClipError(
            f"{path}: a person was found in {len(poses.times)} of {len(poses.frames)} frames; "
            "most must show one, whole and upright in the picture. Narrow the time down with "
            "--start and --end, or try --quality accurate."
        )
    clip = poses.to_clip(str(path))
    if whole:
        return clip
    first, last, repetitions = action_in(clip)
    if first <= 0 and last >= clip.duration:
        return clip
    offset = float(poses.times[0])
    first, last = first + offset, last + offset
    used = f"used {first:.1f} s to {last:.1f} s"
    if repetitions > 1:
        used += f", one of about {repetitions} repetitions"
    return poses.between(first - 1e-6, last + 1e-6).to_clip(str(path), [used])


def read_poses(
    path: Path,
    start: float | None = None,
    end: float | None = None,
    quality: str = DEFAULT_QUALITY,
    person: int | None = None,
    cache: bool = True,
    progress: Callable[[Progress], None] | None = None,
    rate: float | None = SAMPLING_RATE,
    hands: bool | None = None,
) -> Poses:
    """What `read_video_clip` makes its clip of; arguments and errors are the same."""
    if quality not in LANDMARKS:
        raise UsageError(f"quality must be {' or '.join(LANDMARKS)}, not {quality!r}.")
    begin, stop = start or 0.0, math.inf if end is None else end
    if not 0 <= begin < stop:
        raise UsageError(f"--start ({begin:g} s) must be 0 or more and before --end ({stop:g} s).")
    if person is not None and person < 1:
        raise UsageError(f"--person counts from 1, {person} is nobody.")
    video = VideoFile(path)
    networks = [DETECTOR, LANDMARKS[quality]]
    if hands is not False:
        networks += [HAND_CROP, HAND_LANDMARKS]
    settings = {
        "networks": [shipped_checksum(network) for network in networks],
        # 2 and 2.0 are the same time.
        "start": float(begin),
        "end": None if end is None else float(end),
        "person": person,
        "rate": None if rate is None else float(rate),
        "hands": hands,
    }
    key = pose_cache.cache_key(path, settings) if cache else ""
    found = pose_cache.load(key) if cache else None
    if found is None:
        found = _estimate(video, begin, stop, quality, person, progress, rate, hands)
        if cache:
            pose_cache.keep(key, found)
    return found


def _estimate(
    video: VideoFile,
    start: float,
    end: float,
    quality: str,
    person: int | None,
    progress: Callable[[Progress], None] | None,
    rate: float | None,
    hands: bool | None,
) -> Poses:
    tracker = Tracker(PersonDetector(), LandmarkEstimator(quality), hands=hand_finder(hands))
    total = min(end, video.duration) - start
    times, size = [], (0, 0)
    for frame in video.frames(start, end, rate):
        tracker(frame.image, frame.time)
        times.append(frame.time)
        size = frame.image.shape[1], frame.image.shape[0]
        if progress is not None:
            progress(Progress(len(times), frame.time - start, max(total, frame.time - start)))
    if not times:
        where = f" from {start:g} s on" if start and video.decoded else ""
        raise ClipError(f"{video.path}: no frame could be decoded{where}.")
    if len(times) == 1:
        raise ClipError(
            f"{video.path}: one frame; an action needs a moving sequence, not a picture."
        )
    shortfall = video.shortfall()
    notes = [shortfall] if shortfall else []
    if not tracker.tracks:
        raise ClipError(
            f"{video.path}: no person was found in any of {len(times)} frames. The whole body "
            "should be in view and upright in the picture."
        )
    track, told = choose(tracker.tracks, person, str(video.path))
    poses = Poses.of(track.times, track.bodies, times, size)
    return replace(poses, notes=(*notes, *told))


def choose(tracks: list[Track], person: int | None, source: str) -> tuple[Track, list[str]]:
    """The person to follow, and what to tell about it.

    Raises:
        ClipError: there is no person of that number.
    """
    longest = max(len(track.times) for track in tracks)
    people = [track for track in tracks if len(track.times) >= _LEAST_TRACK * longest]
    people.sort(key=lambda track: float(track.bodies[0].points[:LANDMARK_COUNT, 0].mean()))
    if person is not None and person > len(people):
        raise ClipError(
            f"{source}: there is no person {person}; {len(people)} can be followed, "
            "counted from the left."
        )
    motion = [track.motion() for track in people]
    chosen = person - 1 if person is not None else int(np.argmax(motion))
    notes = []
    if len(people) > 1:
        why = "as asked" if person is not None else "who moves most; --person chooses"
        notes.append(f"followed person {chosen + 1} of {len(people)} from the left, {why}")
    notes += [f"at {time:.1f} s another body may be followed" for time in people[chosen].jumps]
    return people[chosen], notes
