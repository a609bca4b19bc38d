"""The page that tells why a clip was accepted or rejected."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from html import escape
from pathlib import Path

from actioncli.clips.clip import Clip
from actioncli.clips.prepare import prepared_at
from actioncli.clips.skeleton import LIMBS
from actioncli.errors import UsageError
from actioncli.files import replacing
from actioncli.recognition.decision import Decision
from actioncli.report.contributions import Explained, attention, contributions, short
from actioncli.report.figure import figure
from actioncli.report.page import page, playable, player, scrolling

# Actions beside the query, and rows of the ranking.
SHOWN = 3
_RANKED = 10


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
    try:
        with replacing(path) as part:
            part.write_text(page(title, body, figures), encoding="utf-8")
    except OSError as error:
        raise UsageError(f"{path}: cannot be written: {error.strerror}.") from error


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
    yield contributions(case)
    yield "<h2>What was compared with what</h2>"
    yield attention(case, f"{example.label}: {example.name}")
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
            f"<td>{each.probability:.2f}</td><td>{short(each.distance)}</td></tr>"
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
