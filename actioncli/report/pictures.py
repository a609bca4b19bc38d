"""Pictures of enrolled clips, as still strips or in motion, in files of four kinds."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from pathlib import Path

from actioncli.clips.clip import Clip
from actioncli.errors import UsageError
from actioncli.files import replacing
from actioncli.report.drawing import Drawing, Theme

SUFFIXES = (".png", ".svg", ".gif", ".mp4")

# Pictures a second of an animation; a GIF counts in hundredths of a second.
_RATE = 20.0
# Seconds of an animation: beyond, it would take minutes to write and most of the memory.
_LONGEST = 60.0


def check_picture(path: Path) -> None:
    """Find out whether a picture could be written, before any work.

    Raises:
        UsageError: the suffix is of no kind that is drawn, or the folder does not exist.
    """
    if path.suffix.lower() not in SUFFIXES:
        raise UsageError(f"{path}: drawings are written as {', '.join(SUFFIXES)}.")
    if not path.absolute().parent.is_dir():
        raise UsageError(f"{path}: its folder does not exist.")


def write_picture(
    path: Path,
    label: str,
    clips: Sequence[tuple[str, Clip]],
    theme: Theme | None = None,
    progress: Callable[[Iterable[Drawing], int], Iterable[Drawing]] | None = None,
) -> None:
    """Draw clips into a file of the kind that its suffix names.

    Args:
        path: .png and .svg show poses over time, .gif and .mp4 all clips in motion.
        label: heading of the picture.
        clips: one or more, each with its caption.
        theme: None is light, but an SVG then follows its reader.
        progress: passes on the drawings of an animation, so many, and shows how far it is.

    Raises:
        UsageError: as `check_picture`; a clip is too long for an animation; Pillow is missing; the
            file cannot be written.
    """
    from actioncli.report.drawing import svg
    from actioncli.report.figure import figure
    from actioncli.report.scenes import Example, moments, pictures, strip

    check_picture(path)
    kind = path.suffix.lower()
    longest = max(clip.duration for _, clip in clips)
    if kind in (".gif", ".mp4") and longest > _LONGEST:
        raise UsageError(
            f"{path}: shows at most {_LONGEST:.0f} seconds, and a clip lasts {longest:,.0f}; name "
            "a shorter one, or draw .png or .svg."
        )
    examples = [Example(figure(clip), caption) for caption, clip in clips]
    try:
        with replacing(path, suffix=kind) as part:
            if kind == ".svg":
                part.write_text(svg(strip(label, examples), theme), encoding="utf-8")
                return
            from actioncli.report.render import write_gif, write_mp4, write_png

            paper = theme or "light"
            if kind == ".png":
                write_png(part, strip(label, examples), paper)
                return
            drawings: Iterable[Drawing] = moments(label, examples, _RATE)
            if progress is not None:
                drawings = progress(drawings, pictures(examples, _RATE))
            write = write_gif if kind == ".gif" else write_mp4
            write(part, drawings, paper, _RATE)
    except OSError as error:
        raise UsageError(f"{path}: cannot be written: {error.strerror or error}.") from error
