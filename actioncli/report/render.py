"""Drawings as pixels: strokes and MP4 through OpenCV, text, PNG and GIF through Pillow."""

from __future__ import annotations

from collections.abc import Iterable
from math import hypot
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from actioncli.errors import UsageError
from actioncli.pose.mp4 import mp4_writer
from actioncli.report.drawing import PALETTES, Drawing, Line, Oval, Text, Theme

Pixels = NDArray[np.uint8]
Colour = tuple[int, int, int]

_SHARPNESS = 2  # pixels per unit of a drawing, for screens with fine pixels
_MOTION_SHARPNESS = 1.5
_SUBPIXEL_BITS = 4


def paint(drawing: Drawing, theme: Theme, sharpness: float = _SHARPNESS) -> Pixels:
    """Pixels of a drawing, (height, width, 3) RGB, `sharpness` per unit of it.

    Raises:
        UsageError: Pillow is not installed.
    """
    colours = {role: _rgb(colour) for role, colour in PALETTES[theme].items()}
    paper = colours["paper"]
    size = (round(drawing.height * sharpness), round(drawing.width * sharpness), 3)
    pixels: Pixels = np.full(size, paper, np.uint8)
    for shape in drawing.shapes:
        if not isinstance(shape, Text):
            _stroke(pixels, shape, colours[shape.role], paper, sharpness)
    image, draw, fonts = _pillow()
    written = image.fromarray(pixels)
    canvas = draw.Draw(written)
    for shape in drawing.shapes:
        if isinstance(shape, Text):
            anchor = {"start": "ls", "middle": "ms", "end": "rs"}[shape.anchor]
            at = tuple(sharpness * each for each in shape.at)
            font = fonts.load_default(shape.size * sharpness)
            canvas.text(at, shape.text, fill=colours[shape.role], font=font, anchor=anchor)
    return np.asarray(written)


def write_png(path: Path, drawing: Drawing, theme: Theme) -> None:
    """Write a picture.

    Raises:
        UsageError: Pillow is not installed.
        OSError: the file cannot be written.
    """
    image, _, _ = _pillow()
    image.fromarray(paint(drawing, theme)).save(path, format="PNG", optimize=True)


def write_gif(path: Path, drawings: Iterable[Drawing], theme: Theme, rate: float) -> None:
    """Write an animation that repeats, `rate` pictures a second.

    Raises:
        UsageError, OSError: as `write_png`.
    """
    image, _, _ = _pillow()
    # Few colours and no dithering: drawings are flat, and the file stays small.
    plain = {"colors": 64, "dither": image.Dither.NONE}
    pictures = (image.fromarray(paint(drawing, theme, _MOTION_SHARPNESS)) for drawing in drawings)
    first = next(pictures).quantize(**plain)
    others = (picture.quantize(palette=first, **plain) for picture in pictures)
    first.save(
        path,
        format="GIF",
        save_all=True,
        append_images=others,
        duration=round(1000 / rate),
        loop=0,
    )


def write_mp4(path: Path, drawings: Iterable[Drawing], theme: Theme, rate: float) -> None:
    """Write a video, `rate` pictures a second.

    Raises:
        UsageError, OSError: as `write_png`.
    """
    # VP9 plays in browsers; the older codec is there where VP9 is not.
    with mp4_writer(path, rate, ("vp09", "mp4v")) as write:
        for drawing in drawings:
            pixels = paint(drawing, theme, _MOTION_SHARPNESS)
            # Encoders take even sizes only.
            height, width = pixels.shape[0] // 2 * 2, pixels.shape[1] // 2 * 2
            write(np.ascontiguousarray(pixels[:height, :width, ::-1]))


def _pillow() -> tuple[Any, Any, Any]:
    try:
        from PIL import Image, ImageDraw, ImageFont
    except ImportError as error:
        raise UsageError(
            "PNG, GIF and MP4 need Pillow: pip install 'actioncli[report]'; .svg needs nothing."
        ) from error
    return Image, ImageDraw, ImageFont


def _stroke(pixels: Pixels, shape: Line | Oval, colour: Colour, paper: Colour, zoom: float) -> None:
    if isinstance(shape, Line):
        width = shape.width * zoom
        (x1, y1), (x2, y2) = ((zoom * x, zoom * y) for x, y in (shape.start, shape.end))
        if not shape.dashed:
            ends = _fixed(x1, y1), _fixed(x2, y2)
            cv2.line(pixels, *ends, colour, round(width), cv2.LINE_AA, _SUBPIXEL_BITS)
            return
        # Dots, as the SVG has them.
        dots = max(int(hypot(x2 - x1, y2 - y1) / (2.25 * width)), 1)
        for share in np.linspace(0, 1, dots + 1):
            x, y = x1 + share * (x2 - x1), y1 + share * (y2 - y1)
            _ellipse(pixels, x, y, width / 2, width / 2, colour)
        return
    x, y = zoom * shape.centre[0], zoom * shape.centre[1]
    rx, ry = zoom * shape.radius[0], zoom * shape.radius[1]
    if shape.width is None:
        _ellipse(pixels, x, y, rx, ry, colour)
    else:
        # A stroke lies half within the outline and half outside of it.
        half = shape.width * zoom / 2
        _ellipse(pixels, x, y, rx + half, ry + half, colour)
        _ellipse(pixels, x, y, max(rx - half, 0), max(ry - half, 0), paper)


def _ellipse(pixels: Pixels, x: float, y: float, rx: float, ry: float, colour: Colour) -> None:
    centre, radii = _fixed(x, y), _fixed(rx, ry)
    cv2.ellipse(pixels, centre, radii, 0, 0, 360, colour, -1, cv2.LINE_AA, _SUBPIXEL_BITS)


def _fixed(x: float, y: float) -> tuple[int, int]:
    return round(float(x) * 2**_SUBPIXEL_BITS), round(float(y) * 2**_SUBPIXEL_BITS)


def _rgb(colour: str) -> Colour:
    red, green, blue = bytes.fromhex(colour[1:])
    return red, green, blue
