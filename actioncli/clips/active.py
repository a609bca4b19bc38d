"""The part of a clip in which the person does something, and one repetition of it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from actioncli.clips.clip import Clip, FloatArray
from actioncli.clips.edit import cut
from actioncli.clips.skeleton import DEFAULT_JOINTS, centred, select_joints, torso_length
from actioncli.errors import ClipError

# Seconds over which speed is averaged; seconds kept before and after the motion.
_SMOOTHING = 0.3
_MARGIN = 0.15
# Slower than this share of the clip's fast moments (or than this many torso lengths a second)
# counts as standing still.
_SHARE_OF_FAST = 0.2
_STILL = 0.15
# Motion repeats itself if it agrees this well with itself a period later, and a period is not
# shorter than this; a clip of fewer periods is one performance.
_LEAST_AGREEMENT = 0.5
_SHORTEST_PERIOD = 0.5
_LEAST_PERIODS = 1.6
# A longer rest separates two performances; a shorter part is no action.
_REST = 1.5
# Seconds from which a repetition is an action by itself; so many quicker ones are too many for one.
_CYCLE, _MANY = 2.0, 5
_SHORTEST = 0.5


def active_part(clip: Clip, rest: float = _REST) -> tuple[float, float]:
    """When the person moves, in seconds from the clip's beginning.

    The limbs' speed, relative to the pelvis and in torso lengths, decides. Of several parts with
    longer rests in between, the one with most motion is taken. Where nobody was seen for long
    (confidence 0 throughout), no part goes across. A clip without motion is active as a whole.

    Args:
        rest: seconds of standing still that separate two parts.

    Returns:
        Start and end; (0, duration) if there is nothing to leave out.
    """
    speed = limb_speed(clip)
    width = min(max(1, round(_SMOOTHING * clip.fps)), len(clip))
    speed = np.convolve(speed, np.ones(width) / width, mode="same").astype(np.float32)
    seen: NDArray[np.bool_] = np.ones(len(clip), np.bool_)
    if clip.confidence is not None and clip.confidence.any():
        seen = np.any(clip.confidence, axis=1)
    fast = float(np.percentile(speed[seen], 95))
    moving = seen & (speed > max(_SHARE_OF_FAST * fast, _STILL))
    best, most = (0.0, clip.duration), 0.0
    for first, last in _stretches(moving, seen, round(rest * clip.fps)):
        motion = float(speed[first : last + 1].sum())
        if last - first >= _SHORTEST * clip.fps and motion > most:
            margin = round(_MARGIN * clip.fps)
            while margin and not seen[max(first - margin, 0) : last + margin + 1].all():
                margin -= 1
            start = max(first - margin, 0) / clip.fps
            best, most = (start, min((last + margin) / clip.fps, clip.duration)), motion
    return best


def repetition(clip: Clip) -> tuple[float, float] | None:
    """One repetition of a motion that repeats itself, in seconds from the clip's beginning.

    Exercises are filmed several times over, and one repetition is what others can be compared
    with. The period is the first lag at which the autocorrelation of the posture peaks. All
    repetitions would do; the one is taken that begins most at rest: tall, with the hands low.
    So two people's repetitions begin in the same phase.

    Returns:
        Start and end, or None if the motion does not repeat.
    """
    joints = _about_pelvis(clip)
    posture = joints.reshape(len(joints), -1)
    posture = posture - posture.mean(axis=0)
    power = float((posture**2).sum(axis=1).mean())
    longest = int(len(clip) / _LEAST_PERIODS)
    if power < 1e-8 or longest < 3:
        return None
    agreement = _autocorrelation(posture, longest) / power
    peaks = [
        lag
        for lag in range(max(2, round(_SHORTEST_PERIOD * clip.fps)), longest)
        if agreement[lag - 1] <= agreement[lag] >= agreement[lag + 1]
        and agreement[lag] >= _LEAST_AGREEMENT
    ]
    if not peaks:
        return None
    period = peaks[0]
    column = DEFAULT_JOINTS.index
    height = joints[:, :, 1]
    ankles = height[:, [column("lank"), column("rank")]].mean(axis=1)
    hands = height[:, [column("lwri"), column("rwri")]].mean(axis=1)
    rest = height[:, column("head")] - ankles - hands
    start = int(rest[: len(clip) - period].argmax())
    return start / clip.fps, (start + period) / clip.fps


def _autocorrelation(signal: FloatArray, longest: int) -> NDArray[np.float64]:
    """Mean product of a signal (T, D) with itself 0, 1, ... `longest` frames later.

    By Fourier transform (Wiener-Khinchin): an hour has ten thousands of lags.
    """
    count = len(signal) + longest  # zeros enough that no end meets the beginning
    spectrum = np.fft.rfft(signal.astype(np.float64), count, axis=0)
    products = np.fft.irfft((np.abs(spectrum) ** 2).sum(axis=1), count)[: longest + 1]
    return np.asarray(products / (len(signal) - np.arange(longest + 1)))


def limb_speed(clip: Clip) -> FloatArray:
    """(T,) mean speed of the default joints relative to the pelvis, in torso lengths a second."""
    joints = _about_pelvis(clip)
    torso = float(torso_length(joints, DEFAULT_JOINTS))
    velocity = np.gradient(joints, axis=0) * (clip.fps / torso)
    return np.asarray(np.linalg.norm(velocity, axis=2).mean(axis=1), np.float32)


def _about_pelvis(clip: Clip) -> FloatArray:
    """(T, 15, 3) the default joints, metres from the pelvis."""
    joints = select_joints(clip.filled(), clip.joint_names, DEFAULT_JOINTS, clip.source)
    return centred(joints, DEFAULT_JOINTS)


def _stretches(
    moving: NDArray[np.bool_],
    seen: NDArray[np.bool_],
    rest: int,
) -> list[tuple[int, int]]:
    """First and last frames of the parts with motion; short rests are part of them."""
    found: list[tuple[int, int]] = []
    for frame in np.flatnonzero(moving).tolist():
        if found and frame - found[-1][1] <= rest and seen[found[-1][1] : frame].all():
            found[-1] = (found[-1][0], frame)
        else:
            found.append((frame, frame))
    return found


def action_in(clip: Clip) -> tuple[float, float, int]:
    """The active part of a clip, or one repetition where the motion in it repeats.

    Returns:
        Start and end, seconds from the clip's beginning, and how many repetitions there are
        about; 1 if the motion does not repeat.
    """
    start, end = active_part(clip)
    active = cut(clip, start, end)
    one = repetition(active)
    if one is None:
        return start, end, 1
    count = round(active.duration / (one[1] - one[0]))
    return start + one[0], start + one[1], max(count, 2)


def repetition_notes(clip: Clip) -> tuple[str, ...]:
    """What to tell about an example that shows more than one repetition: a sentence, or none."""
    try:
        start, end, repetitions = action_in(clip)
    except ClipError:
        return ()
    if repetitions == 1 or (end - start < _CYCLE and repetitions < _MANY):
        return ()
    text = f"shows about {repetitions} repetitions of {end - start:.1f} s as one action"
    return (f"{text}; an example of one, or of a few quick ones, is recognised surer",)


def one_repetition(clip: Clip) -> Clip:
    """One repetition of a motion that repeats itself, with a note; else the whole clip.

    Quick cycles, as of walking or jumping jacks, stay together: people show several as one action.
    """
    try:
        start, end, repetitions = action_in(clip)
    except ClipError:  # a body without the joints that this is seen by
        return clip
    if repetitions == 1 or end - start < _CYCLE:
        return clip
    note = f"used {start:.1f} s to {end:.1f} s, one of about {repetitions} repetitions"
    one = cut(clip, start, end)
    return replace(one, notes=(*one.notes, note))
