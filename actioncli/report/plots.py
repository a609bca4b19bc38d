"""Plots as SVG that follows the page's colours and can be read on a phone and in print."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field
from html import escape

import numpy as np
from numpy.typing import ArrayLike, NDArray

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
        return f"{100 * tick:.3g} %" if self.percent else f"{tick:g}"


SHARES = (0.0, 0.25, 0.5, 0.75, 1.0)


def fitting(label: str, low: float, high: float, percent: bool = False) -> Axis:
    """An axis with round ticks that holds 0 and the values from low to high."""
    low, high = min(low, 0.0), max(high, 0.0)
    reach = high - low or 1.0
    power = 10.0 ** np.floor(np.log10(reach / 4))
    step = next(power * each for each in (1, 2, 5, 10) if power * each >= reach / 4)
    first, last = int(np.floor(low / step + 1e-9)), int(np.ceil(high / step - 1e-9))
    ticks = tuple(float(f"{step * tick:.6g}") for tick in range(first, max(last, first + 1) + 1))
    return Axis(label, ticks[0], ticks[-1], ticks, percent)


@dataclass
class Plot:
    """Marks in data coordinates; `series` numbers choose colour and dashes."""

    title: str
    x: Axis
    y: Axis
    _marks: list[str] = field(default_factory=list)
    _legend: list[tuple[int, str]] = field(default_factory=list)

    def line(self, xs: ArrayLike, ys: ArrayLike, series: int, name: str) -> None:
        """A line through points, in the legend if it has a name."""
        joined = _joined(self._points(xs, ys))
        self._marks.append(
            f'<polyline points="{joined}" fill="none" stroke="var(--s{series})" '
            f'stroke-width="2" stroke-dasharray="{_DASHES[series]}" stroke-linejoin="round">'
            f"<title>{escape(name)}</title></polyline>"
        )
        if name:
            self._legend.append((series, name))

    def band(self, xs: ArrayLike, lows: ArrayLike, highs: ArrayLike, series: int) -> None:
        """The area between two lines."""
        around = [*self._points(xs, highs), *reversed(self._points(xs, lows))]
        joined = _joined(around)
        self._marks.append(f'<polygon points="{joined}" fill="var(--s{series})" opacity="0.15"/>')

    def steps(self, edges: ArrayLike, shares: ArrayLike, series: int, name: str) -> None:
        """A histogram: B + 1 edges, B heights."""
        xs = np.repeat(np.asarray(edges, float), 2)
        ys = np.concatenate([[0.0], np.repeat(np.asarray(shares, float), 2), [0.0]])
        self.band(xs, np.zeros(len(xs)), ys, series)
        self.line(xs, ys, series, name)

    def cells(self, shares: NDArray[np.float64], series: int) -> None:
        """A matrix over the whole plot, its first row at the bottom, the darker the larger."""
        rows, columns = shares.shape
        top = max(float(shares.max()), 1e-12)
        (x0, y0), (x1, y1) = self._place(0, 0), self._place(1, 1)
        width, height = (x1 - x0) / columns, (y0 - y1) / rows
        for row in range(rows):
            for column in range(columns):
                share = float(shares[row, column])
                if share > 0.02 * top:
                    self._marks.append(
                        f'<rect x="{x0 + column * width:.1f}" y="{y0 - (row + 1) * height:.1f}" '
                        f'width="{width:.1f}" height="{height:.1f}" fill="var(--s{series})" '
                        f'opacity="{share / top:.2f}"><title>{share:.0%}</title></rect>'
                    )

    def cursor(self) -> None:
        """A vertical line that follows the page's player; the axis is its way, from 0 to 1."""
        (x0, _), (x1, _) = self._place(0, 0), self._place(1, 0)
        self._marks.append(
            f'<line class="cursor" data-span="{x1 - x0:.1f}" x1="{x0:.1f}" y1="{_TOP}" '
            f'x2="{x0:.1f}" y2="{HEIGHT - _BOTTOM}" stroke="var(--ink)" stroke-width="1.5"/>'
        )

    def rule(self, at: float, name: str) -> None:
        """A vertical rule with its name, such as a threshold."""
        x, _ = self._place(at, self.y.low)
        self._marks.append(
            f'<line x1="{x:.1f}" y1="{_TOP}" x2="{x:.1f}" y2="{HEIGHT - _BOTTOM}" '
            'stroke="var(--ink)" stroke-dasharray="3 3"/>'
            f'<text x="{x + 4:.1f}" y="{_TOP + 10}">{escape(name)}</text>'
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
            for series, name in sorted(self._legend)
        )
        legend = f'<ul class="legend">{legend}</ul>' if legend else ""
        words = f"{self.y.label[:1].upper()}{self.y.label[1:]}. {note}"
        return (
            f'<figure><h3>{title}</h3><svg viewBox="0 0 {WIDTH:g} {HEIGHT:g}" role="img" '
            f'aria-label="{title}: {escape(self.y.label)} over {escape(self.x.label)}">'
            f"{''.join(grid)}{''.join(self._marks)}"
            f'<text x="{(_LEFT + right) / 2}" y="{HEIGHT - 6}" text-anchor="middle">'
            f"{escape(self.x.label)}</text>"
            f"</svg>{legend}<figcaption>{escape(words)}</figcaption>"
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


def _joined(points: Iterable[tuple[float, float]]) -> str:
    return " ".join(f"{x:.1f},{y:.1f}" for x, y in points)
