"""Sections of the page that tells why: where the distance comes from, what was compared."""

from __future__ import annotations

from dataclasses import dataclass
from html import escape

import numpy as np
from numpy.typing import NDArray

from actioncli.clips.clip import Clip
from actioncli.clips.prepare import prepared_at
from actioncli.model.config import ModelConfig
from actioncli.recognition.decision import Decision
from actioncli.recognition.explanation import Attended, Explanation
from actioncli.report.drawing import Text, elements
from actioncli.report.figure import figure
from actioncli.report.plots import SHARES, Axis, Plot, fitting
from actioncli.report.scenes import ground_and_body

_PARTS = {"hip": "hip", "kne": "knee", "ank": "ankle", "sho": "shoulder", "elb": "elbow",
          "wri": "wrist"}  # fmt: skip


@dataclass(frozen=True, slots=True)
class Explained:
    """A decision and what explains it.

    Attributes:
        query: the clip that was classified.
        decision: what came of it.
        explanation: of the distance to the nearest action.
        config: of the model.
    """

    query: Clip
    decision: Decision
    explanation: Explanation
    config: ModelConfig


def contributions(case: Explained) -> str:
    """HTML: where the distance to the nearest action comes from, in words, by joint, by moment."""
    return (
        _summary(case)
        + f'\n<div class="plots">{_joints(case.explanation)}{_moments(case.explanation)}</div>\n'
        + _definition(case)
    )


def _summary(case: Explained) -> str:
    query, explanation = case.query, case.explanation
    most = sorted(explanation.joints, key=lambda joint: -explanation.joints[joint])[:3]
    most = [joint for joint in most if explanation.joints[joint] > 0]
    if explanation.distance <= explanation.base or not most:
        return (
            "<p>The query is at least as near to the action as its own enrolled example: nothing "
            "about it stands out.</p>"
        )
    named = ", ".join(
        f"{_joint_name(joint)} ({explanation.joints[joint] / explanation.distance:.0%})"
        for joint in most
    )
    at = prepared_at(query, case.config.preparation) / query.fps
    edges = np.linspace(0, len(at) - 1, len(explanation.moments) + 1)
    first, last = _densest(explanation.moments)
    span = np.interp([edges[first], edges[last + 1]], np.arange(len(at)), at)
    share = float(explanation.moments[first : last + 1].sum()) / explanation.distance
    nearest = escape(case.decision.nearest)
    return (
        f"<p>Most of the distance to {nearest} comes from {named}; {share:.0%} of it "
        f"arises between {span[0]:.1f} s and {span[1]:.1f} s of the query.</p>"
    )


def _joints(explanation: Explanation) -> str:
    parts = sorted(explanation.joints.items(), key=lambda each: -abs(each[1]))
    largest = max(abs(part) for _, part in parts) or 1.0
    whole = explanation.distance or 1.0
    rows = "".join(
        f'<tr><th scope="row">{escape(_joint_name(joint))}</th><td class="bar"><div>'
        f'<span class="{"more" if part >= 0 else "less"}" '
        f'style="width:{100 * abs(part) / largest:.1f}%"></span></div></td>'
        f"<td>{_percent(part / whole)}</td><td>{_signed(part)}</td></tr>"
        for joint, part in parts
    )
    return (
        '<figure><h3>By joint</h3><table class="bars"><tbody>'
        f"{rows}</tbody></table><figcaption>Share of the distance, and in its unit. Hatched: the "
        "joint brings the query nearer to the action than the example is.</figcaption></figure>"
    )


def _moments(explanation: Explanation) -> str:
    values = explanation.moments / (explanation.distance or 1.0)
    y = fitting("share of the distance", float(values.min()), float(values.max()), percent=True)
    plot = Plot("By moment", Axis("way through the query", 0, 1, SHARES, percent=True), y)
    edges = np.linspace(0, 1, len(values) + 1)
    plot.steps(edges, values, 0, "")
    plot.cursor("player1")
    return plot.html("The upright line is the moment that is shown above.")


