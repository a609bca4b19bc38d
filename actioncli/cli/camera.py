"""Record a clip from a camera: count down, record, refuse what shows no body."""

from __future__ import annotations

import sys
from typing import TYPE_CHECKING

import numpy as np
import typer

from actioncli.cli.command import Settings
from actioncli.errors import ClipError
from actioncli.live.stream import PoseStream
from actioncli.pose.camera import LiveSource
from actioncli.pose.poses import LONGEST_GAP

if TYPE_CHECKING:
    from actioncli.clips.clip import Clip

COUNTDOWN = 3.0
# The person must be in view almost all the time.
_MOST_MISSED = 0.2


def record(
    settings: Settings, source: int | str, seconds: float, quality: str, hands: bool | None = None
) -> Clip:
    """Record one clip.

    Args:
        source: number of the camera, or an address.
        hands: look for hands; None: see `hands.hand_finder`.

    Raises:
        ClipError: no camera, it stops too soon, or the body is not in view.
    """
    from actioncli.clips.clip import Clip

    camera = LiveSource(source)
    try:
        poses = PoseStream(quality, seconds + LONGEST_GAP, hands)
        told, frames, missed, start = "", 0, 0, 0.0
        for frame in camera.frames():
            start = start or frame.time + COUNTDOWN
            if frames and frame.time > start + seconds:
                break
            poses.add(frame)
            seen = poses.body is not None and poses.body.in_view
            if frame.time >= start:
                frames += 1
                missed += not seen
            line = (
                f"recording {frame.time - start:3.1f} of {seconds:g} s, {frames} frames"
                if frame.time >= start
                else f"recording in {start - frame.time:.0f} s"
            )
            told = _show(settings, f"{line}, body {'in view' if seen else 'NOT in view'}", told)
        else:
            raise ClipError(
                f"camera {source}: it stopped after {frames} frames, before {seconds:g} s were "
                "recorded; nothing is enrolled."
            )
        _show(settings, "", told)
    finally:
        camera.close()
    clip = poses.clip()
    if frames < 2 or clip is None or missed > _MOST_MISSED * frames:
        raise ClipError(
            f"camera {source}: the body was not in view in {missed} of {frames} frames; nothing is "
            "enrolled. Step back until head and hands, and feet if they take part, are in the "
            "picture, and see to light."
        )
    kept = min(round(seconds * clip.fps) + 1, len(clip))
    confidence = None if clip.confidence is None else np.array(clip.confidence[-kept:])
    notes = [*clip.notes, f"{frames} frames recorded, {camera.dropped} dropped"]
    return Clip(
        clip.joints[-kept:], clip.joint_names, clip.fps, confidence, f"camera {source}", notes
    )


def _show(settings: Settings, line: str, before: str) -> str:
    """Replace the line that stands on the terminal."""
    if not settings.quiet and sys.stderr.isatty():
        typer.echo("\r" + line + " " * max(len(before) - len(line), 0), err=True, nl=not line)
    return line
