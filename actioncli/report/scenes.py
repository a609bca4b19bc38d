"""What pictures of clips show: a strip of poses over time, or all figures at one moment."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from unicodedata import east_asian_width

import numpy as np

from actioncli.clips.clip import FloatArray
from actioncli.clips.drawing import Drawing, Line, Oval, Shape, Text
from actioncli.report.figure import Figure, project

# Poses in a strip: enough to see a movement, few enough to see each pose.
MOST_POSES, FEWEST_POSES = 10, 5

_STRIP = 960.0  # width of a strip, pixels
_TALL = 150.0  # height of a pose in it, at most
_OVERLAP = 1.35  # how much wider than its place the widest pose may be
_MARGIN = 20.0
_PANEL = 360.0  # side of the box of one figure in an animation
_HEADER = 70.0  # height of label and legend above them
_HEAD_RADIUS = 0.1  # metres
_LOWEST_TOP = 1.2  # metres that a picture is high at least: who lies down is no giant
_HOLD = 0.6  # seconds that the last pose stays before an animation starts again


@dataclass(frozen=True, slots=True)
class Example:
    """A figure and the line that says which clip it is."""

    figure: Figure
    caption: str


def strip(label: str, examples: Sequence[Example]) -> Drawing:
    """A row of poses, equidistant in time, for every example.

    Every pose stands in the middle of its place, so that walking does not lead out of it. All
    have the same scale; the wider the poses, the fewer there are.
    """
    width = 2 * _MARGIN + _STRIP
    shapes: list[Shape] = [Text((_MARGIN, 38), _cut(label, 20, width - 240), 20)]
    shapes += _legend(width - _MARGIN, 36)
    reach = max(_reach(example.figure) for example in examples)
    tallest = max(_height(example.figure) for example in examples)
    scale = min(_TALL / tallest, _STRIP / FEWEST_POSES / (2 * reach))
    poses = int(_STRIP * _OVERLAP / (2 * reach * scale))
    poses = min(max(poses, FEWEST_POSES), MOST_POSES)
    top = 54.0
    for example in examples:
        caption = _cut(example.caption, 12, _STRIP)
        shapes.append(Text((_MARGIN, top + 14), caption, 12, "muted"))
        ground = top + 30 + scale * tallest
        frames = np.linspace(0, len(example.figure.points) - 1, poses).round().astype(int)
        for place, frame in enumerate(frames):
            x = _MARGIN + (place + 0.5) * _STRIP / poses
            centre = _middle(example.figure, project(example.figure.points[frame]))
            at = (x - scale * float(centre), ground)
            shapes += ground_and_body(example.figure, int(frame), at, scale, 3.5)
            seconds = f"{frame / example.figure.fps:.1f} s"
            shapes.append(Text((x, ground + 26), seconds, 11, "muted", "middle"))
        top = ground + 40
    return Drawing(width, top + 6, shapes, f"{label}: poses over time")


def pictures(examples: Sequence[Example], rate: float) -> int:
    """How many `moments` has."""
    longest = max(example.figure.duration for example in examples)
    return int((longest + _HOLD) * rate) + 1


def moments(label: str, examples: Sequence[Example], rate: float) -> Iterator[Drawing]:
    """The pictures of an animation in which all examples start together, `rate` a second."""
    across = min(len(examples), 4)
    down = -(-len(examples) // across)
    panel = _PANEL if across < 3 else 0.7 * _PANEL
    boxes = [_box(example.figure) for example in examples]
    scale = min((panel - 76) / box for box in boxes)
    for picture in range(pictures(examples, rate)):
        seconds = picture / rate
        wide = across * panel - 2 * _MARGIN
        shapes: list[Shape] = [Text((_MARGIN, 36), _cut(label, 20, wide), 20)]
        shapes += _legend(_MARGIN + 158, 60)
        for place, example in enumerate(examples):
            left, top = place % across * panel, _HEADER + place // across * panel
            frame = example.figure.at(seconds)
            at = (left + panel / 2, top + panel - 52)
            shapes += ground_and_body(example.figure, frame, at, scale, 5, travels=True)
            shown = min(seconds, example.figure.duration)
            words = f"{_cut(example.caption, 12, panel - 70)}, {shown:.1f} s"
            shapes.append(Text((left + panel / 2, top + panel - 14), words, 12, "muted", "middle"))
        yield Drawing(across * panel, _HEADER + down * panel, shapes, f"{label} in motion")


def _cut(text: str, size: float, room: float) -> str:
    """As much of a line as fits into so many pixels; a label or a file's name may be longer."""
    most, used = room / (0.56 * size), 0  # letters of common fonts are about so wide
    for end, letter in enumerate(text):
        used += 2 if east_asian_width(letter) in "WF" else 1
        if used > most:
            return text[: end - 1] + "…"
    return text


