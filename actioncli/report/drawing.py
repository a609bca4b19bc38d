"""Drawings as lists of shapes, and as SVG: what is drawn does not know what it is drawn with."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from html import escape
from typing import Literal

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
        f'height="{drawing.height:g}" role="img" aria-label="{title}">\n<title>{title}</title>\n'
        f"<style>{style}text{{font-family:system-ui,sans-serif}}"
        "line{stroke-linecap:round}</style>\n"
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
