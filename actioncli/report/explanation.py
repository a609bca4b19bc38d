"""The page that tells why a clip was accepted or rejected."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from html import escape
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from actioncli.clips.clip import Clip
from actioncli.clips.prepare import Preparation, prepared_at
from actioncli.decision import Decision
from actioncli.errors import UsageError
from actioncli.explanation import Attended, Explanation
from actioncli.model.config import ModelConfig
from actioncli.replacing import replacing
from actioncli.report.drawing import Text, elements
from actioncli.report.figure import Figure, figure
from actioncli.report.page import Stage, page, playable, scrolling
from actioncli.report.plots import SHARES, Axis, Plot, fitting
from actioncli.report.scenes import ground_and_body

# Actions beside the query, and rows of the ranking.
SHOWN = 3
_RANKED = 10

_PARTS = {"hip": "hip", "kne": "knee", "ank": "ankle", "sho": "shoulder", "elb": "elbow",
          "wri": "wrist"}  # fmt: skip


@dataclass(frozen=True, slots=True)
class Neighbour:
    """An enrolled action that stands beside the query, and the example that is shown for it."""

    label: str
    name: str
    clip: Clip


def check_page(path: Path) -> None:
    """Find out whether the page could be written, before any work.

    Raises:
        UsageError: the suffix is not .html, or the folder does not exist.
    """
    if path.suffix.lower() not in {".html", ".htm"}:
        raise UsageError(f"{path}: an explanation is a page: give it a name that ends in .html.")
    if not path.absolute().parent.is_dir():
        raise UsageError(f"{path}: its folder does not exist.")


def write_explanation(
    path: Path,
    query: Clip,
    decision: Decision,
    neighbours: Sequence[Neighbour],
    explanation: Explanation,
    config: ModelConfig,
) -> None:
    """Write the page.

    Args:
        path: of the page.
        query: the clip that was classified.
        decision: what came of it.
        neighbours: the nearest actions, nearest first; the first with the example that
            `explanation` names.
        explanation: of the distance to the nearest action.
        config: of the model.

    Raises:
        UsageError: as `check_page`, or the page cannot be written.
    """
    check_page(path)
    stage = Stage()
    parts = _sections(query, decision, neighbours, explanation, config, stage)
    body = "\n".join(parts)
    title = f"{'Accepted' if decision.accepted else 'Rejected'}: {Path(query.source).name}"
    try:
        with replacing(path) as part:
            part.write_text(page(title, body, stage.figures), encoding="utf-8")
    except OSError as error:
        raise UsageError(f"{path}: cannot be written: {error.strerror}.") from error


def _sections(
    query: Clip,
    decision: Decision,
    neighbours: Sequence[Neighbour],
    explanation: Explanation,
    config: ModelConfig,
    stage: Stage,
) -> Iterator[str]:
    preparation = config.preparation
    name = escape(Path(query.source).name or "the clip")
    nearest = escape(decision.nearest)
    yield f"<h1>{name}: {nearest if decision.accepted else 'rejected'}</h1>"
    yield _verdict(decision)
    yield _players(query, neighbours, explanation, preparation, stage)
    yield "<h2>The nearest actions</h2>"
    yield _ranking(decision)
    yield f"<h2>What makes the distance to {nearest}</h2>"
    yield _summary(query, decision, explanation, preparation)
    yield f'<div class="plots">{_joints(explanation)}{_moments(explanation)}</div>'
    yield _definition(decision, explanation, config)
    yield "<h2>What was compared with what</h2>"
    yield _attention(query, neighbours[0], explanation, config)
    yield "<h2>What happened to the clip before</h2>"
    yield _notes(query, decision, preparation)


def _verdict(decision: Decision) -> str:
    nearest, confidence = escape(decision.nearest), f"{decision.confidence:.2f}"
    tau = f"{decision.tau:.2f}"
    if decision.accepted:
        told = (
            f"Accepted as <b>{nearest}</b>: the confidence, {confidence}, is above the threshold "
            f"τ, {tau}."
        )
    elif decision.shadowed:
        told = (
            f"Rejected: a negative is nearer (distance {decision.nearest_negative:.2f}) than the "
            f"nearest action, <b>{nearest}</b> ({decision.ranking[0].distance:.2f}), which "
            f"rejects whatever the confidence ({confidence}; τ is {tau})."
        )
    else:
        told = (
            f"Rejected: the nearest action is <b>{nearest}</b>, but the confidence, {confidence}, "
            f"is not above the threshold τ, {tau}."
        )
    return f'<p class="verdict{" yes" if decision.accepted else ""}">{told}</p>'


def _players(
    query: Clip,
    neighbours: Sequence[Neighbour],
    explanation: Explanation,
    preparation: Preparation,
    stage: Stage,
) -> str:
    clips = [(f"<b>{escape(Path(query.source).name)}</b>the query", query)]
    for place, each in enumerate(neighbours):
        what = "nearest action" if place == 0 else f"number {place + 1}"
        clips.append((f"<b>{escape(each.label)}</b>{what}: {escape(each.name)}", each.clip))
    shown = []
    for place, (caption, clip) in enumerate(clips):
        drawn = figure(clip)
        glow = _glow(drawn, explanation) if place == 0 else None
        shown.append((caption, playable(drawn, prepared_at(clip, preparation).tolist(), glow)))
    mirrored = (
        " The query resembles the nearest action more with left and right exchanged, and was "
        "compared so, at a price in distance."
        if explanation.mirrored
        else ""
    )
    return (
        stage.player("the query and the nearest actions", shown)
        + "<p>All clips go from their beginning to their end in the same time, as the model "
        "compares them. Discs on the query are as large as a joint’s part of the distance. Left "
        "of the body is blue, right is orange; joints that the source had to guess are hollow."
        f"{mirrored}</p>"
    )


def _glow(drawn: Figure, explanation: Explanation) -> list[float]:
    more = {joint: max(part, 0.0) for joint, part in explanation.joints.items()}
    total = max(sum(more.values()), 1e-12)
    return [more.get(name, 0.0) / total for name in drawn.names]


def _ranking(decision: Decision) -> str:
    rows = []
    for place, each in enumerate(decision.ranking[:_RANKED], 1):
        bar = (
            f'<div><span style="width:{100 * each.confidence:.1f}%"></span>'
            f'<i style="left:{100 * decision.tau:.1f}%"></i></div>'
        )
        rows.append(
            f'<tr><th scope="row">{place}. {escape(each.label)}</th>'
            f'<td class="bar">{bar}</td><td>{each.confidence:.2f}</td>'
            f"<td>{each.probability:.2f}</td><td>{_short(each.distance)}</td></tr>"
        )
    left = len(decision.ranking) - _RANKED
    more = f'<p class="muted">{left} more are farther away.</p>' if left > 0 else ""
    return (
        '<p class="muted">Confidence that the clip shows the action, whatever else is enrolled '
        f"(the rule stands at τ, {decision.tau:.2f}), and probability among the enrolled actions "
        "alone.</p>"
        + scrolling(
            "Ranking",
            '<table class="bars"><thead><tr><th scope="col" class="text">action</th>'
            '<th scope="col" colspan="2">confidence</th><th scope="col">probability</th>'
            f'<th scope="col">distance</th></tr></thead><tbody>{"".join(rows)}</tbody></table>',
        )
        + more
    )


def _summary(
    query: Clip, decision: Decision, explanation: Explanation, preparation: Preparation
) -> str:
    most = sorted(explanation.joints, key=lambda joint: -explanation.joints[joint])[:3]
    most = [joint for joint in most if explanation.joints[joint] > 0]
    if explanation.distance <= explanation.base or not most:
        return (
            "<p>The query is at least as near to the action as its own enrolled example: nothing "
            "about it stands out.</p>"
        )
    named = ", ".join(
        f"{joint_name(joint)} ({explanation.joints[joint] / explanation.distance:.0%})"
        for joint in most
    )
    at = prepared_at(query, preparation) / query.fps
    edges = np.linspace(0, len(at) - 1, len(explanation.moments) + 1)
    first, last = _densest(explanation.moments)
    span = np.interp([edges[first], edges[last + 1]], np.arange(len(at)), at)
    share = float(explanation.moments[first : last + 1].sum()) / explanation.distance
    return (
        f"<p>Most of the distance to {escape(decision.nearest)} comes from {named}; {share:.0%} of "
        f"it arises between {span[0]:.1f} s and {span[1]:.1f} s of the query.</p>"
    )


def _joints(explanation: Explanation) -> str:
    parts = sorted(explanation.joints.items(), key=lambda each: -abs(each[1]))
    largest = max(abs(part) for _, part in parts) or 1.0
    whole = explanation.distance or 1.0
    rows = "".join(
        f'<tr><th scope="row">{escape(joint_name(joint))}</th><td class="bar"><div>'
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


def _definition(decision: Decision, explanation: Explanation, config: ModelConfig) -> str:
    parts = explanation.distance - explanation.base
    factor = decision.ranking[0].distance / (explanation.distance or 1.0)
    windows = (
        f" The clip is a window of a long one. The decision’s distance is {factor:.2f} times as "
        "large, because of many windows one is more often like an action by chance."
        if factor > 1.01
        else ""
    )
    odds = (
        "The distance is the odds against the clip and the action being the same, "
        "(1 − confidence) / confidence. "
        if config.warp_width
        else ""
    )
    return (
        f"<p>{odds}Distance {_short(explanation.distance)} = {_short(explanation.base)}, that of "
        f"the enrolled example itself at the query’s pace, {'+' if parts >= 0 else '−'} "
        f"{_short(abs(parts))}, the sum of the joints’ parts, and also of the "
        f"moments’.{windows}</p>"
        "<details><summary>How parts are measured</summary><p>The enrolled example, aligned in "
        "time with the query, is turned into the query joint by joint, each bone taking the "
        "query’s direction, and the distance to the action is measured after each. A joint’s part "
        "is what its turn adds, on average over several orders and their reverses (Shapley’s "
        "value). In each order the steps add up to the whole difference, so the parts do, too. "
        "Moments are counted likewise, all joints of a moment together.</p></details>"
    )


def _attention(
    query: Clip, nearest: Neighbour, explanation: Explanation, config: ModelConfig
) -> str:
    plot = Plot(
        "Attention between moments",
        Axis(f"way through {nearest.label}: {nearest.name}", 0, 1, SHARES, percent=True),
        Axis("way through the query", 0, 1, SHARES, percent=True),
    )
    plot.cells(explanation.attention, 0)
    heat = plot.html(
        "The stronger the colour, the more a moment of the query is compared with a moment of the "
        "example; a straight diagonal means that both go through the action alike."
    )
    moments = len(explanation.moments)
    shown = "".join(
        _pair(each, query, nearest.clip, moments, config.preparation) for each in explanation.pairs
    )
    makes = (
        "make T, one part of the score beside the cost of warping one clip onto the other, the "
        "room that other people’s motions leave around both, and the discriminator’s judgement"
        if config.warp_width
        else "make the distance, T"
    )
    return (
        "<p>The model forms pairs of moments of the query, and for each a prototype: the mean of "
        "the pairs of the enrolled examples, weighted by its attention to them. Their differences "
        f'{makes}.</p><div class="plots">{heat}</div>'
        "<h3>The pairs that differ most from their prototypes</h3>"
        f'<div class="attended">{shown}</div>'
    )


def _pair(
    each: Attended, query: Clip, example: Clip, moments: int, preparation: Preparation
) -> str:
    """Two moments of the query above the two of the example that they attend to most."""
    shapes = []
    for row, (clip, pair) in enumerate(((query, each.query), (example, each.example))):
        drawn = figure(clip)
        at = prepared_at(clip, preparation)
        step = len(at) // moments
        top = float(drawn.points[..., 1].max())
        for column, moment in enumerate(pair):
            frame = round(float(at[moment * step + step // 2]))
            scale = 78 / max(top + 0.1, 1.2)
            across = 105 + 100 * column
            shapes += ground_and_body(drawn, frame, (across, 105 + 125 * row), scale, 2.5)
            told = f"{frame / clip.fps:.1f} s"
            shapes.append(Text((across, 122 + 125 * row), told, 10, "muted", "middle"))
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


def _notes(query: Clip, decision: Decision, preparation: Preparation) -> str:
    told = [
        f"{len(query)} frames at {query.fps:.4g} a second ({query.duration:.1f} s), "
        f"{len(query.joint_names)} joints"
    ]
    told += [*query.notes, *decision.notes]
    if query.confidence is not None:
        unsure = float((query.confidence < 0.5).mean())
        told.append(f"{unsure:.0%} of the joint positions were seen with a confidence below 0.5")
    spacing = "time" if not preparation.motion else f"time and, by {preparation.motion:.0%}, motion"
    told.append(f"{preparation.frames} frames were taken, equidistant in {spacing}")
    if preparation.heading:
        told.append("the body was turned to face the front")
    size = {"torso": "was divided by the length of its torso",
            "standard": "was given standard proportions"}  # fmt: skip
    if preparation.size in size:
        told.append(f"the body {size[preparation.size]}")
    lines = "".join(f"<li>{escape(line)}</li>" for line in dict.fromkeys(told))
    return f"<ul>{lines}</ul>"


def joint_name(joint: str) -> str:
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


def _short(value: float) -> str:
    if abs(value) < 1e-9:
        return "0"
    return f"{value:.3g}" if abs(value) < 1000 else f"{value:.3e}"


def _percent(share: float) -> str:
    return f"{'−' if share < 0 else ''}{abs(share):.0%}"


def _signed(value: float) -> str:
    return f"{'−' if value < 0 else '+'}{_short(abs(value))}"
