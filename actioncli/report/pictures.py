"""Pictures of enrolled clips, as still strips or in motion, in files of four kinds."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from actioncli.clips.clip import Clip
from actioncli.errors import UsageError
from actioncli.report.drawing import Theme

SUFFIXES = (".png", ".svg", ".gif", ".mp4")

# Pictures a second of an animation; a GIF counts in hundredths of a second.
_RATE = 20.0


def check_picture(path: Path) -> None:
    """Find out whether a picture could be written, before any work.

    Raises:
        UsageError: the suffix is of no known kind, or the folder does not exist.
    """
    if path.suffix.lower() not in SUFFIXES:
        raise UsageError(f"{path}: drawings are written as {', '.join(SUFFIXES)}.")
    if not path.absolute().parent.is_dir():
        raise UsageError(f"{path}: its folder does not exist.")


def write_picture(
    path: Path, label: str, clips: Sequence[tuple[str, Clip]], theme: Theme | None = None
) -> None:
    """Draw clips into a file of the kind that its suffix names.

    Args:
        path: .png and .svg show poses over time, .gif and .mp4 all clips in motion.
        label: heading of the picture.
        clips: one or more, each with its caption.
        theme: None is light, but an SVG then follows its reader.

    Raises:
        UsageError: as `check_picture`; Pillow is missing; the file cannot be written.
    """
    from actioncli.report.drawing import svg
    from actioncli.report.figure import figure
    from actioncli.report.scenes import Example, moments, strip

    check_picture(path)
    examples = [Example(figure(clip), caption) for caption, clip in clips]
    try:
        if path.suffix.lower() == ".svg":
            path.write_text(svg(strip(label, examples), theme), encoding="utf-8")
            return
        from actioncli.report.raster import write_gif, write_mp4, write_png

        if path.suffix.lower() == ".png":
            write_png(path, strip(label, examples), theme or "light")
        else:
            write = write_gif if path.suffix.lower() == ".gif" else write_mp4
            write(path, moments(label, examples, _RATE), theme or "light", _RATE)
    except OSError as error:
        raise UsageError(f"{path}: cannot be written: {error.strerror or error}.") from error
