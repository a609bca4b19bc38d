"""The page that tells why a clip was accepted or rejected."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from html import escape
from pathlib import Path

import numpy as np

from actioncli.clips.clip import Clip
from actioncli.clips.prepare import Preparation, prepared_at
from actioncli.clips.skeleton import LIMBS
from actioncli.errors import UsageError
from actioncli.files import replacing
from actioncli.model.arrays import sigmoid
from actioncli.recognition.decision import Decision
from actioncli.recognition.explanation import Explanation, listed
from actioncli.report.figure import figure
from actioncli.report.page import page, playable, player, scrolling
from actioncli.report.plots import SHARES, Axis, Plot, fitting

# Actions beside the query, and rows of the ranking.
SHOWN = 3
_RANKED = 10


@dataclass(frozen=True, slots=True)
class Explained:
    """A decision and what explains it.

    Attributes:
        query: the clip that was classified.
        decision: what came of it.
        explanation: of the score of the nearest action.
        preparation: what the model does to a clip first.
    """

    query: Clip
    decision: Decision
    explanation: Explanation
    preparation: Preparation


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


def write_explanation(path: Path, case: Explained, neighbours: Sequence[Neighbour]) -> None:
    """Write the page.

    Args:
        path: of the page.
        case: what is explained.
        neighbours: the nearest actions, nearest first; the first with the example that the
            explanation names.

    Raises:
        UsageError: as `check_page`, or the page cannot be written.
    """
    check_page(path)
    body = "\n".join(_sections(case, neighbours))
    shown = [(case.query, _glow(case)), *((each.clip, None) for each in neighbours)]
    figures = [
        playable(figure(clip), prepared_at(clip, case.preparation).tolist(), glow)
        for clip, glow in shown
    ]
    verdict = "Accepted" if case.decision.accepted else "Rejected"
    title = f"{verdict}: {Path(case.query.source).name}"
    with replacing(path, failure=UsageError) as part:
        part.write_text(page(title, body, figures), encoding="utf-8")


def _sections(case: Explained, neighbours: Sequence[Neighbour]) -> Iterator[str]:
    query, decision, example = case.query, case.decision, neighbours[0]
    name = escape(Path(query.source).name or "the clip")
    nearest = escape(decision.nearest)
    yield f"<h1>{name}: {nearest if decision.accepted else 'rejected'}</h1>"
    yield _verdict(decision)
    yield _players(query, neighbours)
    yield "<h2>The nearest actions</h2>"
    yield _ranking(decision)
    yield f"<h2>What speaks for {nearest}</h2>"
    yield _contributions(case)
    yield "<h2>What was compared with what</h2>"
    yield _attention(case, f"{example.label}: {example.name}")
    yield "<h2>What happened to the clip before</h2>"
    yield _notes(case)


def _verdict(decision: Decision) -> str:
    nearest, confidence = escape(decision.nearest), f"{decision.confidence:.2f}"
    tau = f"{decision.tau:.2f}"
    if decision.accepted:
        verdict = (
            f"Accepted as <b>{nearest}</b>: the confidence, {confidence}, is above the threshold "
            f"τ, {tau}."
        )
    elif decision.negative_is_nearer:
        verdict = (
            f"Rejected: a negative is nearer (distance {decision.nearest_negative:.2f}) than the "
            f"nearest action, <b>{nearest}</b> ({decision.ranking[0].distance:.2f}), which "
            f"rejects whatever the confidence ({confidence}; τ is {tau})."
        )
    else:
        verdict = (
            f"Rejected: the nearest action is <b>{nearest}</b>, but the confidence, {confidence}, "
            f"is not above the threshold τ, {tau}."
        )
    return f'<p class="verdict{" yes" if decision.accepted else ""}">{verdict}</p>'


def _players(query: Clip, neighbours: Sequence[Neighbour]) -> str:
    captions = [f"<b>{escape(Path(query.source).name)}</b>the query"]
    for place, each in enumerate(neighbours, 1):
        what = "nearest action" if place == 1 else f"number {place}"
        captions.append(f"<b>{escape(each.label)}</b>{what}: {escape(each.name)}")
    return (
        player("the query and the nearest actions", captions)
        + "<p>All clips go from their beginning to their end in the same time, as the model "
        "compares them. Discs on the query stand where a part speaks against the action. Left "
        "of the body is blue, right is orange; joints that the source had to guess are hollow.</p>"
    )


def _glow(case: Explained) -> list[float]:
    """For each point of the query's figure, which share of what speaks against it stands there."""
    against = {
        LIMBS[part][-1]: max(-lost, 0.0)
        for part, lost in case.explanation.parts.items()
        if part in LIMBS
    }
    total = max(sum(against.values()), 1e-12)
    return [against.get(name, 0.0) / total for name in figure(case.query).names]


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


