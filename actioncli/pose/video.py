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
from actioncli.pose import ReadOptions
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
    options: ReadOptions | None = None,
    progress: Callable[[Progress], None] | None = None,
    rate: float | None = SAMPLING_RATE,
) -> Poses:
    """What is seen of one person in a video.

    Args:
        options: those of videos; poses of the same content and options are kept with `cache`, but
            for those of MeTRAbs.
        progress: called now and then while frames are looked at.
        rate: poses a second; None: every frame.

    Raises:
        ClipError: not a video, no frames, or no person in any.
        UsageError: options that make no sense.
        WeightsError: a pose network is missing or damaged.
    """
    options = options or ReadOptions()
    quality, person, end = options.quality or DEFAULT_QUALITY, options.person, options.end
    if quality not in LANDMARKS:
        raise UsageError(f"quality must be {' or '.join(LANDMARKS)}, not {quality!r}.")
    begin, stop = options.start or 0.0, math.inf if end is None else end
    if not 0 <= begin < stop:
        raise UsageError(f"--start ({begin:g} s) must be 0 or more and before --end ({stop:g} s).")
    if person is not None and person < 1:
        raise UsageError(f"--person counts from 1, {person} is nobody.")
    video, cached = VideoFile(path), options.cache and options.metrabs is None
    networks = [DETECTOR, LANDMARKS[quality]]
    if options.hands is not False:
        networks += [HAND_CROP, HAND_LANDMARKS]
    settings = {
        "networks": [shipped_checksum(network) for network in networks],
        # 2 and 2.0 are the same time.
        "start": float(begin),
        "end": None if end is None else float(end),
        "person": person,
        "rate": None if rate is None else float(rate),
        "hands": options.hands,
    }
    key = pose_cache.cache_key(path, settings) if cached else ""
    found = pose_cache.load(key) if cached else None
    if found is None:
        if options.metrabs is not None:
            from actioncli.pose.metrabs import load_model

            tracker = load_model(options.metrabs).tracker()
        else:
            looks = PersonDetector(), LandmarkEstimator(quality)
            tracker = Tracker(*looks, hands=hand_finder(options.hands))
        found = _estimate(video, tracker, begin, stop, person, progress, rate)
        if cached:
            pose_cache.keep(key, found)
    return found


def _estimate(
    video: VideoFile,
    tracker: Tracker,
    start: float,
    end: float,
    person: int | None,
    progress: Callable[[Progress], None] | None,
    rate: float | None,
) -> Poses:
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
    notes = [*tracker.notes, *([shortfall] if shortfall else [])]
    if not tracker.tracks:
        raise ClipError(
            f"{video.path}: no person was found in any of {len(times)} frames. The whole body "
            "should be in view and upright in the picture."
        )
    track, told = choose(tracker, person, str(video.path))
    poses = Poses.of(track.times, track.bodies, times, size)
    return replace(poses, names=tracker.names, notes=(*notes, *told))


def choose(tracker: Tracker, person: int | None, source: str) -> tuple[Track, list[str]]:
    """The person to follow, and what to tell about it.

    Raises:
        ClipError: there is no person of that number.
    """
    longest = max(len(track.times) for track in tracker.tracks)
    people = [track for track in tracker.tracks if len(track.times) >= _LEAST_TRACK * longest]
    people.sort(key=lambda track: float(track.bodies[0].points[:LANDMARK_COUNT, 0].mean()))
    if person is not None and person > len(people):
        raise ClipError(
            f"{source}: there is no person {person}; {len(people)} can be followed, "
            "counted from the left."
        )
    motion = [track.motion(tracker.limbs) for track in people]
    chosen = person - 1 if person is not None else int(np.argmax(motion))
    notes = []
    if len(people) > 1:
        why = "as asked" if person is not None else "who moves most; --person chooses"
        notes.append(f"followed person {chosen + 1} of {len(people)} from the left, {why}")
    notes += [f"at {time:.1f} s another body may be followed" for time in people[chosen].jumps]
    return people[chosen], notes
