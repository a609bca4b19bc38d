"""HTML pages that need nothing but themselves: no script, style, font or picture from outside."""

from __future__ import annotations

import base64
import json
from collections.abc import Sequence
from html import escape
from importlib.resources import files
from math import ceil
from typing import Any

import numpy as np

from actioncli._version import __version__
from actioncli.report.figure import Figure, project

# Nothing may be loaded, and nothing sent: a browser refuses it even if a file name or a label
# found a way into the page's code.
_POLICY = "default-src 'none'; style-src 'unsafe-inline'; script-src 'unsafe-inline'"

# Figures in a page move at this rate (frames a second) at most, which keeps the page small.
_RATE = 25.0
# Five minutes of them; a longer recording keeps fewer a second.
_MOST_FRAMES = 7500


def page(title: str, body: str, figures: Sequence[dict[str, Any]] = ()) -> str:
    """A whole page.

    Args:
        title: plain text.
        body: HTML.
        figures: from `playable`; the page shows them where `player` stands.
    """
    scripts = f"<script>{_resource('scroll.js')}</script>\n"
    if figures:
        # "<" would let a label end the element.
        data = json.dumps(list(figures)).replace("<", "\\u003c")
        scripts += (
            f'<script type="application/json" id="figures">{data}</script>\n'
            f"<script>{_resource('player.js')}</script>\n"
        )
    document = (
        '<!doctype html>\n<html lang="en">\n<head>\n<meta charset="utf-8">\n'
        f'<meta http-equiv="Content-Security-Policy" content="{_POLICY}">\n'
        '<meta name="viewport" content="width=device-width, initial-scale=1">\n'
        f"<title>{escape(title)}</title>\n<style>\n{_resource('page.css')}</style>\n</head>\n"
        f'<body>\n<main>\n{body}\n</main>\n<footer><p class="muted">Made by actioncli '
        f"{__version__}. This page holds all that it shows; nothing is loaded or sent.</p>"
        f"</footer>\n{scripts}</body>\n</html>\n"
    )
    # Half a character, which stands for a byte of a file's name that is no UTF-8, can't be written.
    return document.encode(errors="backslashreplace").decode()


def player(name: str, captions: Sequence[str]) -> str:
    """Where the page's figures play side by side, in step.

    Args:
        name: what the controls say that they control.
        captions: HTML, for each figure of the page.
    """
    panels = "".join(f"<figure><figcaption>{caption}</figcaption></figure>" for caption in captions)
    return f'<div class="player" data-name="{escape(name)}"><div class="stage">{panels}</div></div>'


def playable(
    figure: Figure,
    clock: Sequence[float] | None = None,
    glow: Sequence[float] | None = None,
) -> dict[str, Any]:
    """A figure as the player takes it.

    Args:
        figure: whose motion.
        clock: frames, fractions allowed, that are shown at equal steps of the player's time;
            None is from first to last.
        glow: for each point of the figure a share in [0, 1] that its mark shows.
    """
    step = max(1, round(figure.fps / _RATE), ceil(len(figure.points) / _MOST_FRAMES))
    kept = np.arange(0, len(figure.points), step)
    millimetres = np.clip(np.round(1000 * figure.points[kept]), -32767, 32767).astype("<i2")
    sure = figure.sure[kept].astype(np.uint8)
    data: dict[str, Any] = {
        "frames": len(kept),
        "joints": len(figure.names),
        "seconds": round(figure.duration, 3),
        "box": round(_box(figure), 3),
        "bones": [[*bone, figure.stroke(bone)] for bone in figure.bones],
        "head": figure.head,
        "points": base64.b64encode(millimetres.tobytes()).decode(),
        "sure": base64.b64encode(sure.tobytes()).decode(),
    }
    if clock is not None:
        data["clock"] = [round(min(at / step, len(kept) - 1), 2) for at in clock]
    way = np.arange(len(kept)) if clock is None else np.array(data["clock"])
    data["opens"] = round(
        float(np.abs(way - figure.telling / step).argmin() / max(len(way) - 1, 1)), 3
    )
    if glow is not None:
        data["glow"] = [round(float(share), 4) for share in glow]
    return data


def table(
    caption: str, header: Sequence[str], rows: Sequence[Sequence[str]], text_columns: int = 1
) -> str:
    """Rows of plain text, the first `text_columns` flush left, that scroll if they must."""
    heads = "".join(
        f'<th scope="col"{_text(column < text_columns)}>{escape(name)}</th>'
        for column, name in enumerate(header)
    )
    lines = "".join(
        "<tr>"
        + "".join(
            f'<th scope="row">{escape(cell)}</th>'
            if column == 0
            else f"<td{_text(column < text_columns)}>{escape(cell)}</td>"
            for column, cell in enumerate(row)
        )
        + "</tr>"
        for row in rows
    )
    return scrolling(
        caption,
        f"<table><caption>{escape(caption)}</caption><thead><tr>{heads}</tr></thead>"
        f"<tbody>{lines}</tbody></table>",
    )


def scrolling(name: str, content: str) -> str:
    """HTML that may be wider than the page, reachable by keyboard."""
    return (
        f'<div class="scroll" tabindex="0" role="region" aria-label="{escape(name)}">'
        f"{content}</div>"
    )


def _text(flush_left: bool) -> str:
    return ' class="text"' if flush_left else ""


def _box(figure: Figure) -> float:
    """Side of the square, standing on the ground around the origin, that it needs when turned."""
    flat = np.linalg.norm(figure.points[..., [0, 2]], axis=-1)
    return max(2 * float(flat.max()), float(project(figure.points)[..., 1].max()) + 0.1, 1.2)


def _resource(name: str) -> str:
    return files("actioncli.report").joinpath(name).read_text(encoding="utf-8")
