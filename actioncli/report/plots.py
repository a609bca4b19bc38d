"""Plots as SVG that follows the page's colours and can be read on a phone and in print."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from html import escape

import numpy as np
from numpy.typing import ArrayLike

WIDTH, HEIGHT = 400.0, 280.0
_LEFT, _RIGHT, _TOP, _BOTTOM = 46.0, 22.0, 12.0, 42.0

# Told apart by their dashes too, where colours are not.
_DASHES = ("", "7 3", "2 3", "9 3 2 3", "4 4", "1 4")


@dataclass(frozen=True, slots=True)
class Axis:
    """What a direction shows, its range, and where its ticks are."""

    label: str
    low: float
    high: float
    ticks: tuple[float, ...]
    percent: bool = False

    def said(self, tick: float) -> str:
        """The tick as people read it."""
        return f"{100 * tick:.0f} %" if self.percent else f"{tick:g}"


SHARES = (0.0, 0.25, 0.5, 0.75, 1.0)


@dataclass
class Plot:
    """Marks in data coordinates; `series` numbers choose colour and dashes."""

    title: str
    x: Axis
    y: Axis
    _marks: list[str] = field(default_factory=list)
    _legend: list[tuple[int, str]] = field(default_factory=list)

    def line(
        self, xs: ArrayLike, ys: ArrayLike, series: int, name: str, dots: bool = False
    ) -> None:
        """A line through points, with a name in the legend."""
        points = self._points(xs, ys)
        joined = " ".join(f"{x:.1f},{y:.1f}" for x, y in points)
        self._marks.append(
            f'<polyline points="{joined}" fill="none" stroke="var(--s{series})" '
            f'stroke-width="2" stroke-dasharray="{_DASHES[series]}" stroke-linejoin="round">'
            f"<title>{escape(name)}</title></polyline>"
        )
        if dots:
            self._marks += [
                f'<circle cx="{x:.1f}" cy="{y:.1f}" r="3" fill="var(--s{series})"/>'
                for x, y in points
            ]
        self._legend.append((series, name))

    def band(self, xs: ArrayLike, lows: ArrayLike, highs: ArrayLike, series: int) -> None:
        """The area between two lines."""
        around = [*self._points(xs, highs), *reversed(self._points(xs, lows))]
        joined = " ".join(f"{x:.1f},{y:.1f}" for x, y in around)
        self._marks.append(f'<polygon points="{joined}" fill="var(--s{series})" opacity="0.15"/>')

    def steps(self, edges: ArrayLike, shares: ArrayLike, series: int, name: str) -> None:
        """A histogram: B + 1 edges, B heights."""
        xs = np.repeat(np.asarray(edges, float), 2)
        ys = np.concatenate([[0.0], np.repeat(np.asarray(shares, float), 2), [0.0]])
        self.band(xs, np.zeros(len(xs)), ys, series)
        self.line(xs, ys, series, name)

    def dots(self, xs: ArrayLike, ys: ArrayLike, areas: Sequence[float], series: int) -> None:
        """Dots whose areas are in proportion to `areas`, which are at most 1."""
        for (x, y), area in zip(self._points(xs, ys), areas, strict=True):
            self._marks.append(
                f'<circle cx="{x:.1f}" cy="{y:.1f}" r="{2.5 + 14 * area**0.5:.1f}" '
                f'fill="var(--s{series})" opacity="0.5"/>'
            )

    def rule(self, at: float, name: str) -> None:
        """A vertical rule with its name, such as a threshold."""
        x, _ = self._place(at, self.y.low)
        self._marks.append(
            f'<line x1="{x:.1f}" y1="{_TOP}" x2="{x:.1f}" y2="{HEIGHT - _BOTTOM}" '
            'stroke="var(--ink)" stroke-dasharray="3 3"/>'
            f'<text x="{x + 4:.1f}" y="{_TOP + 10}">{escape(name)}</text>'
        )

    def diagonal(self, name: str) -> None:
        """The line y = x, with its name."""
        (x1, y1), (x2, y2) = self._place(0, 0), self._place(1, 1)
        self._marks.append(
            f'<line x1="{x1}" y1="{y1}" x2="{x2}" y2="{y2}" stroke="var(--muted)" '
            f'stroke-dasharray="2 4"><title>{escape(name)}</title></line>'
        )

    def html(self, note: str = "") -> str:
        """The plot as an HTML figure with its legend and a note in plain text below it."""
        bottom, right = HEIGHT - _BOTTOM, WIDTH - _RIGHT
        grid = []
        for tick in self.x.ticks:
            x, _ = self._place(tick, self.y.low)
            grid.append(
                f'<line x1="{x:.1f}" y1="{bottom}" x2="{x:.1f}" y2="{bottom + 4}" '
                f'stroke="var(--muted)"/><text x="{x:.1f}" y="{bottom + 17}" '
                f'text-anchor="middle">{self.x.said(tick)}</text>'
            )
        for tick in self.y.ticks:
            _, y = self._place(self.x.low, tick)
            grid.append(
                f'<line x1="{_LEFT}" y1="{y:.1f}" x2="{right}" y2="{y:.1f}" stroke="var(--line)"/>'
                f'<text x="{_LEFT - 6}" y="{y + 4:.1f}" text-anchor="end">'
                f"{self.y.said(tick)}</text>"
            )
        title = escape(self.title)
        legend = "".join(
            f'<li><svg viewBox="0 0 28 10" aria-hidden="true"><line x1="0" y1="5" x2="28" y2="5" '
            f'stroke="var(--s{series})" stroke-width="3" stroke-dasharray="{_DASHES[series]}"/>'
            f"</svg>{escape(name)}</li>"
            for series, name in self._legend
        )
        legend = f'<ul class="legend">{legend}</ul>' if legend else ""
        told = f"{self.y.label[:1].upper()}{self.y.label[1:]}. {note}"
        return (
            f'<figure><h3>{title}</h3><svg viewBox="0 0 {WIDTH:g} {HEIGHT:g}" role="img" '
            f'aria-label="{title}: {escape(self.y.label)} over {escape(self.x.label)}">'
            f"{''.join(grid)}{''.join(self._marks)}"
            f'<text x="{(_LEFT + right) / 2}" y="{HEIGHT - 6}" text-anchor="middle">'
            f"{escape(self.x.label)}</text>"
            f"</svg>{legend}<figcaption>{escape(told)}</figcaption>"
            "</figure>"
        )

    def _place(self, x: float, y: float) -> tuple[float, float]:
        across = (x - self.x.low) / (self.x.high - self.x.low)
        up = (min(max(y, self.y.low), self.y.high) - self.y.low) / (self.y.high - self.y.low)
        return (
            _LEFT + across * (WIDTH - _LEFT - _RIGHT),
            HEIGHT - _BOTTOM - up * (HEIGHT - _TOP - _BOTTOM),
        )

    def _points(self, xs: ArrayLike, ys: ArrayLike) -> list[tuple[float, float]]:
        pairs = zip(np.asarray(xs, float), np.asarray(ys, float), strict=True)
        return [self._place(float(x), float(y)) for x, y in pairs]
