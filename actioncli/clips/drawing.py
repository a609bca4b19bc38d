"""A clip as a small picture for notebooks: the skeleton at five moments side by side."""

from __future__ import annotations

from collections.abc import Sequence
from html import escape

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

# Pixels: the picture, and the part of it above the caption.
_WIDTH, _HEIGHT, _GROUND = 320, 160, 138
_MOMENTS = 5
# Left and right after Okabe and Ito; the middle is visible on light and dark paper.
_COLOURS = {"left": "#0072b2", "right": "#d55e00", "middle": "#808890"}


def strip(joints: FloatArray, names: Sequence[str], caption: str) -> str | None:
    """An SVG of 320 x 160 pixels with the body at up to five moments, equidistant in time.

    Whichever way the person faced, the body faces the viewer, turned a little to the side.

    Args:
        joints: (T, J, 3) as in `Clip`.
        names: J joint names.
        caption: one line below the picture.

    Returns:
        The SVG element, or None where the layout lacks one of the default joints.
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
    lines = [
        f'<line x1="{x[at, child]:.1f}" y1="{y[at, child]:.1f}" x2="{x[at, parent]:.1f}" '
        f'y2="{y[at, parent]:.1f}" stroke="{_COLOURS[side_of(bone[0])]}"/>'
        for at in range(len(body))
        for bone, child, parent in zip(BONES, *bone_columns(DEFAULT_JOINTS), strict=True)
    ]
    # Control characters and halves of pairs may stand in a file's name, but in no picture.
    caption = "".join(sign if sign.isprintable() else "\ufffd" for sign in caption)
    return (
        f'<svg xmlns="http://www.w3.org/2000/svg" width="{_WIDTH}" height="{_HEIGHT}" '
        f'viewBox="0 0 {_WIDTH} {_HEIGHT}" stroke-width="2.5" stroke-linecap="round" role="img">'
        + "".join(lines)
        + f'<text x="{_WIDTH // 2}" y="{_HEIGHT - 6}" font-size="11" font-family="sans-serif" '
        f'text-anchor="middle" stroke="none" fill="{_COLOURS["middle"]}">{escape(caption)}</text>'
        "</svg>"
    )
