"""Sections of the page that tells why: what speaks for the action, what was compared."""

from __future__ import annotations

from dataclasses import dataclass
from html import escape

import numpy as np

from actioncli.clips.clip import Clip
from actioncli.clips.prepare import Preparation
from actioncli.model.arrays import sigmoid
from actioncli.recognition.decision import Decision
from actioncli.recognition.explanation import Explanation, listed
from actioncli.report.plots import SHARES, Axis, Plot, fitting


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


def contributions(case: Explained) -> str:
    """HTML: what speaks for the nearest action and what against it, in words, by body part, by
    moment."""
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


def attention(case: Explained, named: str) -> str:
    """HTML: which moments of the query the model compared with which of an example.

    Args:
        named: what to call the example.
    """
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


def short(value: float) -> str:
    """Three digits, in powers of ten where it is large."""
    if abs(value) < 1e-9:
        return "0"
    return f"{value:.3g}" if abs(value) < 1000 else f"{value:.3e}"


def _signed(value: float) -> str:
    return f"{'−' if value < 0 else '+'}{short(abs(value))}"