def ground_and_body(
    figure: Figure,
    frame: int,
    at: tuple[float, float],
    scale: float,
    width: float,
    travels: bool = False,
) -> list[Shape]:
    """One pose over a disc of ground.

    Args:
        figure: whose.
        frame: which of its frames.
        at: where the figure's origin is in the picture.
        scale: pixels a metre.
        width: of a bone's stroke, pixels.
        travels: whether the disc stays at the origin, instead of under the body.
    """
    flat = project(figure.points[frame])
    x, y = at[0] + scale * flat[:, 0], at[1] - scale * flat[:, 1]
    under = at[0] if travels else at[0] + scale * float(_middle(figure, flat))
    disc = scale * (0.75 if travels else 0.42)
    shapes: list[Shape] = [Oval((under, at[1]), (disc, 0.16 * disc), "ground")]
    sure = figure.sure[frame]
    for bone in figure.bones:
        a, b, side = bone
        dashed = not (sure[a] and sure[b])
        ends = (float(x[a]), float(y[a])), (float(x[b]), float(y[b]))
        shapes.append(Line(*ends, side, figure.stroke(bone) * width, dashed))
    if figure.head is not None:
        centre = float(x[figure.head]), float(y[figure.head])
        radius = scale * _HEAD_RADIUS
        shapes.append(Oval(centre, (radius, radius), "middle", 0.6 * width))
    on_bones = {end for a, b, _ in figure.bones for end in (a, b)}
    for point in range(len(x)):
        centre = float(x[point]), float(y[point])
        if not sure[point]:
            shapes.append(Oval(centre, (0.9 * width, 0.9 * width), "muted", 0.4 * width))
        elif point not in on_bones:
            shapes.append(Oval(centre, (0.6 * width, 0.6 * width), "middle"))
    return shapes


def _middle(figure: Figure, flat: FloatArray) -> FloatArray:
    """(...) where the body stands from left to right, of points (..., P, 2) in a picture."""
    across = flat[..., 0]
    if "pelv" in figure.names:
        return np.asarray(across[..., figure.names.index("pelv")])
    return np.asarray(across.mean(axis=-1))


def _reach(figure: Figure) -> float:
    """How far the figure reaches to either side of where it stands, metres."""
    flat = project(figure.points)
    return max(float(np.abs(flat[..., 0] - _middle(figure, flat)[..., None]).max()), 0.3)


def _height(figure: Figure) -> float:
    return max(float(project(figure.points)[..., 1].max()) + _HEAD_RADIUS, _LOWEST_TOP)


def _box(figure: Figure) -> float:
    """Side of the square, centred at the origin and standing on the ground, that it needs."""
    flat = project(figure.points)
    return max(2 * float(np.abs(flat[..., 0]).max()), _height(figure))


def _legend(right: float, y: float) -> list[Shape]:
    """Which colour is which side, flush right."""
    return [
        Line((right - 158, y - 4), (right - 142, y - 4), "left", 4),
        Text((right - 134, y), "left", 12, "muted"),
        Line((right - 92, y - 4), (right - 76, y - 4), "right", 4),
        Text((right - 68, y), "right of body", 12, "muted"),
    ]
