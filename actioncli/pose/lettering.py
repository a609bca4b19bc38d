"""Text on images, in every script that OpenCV's own font has: no font of the system is needed."""

from __future__ import annotations

import re
import unicodedata
from collections.abc import Sequence

import cv2

from actioncli.pose.region import Image

# Hebrew and Arabic: OpenCV draws all letters from left to right.
_LEFTWARD = re.compile("[\u0590-\u08ff]+( +[\u0590-\u08ff]+)*")
# What breaks a line, or is no letter: a file's name may hold it.
_NO_LETTER = re.compile(r"[\x00-\x1f\x7f-\x9f\u2028\u2029\ud800-\udfff]")


def text_width(text: str, size: float) -> int:
    """Pixels from the beginning of a line to its end."""
    _, _, width, _ = cv2.getTextSize((0, 0), _drawable(text), (0, 0), _font(), round(size), 400)
    return int(width)


def write_text(
    image: Image, at: tuple[float, float], text: str, size: float, colour: Sequence[int]
) -> None:
    """Draw a line of text; a letter that the font lacks, as an emoji, becomes a question mark.

    Args:
        image: (H, W, 3), drawn on.
        at: where the baseline begins, pixels.
        size: of the letters, pixels.
        colour: three numbers, in the image's order.
    """
    place = (round(at[0]), round(at[1]))
    cv2.putText(image, _drawable(text), place, colour, _font(), round(size), 400)


def _font() -> cv2.FontFace:
    # An OpenCV that was built without this font takes its other one, which has Latin letters.
    return cv2.FontFace("uni")


def _drawable(text: str) -> str:
    text = _NO_LETTER.sub("?", unicodedata.normalize("NFC", text))
    return _LEFTWARD.sub(lambda run: run[0][::-1], text)
