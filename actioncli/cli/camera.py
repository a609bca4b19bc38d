"""Record a clip from a camera: count down, record, refuse what shows no body."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import typer

from actioncli.cli.command import Settings
from actioncli.errors import ClipError, UsageError
from actioncli.live.stream import PoseStream
from actioncli.pose.camera import open_source
from actioncli.pose.frames import Frame, VideoFile
from actioncli.pose.poses import LONGEST_GAP

if TYPE_CHECKING:
    from actioncli.clips.clip import Clip

COUNTDOWN = 3.0
# The person must be in view almost all the time.
_MOST_MISSED = 0.2


def record(
    settings: Settings, source: str, seconds: float, quality: str, hands: bool | None = None
) -> Clip:
    """Record one clip.

    Args:
        source: see `open_source`; no file.
        hands: look for hands; None: see `hands.hand_finder`.

    Raises:
        ClipError: no camera, it stops too soon, or the body is not in view.
        UsageError: a file, or an address of a kind that sends no pictures.
    """
    from actioncli.clips.clip import Clip

    camera = open_source(source, retry=0.0)
    if isinstance(camera, VideoFile):
        whole = "" if isinstance(camera.path, Path) else "download it, and "
        raise UsageError(f"{camera.path}: is a file: {whole}enrol it as one, without --camera.")
    name, frames = camera.name, 0
    try:
        poses = PoseStream(quality, seconds + LONGEST_GAP, hands)
        told, missed, start = "", 0, 0.0
        for frame in camera.frames():
            if not isinstance(frame, Frame):
                continue
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
        _show(settings, "", told)
    except ClipError as lost:
        raise ClipError(
            f"{lost} Of {seconds:g} s, {frames} frames were recorded; nothing is enrolled."
        ) from lost
    finally:
        camera.close()
    clip = poses.clip()
    if frames < 2 or clip is None or missed > _MOST_MISSED * frames:
        raise ClipError(
            f"{name}: the body was not in view in {missed} of {frames} frames; nothing is "
            "enrolled. Step back until head and hands, and feet if they take part, are in the "
            "picture, and see to light."
        )
    kept = min(round(seconds * clip.fps) + 1, len(clip))
    confidence = None if clip.confidence is None else np.array(clip.confidence[-kept:])
    notes = [*clip.notes, f"{frames} frames recorded, {camera.dropped} dropped"]
    return Clip(clip.joints[-kept:], clip.joint_names, clip.fps, confidence, name, notes)


def _show(settings: Settings, line: str, before: str) -> str:
    """Replace the line that stands on the terminal."""
    if not settings.quiet and sys.stderr.isatty():
        typer.echo("\r" + line + " " * max(len(before) - len(line), 0), err=True, nl=not line)
    return line
