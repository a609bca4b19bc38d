"""Pictures of enrolled clips, as still strips or in motion, in files of four kinds."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from math import hypot
from pathlib import Path
from typing import Any

import numpy as np

from actioncli.clips.clip import Clip
from actioncli.clips.drawing import PALETTES, Drawing, Line, Oval, Text, Theme, svg
from actioncli.errors import UsageError
from actioncli.files import replacing
from actioncli.pose.lettering import text_width, write_text
from actioncli.pose.mp4 import mp4_writer
from actioncli.report.figure import figure
from actioncli.report.scenes import Example, moments, pictures, strip

SUFFIXES = (".png", ".svg", ".gif", ".mp4")

# Pictures a second of an animation; a GIF counts in hundredths of a second.
_RATE = 20.0
# Seconds of an animation: beyond, it would take minutes to write and most of the memory.
_LONGEST = 60.0
# Pixels per unit of a drawing: of stills, for screens with fine pixels, and in motion.
_STILL, _MOTION = 2.0, 1.5
# Pixels are drawn so many times finer, and averaged: Pillow's edges are jagged.
_FINER = 3


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
    check_picture(path)
    kind = path.suffix.lower()
    longest = max(clip.duration for _, clip in clips)
    if kind in (".gif", ".mp4") and longest > _LONGEST:
        raise UsageError(
            f"{path}: shows at most {_LONGEST:.0f} seconds, and a clip lasts {longest:,.0f}; name "
            "a shorter one, or draw .png or .svg."
        )
    examples = [Example(figure(clip), caption) for caption, clip in clips]
    paper = theme or "light"
    with replacing(path, suffix=kind, failure=UsageError) as part:
        if kind == ".svg":
            part.write_text(svg(strip(label, examples), theme), encoding="utf-8")
        elif kind == ".png":
            picture = _painted(strip(label, examples), paper, _STILL)
            picture.save(part, format="PNG", optimize=True)
        else:
            drawings: Iterable[Drawing] = moments(label, examples, _RATE)
            if progress is not None:
                drawings = progress(drawings, pictures(examples, _RATE))
            painted = (_painted(drawing, paper, _MOTION) for drawing in drawings)
            (_write_gif if kind == ".gif" else _write_mp4)(part, painted)


def _write_gif(path: Path, images: Iterable[Any]) -> None:
    """An animation that repeats."""
    # Few colours and no dithering: drawings are flat, and the file stays small.
    plain = {"colors": 64, "dither": 0}
    images = iter(images)
    first = next(images).quantize(**plain)
    others = (image.quantize(palette=first, **plain) for image in images)
    every = round(1000 / _RATE)
    first.save(path, "GIF", save_all=True, append_images=others, duration=every, loop=0)


def _write_mp4(path: Path, images: Iterable[Any]) -> None:
    # VP9 plays in browsers; the older codec is there where VP9 is not.
    with mp4_writer(path, _RATE, ("vp09", "mp4v")) as write:
        for image in images:
            # Encoders take even sizes only.
            even = image.crop((0, 0, image.width // 2 * 2, image.height // 2 * 2))
            write(np.ascontiguousarray(np.asarray(even)[..., ::-1]))


def _painted(drawing: Drawing, theme: Theme, sharpness: float) -> Any:
    """A drawing as an image of Pillow's, with `sharpness` pixels per unit.

    Raises:
        UsageError: Pillow is not installed.
    """
    try:
        from PIL import Image, ImageDraw
    except ImportError as error:
        raise UsageError(
            "PNG, GIF and MP4 need Pillow: pip install 'actioncli[report]'; .svg needs nothing."
        ) from error
    colours = PALETTES[theme]
    zoom = sharpness * _FINER
    size = (round(drawing.width * zoom), round(drawing.height * zoom))
    fine = Image.new("RGB", size, colours["paper"])
    pen = ImageDraw.Draw(fine)

    def oval(x: float, y: float, rx: float, ry: float, colour: str) -> None:
        box = (x - rx, y - ry, x + rx, y + ry)
        pen.ellipse([zoom * each for each in box], fill=colour)

    for shape in drawing.shapes:
        if isinstance(shape, Line):
            (x1, y1), (x2, y2) = shape.start, shape.end
            # Round ends; a line of dots has as many as the SVG's.
            dots = int(hypot(x2 - x1, y2 - y1) / (2.25 * shape.width)) if shape.dashed else 1
            for share in np.linspace(0, 1, max(dots, 1) + 1):
                x, y, radius = x1 + share * (x2 - x1), y1 + share * (y2 - y1), shape.width / 2
                oval(x, y, radius, radius, colours[shape.role])
            if not shape.dashed:
                ends = [zoom * each for each in (x1, y1, x2, y2)]
                pen.line(ends, fill=colours[shape.role], width=round(zoom * shape.width))
        elif isinstance(shape, Oval):
            # A stroke lies half within the outline and half outside of it.
            half = (shape.width or 0) / 2
            (x, y), (rx, ry) = shape.centre, shape.radius
            oval(x, y, rx + half, ry + half, colours[shape.role])
            if shape.width is not None:
                oval(x, y, max(rx - half, 0), max(ry - half, 0), colours["paper"])
    image = np.array(fine.reduce(_FINER))
    for shape in drawing.shapes:
        if isinstance(shape, Text):
            large = shape.size * sharpness
            before = {"start": 0, "middle": 0.5, "end": 1}[shape.anchor]
            x = sharpness * shape.at[0] - before * text_width(shape.text, large)
            ink = bytes.fromhex(colours[shape.role][1:])
            write_text(image, (x, sharpness * shape.at[1]), shape.text, large, tuple(ink))
    return Image.fromarray(image)
