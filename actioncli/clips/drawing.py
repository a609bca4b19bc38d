"""Drawings as lists of shapes, and as SVG: what is drawn does not know what it is drawn with.

And a clip as a small picture for notebooks: the skeleton at five moments side by side."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from html import escape
from typing import Literal

import numpy as np

from actioncli.clips.skeleton import (
    BONES,
    DEFAULT_JOINTS,
    FloatArray,
    bone_columns,
    centred,
    default_columns,
    select_joints,
    side_of,
    turn_to_front,
)

Role = Literal["paper", "ink", "muted", "ground", "left", "right", "middle"]
Anchor = Literal["start", "middle", "end"]
Theme = Literal["light", "dark"]

# Left and right after Okabe and Ito's colours, which differ for every kind of colour vision and
# in grey; lighter ones on dark paper.
PALETTES: Mapping[Theme, Mapping[Role, str]] = {
    "light": {
        "paper": "#ffffff",
        "ink": "#1c2024",
        "muted": "#5f6872",
        "ground": "#dfe3e7",
        "left": "#0072b2",
        "right": "#d55e00",
        "middle": "#3f464d",
    },
    "dark": {
        "paper": "#14171a",
        "ink": "#e8eaed",
        "muted": "#a0a8b0",
        "ground": "#31373d",
        "left": "#56b4e9",
        "right": "#f29544",
        "middle": "#c8ced4",
    },
}

# Pixels of a picture for notebooks, and the part of it above the caption.
_WIDTH, _HEIGHT, _GROUND = 320, 160, 138
_MOMENTS = 5


@dataclass(frozen=True, slots=True)
class Line:
    """A stroke with round ends; `dashed` says that its place is a guess."""

    start: tuple[float, float]
    end: tuple[float, float]
    role: Role
    width: float
    dashed: bool = False


@dataclass(frozen=True, slots=True)
class Oval:
    """An ellipse: filled, or an outline of `width` on paper."""

    centre: tuple[float, float]
    radius: tuple[float, float]
    role: Role
    width: float | None = None


@dataclass(frozen=True, slots=True)
class Text:
    """One line of text on its baseline."""

    at: tuple[float, float]
    text: str
    size: float
    role: Role = "ink"
    anchor: Anchor = "start"


Shape = Line | Oval | Text


@dataclass(frozen=True, slots=True)
class Drawing:
    """Shapes in pixels, y down, in the order of painting, and what the picture shows."""

    width: float
    height: float
    shapes: Sequence[Shape]
    title: str


def svg(drawing: Drawing, theme: Theme | None = None) -> str:
    """The drawing as an SVG document; without a theme it follows the reader's light or dark."""
    style = _variables(PALETTES[theme or "light"])
    if theme is None:
        dark = _variables(PALETTES["dark"])
        style += f"@media (prefers-color-scheme:dark){{{dark}}}"
    size = f"{drawing.width:g} {drawing.height:g}"
    title = escape(drawing.title)
    body = "\n".join(map(_element, drawing.shapes))
    return (
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {size}" width="{drawing.width:g}" '
        f'height="{drawing.height:g}" role="img" aria-label="{title}" '
        f'font-family="system-ui,sans-serif" stroke-linecap="round">\n<title>{title}</title>\n'
        f"<style>{style}</style>\n"
        f'<rect width="100%" height="100%" fill="var(--paper)"/>\n{body}\n</svg>\n'
    )


def _variables(palette: Mapping[Role, str]) -> str:
    return "svg{" + "".join(f"--{role}:{colour};" for role, colour in palette.items()) + "}"


def _element(shape: Shape) -> str:
    colour = f"var(--{shape.role})"
    if isinstance(shape, Line):
        (x1, y1), (x2, y2) = shape.start, shape.end
        dash = f' stroke-dasharray="{shape.width / 4:.1f} {2 * shape.width:.1f}"'
        return (
            f'<line x1="{x1:.1f}" y1="{y1:.1f}" x2="{x2:.1f}" y2="{y2:.1f}" stroke="{colour}" '
            f'stroke-width="{shape.width:.1f}"{dash if shape.dashed else ""}/>'
        )
    if isinstance(shape, Oval):
        (x, y), (rx, ry) = shape.centre, shape.radius
        paint = f'fill="{colour}"'
        if shape.width is not None:
            paint = f'fill="var(--paper)" stroke="{colour}" stroke-width="{shape.width:.1f}"'
        return f'<ellipse cx="{x:.1f}" cy="{y:.1f}" rx="{rx:.1f}" ry="{ry:.1f}" {paint}/>'
    x, y = shape.at
    return (
        f'<text x="{x:.1f}" y="{y:.1f}" font-size="{shape.size:g}" text-anchor="{shape.anchor}" '
        f'fill="{colour}">{escape(shape.text)}</text>'
    )


def strip(joints: FloatArray, names: Sequence[str], caption: str) -> str | None:
    """An SVG of 320 x 160 pixels with the body at up to five moments, equidistant in time.

    Whichever way the person faced, the body faces the viewer, turned a little to the side.

    Args:
        joints: (T, J, 3) as in `Clip`.
        names: J joint names.
        caption: one line below the picture.

    Returns:
        The SVG, or None where the layout lacks one of the default joints.
    """
    if default_columns(names).keys() < set(DEFAULT_JOINTS):
        return None
    body = centred(select_joints(joints, names, DEFAULT_JOINTS), DEFAULT_JOINTS)
    body = turn_to_front(body, DEFAULT_JOINTS)
    body = body[np.unique(np.linspace(0, len(body) - 1, _MOMENTS).round().astype(int))]
    # With y up and z away from the viewer, x points to the left of the picture.
    across = -body[..., 0] * np.cos(0.35) - body[..., 2] * np.sin(0.35)
    height = body[..., 1]
    pane = _WIDTH / len(body)
    tall, wide = max(float(np.ptp(height)), 1e-6), max(2 * float(np.abs(across).max()), 1e-6)
    scale = min((_GROUND - 12) / tall, (pane - 4) / wide)
    x = across * scale + pane * (np.arange(len(body))[:, None] + 0.5)
    y = _GROUND - 4 - (height - height.min()) * scale
    shapes: list[Shape] = [
        Line((x[at, child], y[at, child]), (x[at, parent], y[at, parent]), side_of(bone[0]), 2.5)
        for at in range(len(body))
        for bone, child, parent in zip(BONES, *bone_columns(DEFAULT_JOINTS), strict=True)
    ]
    # Control characters and halves of pairs may stand in a file's name, but in no picture.
    caption = "".join(sign if sign.isprintable() else "\ufffd" for sign in caption)
    shapes.append(Text((_WIDTH / 2, _HEIGHT - 6), caption, 11, "muted", "middle"))
    return svg(Drawing(_WIDTH, _HEIGHT, shapes, caption))