def _contributions(case: Explained) -> str:
    """What speaks for the nearest action and against it, in words, by body part, by moment."""
    alone = float(sigmoid(np.array(case.explanation.score)))
    window = (
        f" The clip is a window of a long one: alone its confidence is {alone:.2f}; of many "
        "windows one is more often like an action by chance."
        if alone > case.decision.confidence + 0.01
        else ""
    )
    return (
        _summary(case)
        + f'\n<div class="plots">{_parts(case.explanation)}{_moments(case.explanation)}</div>\n'
        + "<p>The score is the logit of the confidence: above 0 where the confidence is above "
        f"0.5. Here it is {_signed(case.explanation.score)}. What a part contributes is what the "
        "score loses where the part is left out of both clips, as if nobody had seen it; what a "
        "moment contributes, what it loses where the moment is left out of the query. Parts that "
        "say the same can each be spared, so contributions need not add up to the score."
        f"{window}</p>"
    )


def _summary(case: Explained) -> str:
    parts = case.explanation.parts
    agree = [part for part in parts if parts[part] > 0.1]
    differ = [part for part in parts if parts[part] < -0.1]
    nearest = escape(case.decision.nearest)
    said = [
        f"{escape(listed(names))} {verb} {nearest}"
        for names, verb in ((agree, "speak for"), (differ, "speak against"))
        if names
    ]
    told = [f"{'; '.join(said)}." if said else f"no part alone decides about {nearest}."]
    if not (case.decision.accepted or case.decision.negative_is_nearer):
        told.append(f"{escape(case.explanation.lacking(case.decision.tau))}.")
    return f"<p>{' '.join(each[0].upper() + each[1:] for each in told)}</p>"


def _parts(explanation: Explanation) -> str:
    largest = max((abs(part) for part in explanation.parts.values()), default=0) or 1.0
    rows = "".join(
        f'<tr><th scope="row">{escape(name)}</th><td class="bar"><div>'
        f'<span class="{"more" if part >= 0 else "less"}" '
        f'style="width:{100 * abs(part) / largest:.1f}%"></span></div></td>'
        f"<td>{_signed(part)}</td></tr>"
        for name, part in explanation.parts.items()
    )
    return (
        '<figure><h3>By body part</h3><table class="bars"><tbody>'
        f"{rows}</tbody></table><figcaption>What each part adds to the score. Hatched: it speaks "
        "against the action.</figcaption></figure>"
    )


def _moments(explanation: Explanation) -> str:
    values = explanation.moments
    y = fitting("added to the score", float(values.min()), float(values.max()))
    plot = Plot("By moment", Axis("way through the query", 0, 1, SHARES, percent=True), y)
    plot.steps(np.linspace(0, 1, len(values) + 1), values, 0, "")
    plot.cursor()
    return plot.html("The upright line is the moment that is shown above.")


def _attention(case: Explained, named: str) -> str:
    """Which moments of the query the model compared with which of the example of that name."""
    plot = Plot(
        "Attention between moments",
        Axis(f"way through {named}", 0, 1, SHARES, percent=True),
        Axis("way through the query", 0, 1, SHARES, percent=True),
    )
    plot.cells(case.explanation.attention, 0)
    heat = plot.html(
        "The stronger the colour, the more a moment of the query is compared with a moment of the "
        "example; a straight diagonal means that both go through the action alike."
    )
    return (
        "<p>Each body part at each moment of the query looks for the moments of the enrolled "
        "example that the same part resembles. The differences from what it finds make the "
        f'score.</p><div class="plots">{heat}</div>'
    )


def _short(value: float) -> str:
    """Three digits, in powers of ten where it is large."""
    if abs(value) < 1e-9:
        return "0"
    return f"{value:.3g}" if abs(value) < 1000 else f"{value:.3e}"


def _signed(value: float) -> str:
    return f"{'−' if value < 0 else '+'}{_short(abs(value))}"


def _notes(case: Explained) -> str:
    query, preparation = case.query, case.preparation
    notes = [
        f"{len(query)} frames at {query.fps:.4g} a second ({query.duration:.1f} s), "
        f"{len(query.joint_names)} joints"
    ]
    notes += [*query.notes, *case.decision.notes]
    if query.confidence is not None:
        unsure = float((query.confidence < 0.5).mean())
        notes.append(f"{unsure:.0%} of the joint positions were seen with a confidence below 0.5")
    spacing = "time" if not preparation.motion else f"time and, by {preparation.motion:.0%}, motion"
    notes.append(f"{preparation.frames} frames were taken, equidistant in {spacing}")
    if preparation.heading:
        notes.append("the body was turned to face the front")
    size = {"torso": "was divided by the length of its torso",
            "standard": "was given standard proportions"}  # fmt: skip
    if preparation.size in size:
        notes.append(f"the body {size[preparation.size]}")
    lines = "".join(f"<li>{escape(line)}</li>" for line in dict.fromkeys(notes))
    return f"<ul>{lines}</ul>"