def _definition(case: Explained) -> str:
    explanation = case.explanation
    parts = explanation.distance - explanation.base
    factor = case.decision.ranking[0].distance / (explanation.distance or 1.0)
    windows = (
        f" The clip is a window of a long one. The decision’s distance is {factor:.2f} times as "
        "large, because of many windows one is more often like an action by chance."
        if factor > 1.01
        else ""
    )
    odds = (
        "The distance is the odds against the clip and the action being the same, "
        "(1 − confidence) / confidence. "
        if case.config.warp_width
        else ""
    )
    return (
        f"<p>{odds}Distance {short(explanation.distance)} = {short(explanation.base)}, that of "
        f"the enrolled example itself at the query’s pace, {'+' if parts >= 0 else '−'} "
        f"{short(abs(parts))}, the sum of the joints’ parts, and also of the "
        f"moments’.{windows}</p>"
        "<details><summary>How parts are measured</summary><p>The enrolled example, aligned in "
        "time with the query, is turned into the query joint by joint, each bone taking the "
        "query’s direction, and the distance to the action is measured after each. A joint’s part "
        "is what its turn adds, on average over several orders and their reverses (Shapley’s "
        "value). In each order the steps add up to the whole difference, so the parts do, too. "
        "Moments are counted likewise, all joints of a moment together.</p></details>"
    )


def attention(case: Explained, example: Clip, named: str) -> str:
    """HTML: which moments of the query the model compared with which of an example.

    Args:
        example: the one that the explanation is about.
        named: what to call it.
    """
    explanation = case.explanation
    plot = Plot(
        "Attention between moments",
        Axis(f"way through {named}", 0, 1, SHARES, percent=True),
        Axis("way through the query", 0, 1, SHARES, percent=True),
    )
    plot.cells(explanation.attention, 0)
    heat = plot.html(
        "The stronger the colour, the more a moment of the query is compared with a moment of the "
        "example; a straight diagonal means that both go through the action alike."
    )
    shown = "".join(_pair(each, case, example) for each in explanation.pairs)
    makes = (
        "make T, one part of the score beside the cost of warping one clip onto the other, the "
        "room that other people’s motions leave around both, and the discriminator’s judgement"
        if case.config.warp_width
        else "make the distance, T"
    )
    return (
        "<p>The model forms pairs of moments of the query, and for each a prototype: the mean of "
        "the pairs of the enrolled examples, weighted by its attention to them. Their differences "
        f'{makes}.</p><div class="plots">{heat}</div>'
        "<h3>The pairs that differ most from their prototypes</h3>"
        f'<div class="attended">{shown}</div>'
    )


def _pair(each: Attended, case: Explained, example: Clip) -> str:
    """Two moments of the query above the two of the example that they attend to most."""
    shapes = []
    for row, (clip, pair) in enumerate(((case.query, each.query), (example, each.example))):
        drawn = figure(clip)
        at = prepared_at(clip, case.config.preparation)
        step = len(at) // len(case.explanation.moments)
        top = float(drawn.points[..., 1].max())
        for column, moment in enumerate(pair):
            frame = round(float(at[moment * step + step // 2]))
            scale = 78 / max(top + 0.1, 1.2)
            across = 105 + 100 * column
            shapes += ground_and_body(drawn, frame, (across, 105 + 125 * row), scale, 2.5)
            seconds = f"{frame / clip.fps:.1f} s"
            shapes.append(Text((across, 122 + 125 * row), seconds, 10, "muted", "middle"))
        shapes.append(Text((8, 65 + 125 * row), "query" if row == 0 else "example", 11, "muted"))
    said = (
        f"{each.weight:.0%} of this pair’s attention goes to the pair below; its part of T is "
        f"{each.share:.1%}."
    )
    return (
        '<figure><svg viewBox="0 0 260 255" role="img" aria-label="Two poses of the query above '
        f'the two of the example that they attend to most">{elements(shapes)}</svg>'
        f"<figcaption>{said}</figcaption></figure>"
    )


def _joint_name(joint: str) -> str:
    """`rwri` as people say it: right wrist."""
    part = _PARTS.get(joint[1:])
    if part and joint[0] in "lr":
        return f"{'left' if joint[0] == 'l' else 'right'} {part}"
    return {"pelv": "pelvis"}.get(joint, joint)


def _densest(moments: NDArray[np.float64]) -> tuple[int, int]:
    """First and last moment of the shortest stretch with at least half of what they add."""
    more = np.maximum(moments, 0)
    half = more.sum() / 2
    best = (0, len(more) - 1)
    for first in range(len(more)):
        reached = np.flatnonzero(np.cumsum(more[first:]) >= half)
        if len(reached) and reached[0] < best[1] - best[0]:
            best = (first, first + int(reached[0]))
    return best


def short(value: float) -> str:
    """Three digits, in powers of ten where it is large."""
    if abs(value) < 1e-9:
        return "0"
    return f"{value:.3g}" if abs(value) < 1000 else f"{value:.3e}"


def _percent(share: float) -> str:
    return f"{'−' if round(share, 2) < 0 else ''}{abs(share):.0%}"


def _signed(value: float) -> str:
    return f"{'−' if value < 0 else '+'}{short(abs(value))}"
