"""The report of an evaluation: one page to look at, and its figures as CSV and JSON."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from html import escape
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from actioncli.evaluation.acceptance import Acceptance
from actioncli.evaluation.confusions import Confusion, worst_confusions
from actioncli.evaluation.curves import Pool, curves, histogram
from actioncli.evaluation.result import Evaluation
from actioncli.report import figures as tables
from actioncli.report.figure import figure
from actioncli.report.page import Stage, page, playable, scrolling, table
from actioncli.report.plots import SHARES, Axis, Plot

if TYPE_CHECKING:
    from actioncli.clips.collection import Collection

_TABLE_METRICS = {
    "fsos_accuracy": "FSOS-ACC",
    "closed_set_accuracy": "closed set",
    "auroc": "AUROC",
    "oscr": "OSCR",
    "fpr_at_95_tpr": "FPR95",
    "false_accept_rate": "false accepts",
    "false_reject_rate": "false rejects",
}


@dataclass(frozen=True, slots=True)
class Report:
    """What a report tells.

    Attributes:
        found: what was measured, the model or the first baseline first, on equal episodes.
        acceptance: matrices of the first.
        collections: whose clips may be shown.
        document: the figures as `evaluate --json` has them.
    """

    found: Sequence[Evaluation]
    acceptance: Sequence[Acceptance]
    collections: Sequence[Collection]
    document: Mapping[str, Any]


def write_report(folder: Path, report: Report) -> Path:
    """Write the report, over an earlier one if there is one; the page's path.

    Raises:
        UsageError: as `tables.write_folder`.
    """
    worst = _confusions(report)
    rows = {
        "figures": tables.figure_rows(report.found),
        "curves": tables.curve_rows(report.found),
        "scores": tables.score_rows(report.found),
        "calibration": tables.calibration_rows(report.found),
        "acceptance": tables.acceptance_rows(report.acceptance),
        "confusions": tables.confusion_rows(worst),
    }
    more = {name: rows[name] for name in ("curves", "scores", "confusions")}
    stage = Stage()
    body = "\n".join(_sections(report, worst, stage))
    whole = page(f"Evaluation of {report.found[0].scorer}", body, stage.figures)
    return tables.write_folder(folder, whole, {**report.document, **more}, rows)


def _confusions(report: Report) -> list[Confusion]:
    """Of the first scorer, with as many actions enrolled as in the plots."""
    first = report.found[0]
    ways = tables.shown_results(first)[0].ways
    labels = {collection.name: collection.labels for collection in report.collections}
    answers = {
        result.collection: result.answers
        for result in first.results
        if result.ways == ways and result.answers is not None and result.collection in labels
    }
    return worst_confusions(answers, labels, first.tau)


def _sections(report: Report, worst: Sequence[Confusion], stage: Stage) -> Iterator[str]:
    first = report.found[0]
    several = len({result.collection for result in first.results}) > 1
    over = "mean over collections" if first.means and several else first.results[0].collection
    ways = tables.enrolled(tables.shown_results(first)[0])
    yield f"<h1>Evaluation of {escape(first.scorer)}</h1>"
    checksum = report.document.get("weights")
    yield (
        f'<p class="muted">Protocol {escape(first.protocol)}, {first.shots} clip'
        f"{'s' if first.shots > 1 else ''} per enrolled action, {first.episodes} episodes, τ "
        f"{first.tau:g}, seed {first.seed}"
        f"{f', weights {escape(str(checksum)[:12])}' if checksum else ''}. Figures are mean ± "
        f"standard deviation over episodes ({escape(over)}). Plots for one number of ways show "
        f"{ways}-way episodes, each collection with the same weight.</p>"
    )
    yield "<h2>Known named, unknown rejected</h2>"
    yield f'<div class="plots">{_accuracy(report.found)}{_histogram(first)}</div>'
    yield _figures(report.found)
    yield "<h2>Over all thresholds</h2>"
    yield f'<div class="plots">{_curve(report.found, "oscr")}{_curve(report.found, "roc")}</div>'
    yield "<h2>Can the confidence be taken at its word?</h2>"
    yield f'<div class="plots">{_calibration(first)}</div>'
    yield "<h2>The worst confusions</h2>"
    yield _worst(report, worst, stage)
    if report.acceptance:
        yield "<h2>Who accepts what</h2>"
        yield (
            "<p>Each row enrols one action alone and is asked clips of all: the share of them, in "
            "per cent, that it accepts. A perfect recogniser has 100 in the framed cells and 0 in "
            "all others.</p>"
        )
        yield from map(_matrix, report.acceptance)
    if several:
        yield "<h2>Each collection</h2>"
        yield _each_collection(report.found)
    if first.skipped:
        reasons = "".join(f"<li>{escape(skip.reason)}</li>" for skip in first.skipped)
        yield f"<h2>Left out</h2><ul>{reasons}</ul>"


def _accuracy(found: Sequence[Evaluation]) -> str:
    """The paper's figure: FSOS-ACC over the number of enrolled actions."""
    shown = tables.shown_results(found[0])
    ways = [tables.enrolled(result) for result in shown]
    low, high = min(ways), max(ways)
    axis = Axis("enrolled actions K", low - 0.5, high + 0.5, tuple(ways))
    plot = Plot("FSOS-ACC over the number of enrolled actions", axis, _shares("FSOS-ACC"))
    if not any(each.scorer == "always-reject" for each in found):
        rejecting = [result["always_reject_fsos_accuracy"].mean for result in shown]
        plot.line(ways, rejecting, len(found), "rejecting everything")
    # The first one is drawn last, over the others.
    for series, each in reversed(list(enumerate(found))):
        results = tables.shown_results(each)
        mean = np.array([result["fsos_accuracy"].mean for result in results])
        std = np.array([result["fsos_accuracy"].std for result in results])
        plot.band(ways, mean - std, mean + std, series)
        plot.line(ways, mean, series, each.scorer, dots=True)
    return plot.html("Bands: one standard deviation over episodes.")


def _histogram(first: Evaluation) -> str:
    shown = tables.shown_results(first)[0]
    edges, known, unknown = histogram(Pool.of(tables.answers_behind(first, shown)))
    highest = max(float(known.max()), float(unknown.max()))
    step = 0.2 if highest > 0.5 else 0.1
    ticks = tuple(np.arange(0, highest + step, step).round(1).tolist())
    plot = Plot(
        f"Confidence of {first.scorer}, {tables.enrolled(shown)}-way",
        Axis("confidence of the nearest action", 0, 1, SHARES),
        Axis("share of the queries", 0, ticks[-1], ticks, percent=True),
    )
    plot.steps(edges, unknown, 1, "unknown queries")
    plot.steps(edges, known, 0, "known queries")
    plot.rule(first.tau, f"τ {first.tau:g}")
    return plot.html("What stands right of τ is accepted.")


def _curve(found: Sequence[Evaluation], kind: str) -> str:
    ways = tables.enrolled(tables.shown_results(found[0])[0])
    title, up = {
        "oscr": (f"OSCR, {ways}-way", "known queries accepted under the right label"),
        "roc": (f"ROC, {ways}-way", "known queries accepted, whatever the label"),
    }[kind]
    x = Axis("unknown queries accepted", 0, 1, SHARES, percent=True)
    plot = Plot(title, x, _shares(up))
    for series, each in reversed(list(enumerate(found))):
        shown = tables.shown_results(each)[0]
        drawn = curves(Pool.of(tables.answers_behind(each, shown)))
        ys = drawn.named if kind == "oscr" else drawn.accepted
        plot.line(drawn.false_accepts, ys, series, each.scorer)
    return plot.html("The nearer to the upper left corner, the better.")


def _calibration(first: Evaluation) -> str:
    shown = tables.shown_results(first)[0]
    bins = shown.as_json()["reliability"]
    x = Axis("confidence", 0, 1, SHARES)
    plot = Plot(
        f"Calibration of {first.scorer}, {tables.enrolled(shown)}-way", x, _shares("queries right")
    )
    plot.diagonal("confidence that is right as often as it says")
    xs, ys = [each["confidence"] for each in bins], [each["accuracy"] for each in bins]
    plot.line(xs, ys, 0, first.scorer)
    plot.dots(xs, ys, [each["share"] for each in bins], 0)
    return plot.html(
        f"Expected calibration error {shown.reliability.ece:.3f}. Right means that the query "
        "shows the nearest action; dots are as large as the share of queries; on the dotted line "
        "confidence is right as often as it says."
    )


def _figures(found: Sequence[Evaluation]) -> str:
    rows = []
    for each in found:
        for shown in tables.shown_results(each):
            cells = [f"{shown[m].mean:.3f} ± {shown[m].std:.3f}" for m in _TABLE_METRICS]
            reject = f"{shown['always_reject_fsos_accuracy'].mean:.3f}"
            rows.append([each.scorer, str(tables.enrolled(shown)), reject, *cells])
    header = ["scorer", "ways", "rejecting all", *_TABLE_METRICS.values()]
    return table("Figures, mean ± standard deviation over episodes", header, rows)


def _each_collection(found: Sequence[Evaluation]) -> str:
    rows = [
        [
            result.collection,
            each.scorer,
            str(result.ways)
            + (f" ({result.ways_used})" if result.ways_used != result.ways else ""),
            *(f"{result[m].mean:.3f}" for m in _TABLE_METRICS),
        ]
        for each in found
        for result in each.results
    ]
    rows.sort(key=lambda row: row[0])
    header = ["collection", "scorer", "ways", *_TABLE_METRICS.values()]
    caption = "Means over episodes; in brackets the ways used where classes are too few"
    return table(caption, header, rows, text_columns=2)


def _matrix(found: Acceptance) -> str:
    heads = "".join(f'<th scope="col"><span>{escape(label)}</span></th>' for label in found.classes)
    lines = []
    for i, label in enumerate(found.classes):
        cells = []
        for j in range(len(found.classes)):
            own = ' class="own"' if i == j else ""
            if not found.asked[i, j]:
                cells.append(f"<td{own}></td>")
                continue
            share = round(100 * float(found.rate[i, j]))
            ground = f"color-mix(in srgb, var(--cell) {share}%, var(--panel))"
            cells.append(f'<td{own} style="background:{ground}">{share}</td>')
        lines.append(f'<tr><th scope="row">{escape(label)}</th>{"".join(cells)}</tr>')
    name = f"Acceptance, {found.collection}"
    return f"<h3>{escape(found.collection)}</h3>" + scrolling(
        name,
        f'<table class="matrix"><thead><tr><td></td>{heads}</tr></thead>'
        f"<tbody>{''.join(lines)}</tbody></table>",
    )


def _worst(report: Report, worst: Sequence[Confusion], stage: Stage) -> str:
    if not worst:
        return "<p>No query was accepted under a wrong label, or the clips were not kept.</p>"
    clips = {collection.name: collection.clips for collection in report.collections}
    told = []
    for place, each in enumerate(worst, 1):
        name = f"{each.shown} taken for {each.taken_for}"
        shown = [
            (
                f"<b>{escape(label)}</b>{what}: {escape(Path(clip.source).name)}",
                playable(figure(clip)),
            )
            for label, what, clip in (
                (each.shown, "asked", clips[each.collection][each.query]),
                (each.taken_for, "enrolled", clips[each.collection][each.example]),
            )
        ]
        told.append(
            f"<div><h3>{place}. {escape(name)}</h3><p>{escape(each.collection)}: {each.times} of "
            f"{each.asked} clips of {escape(each.shown)} were accepted as "
            f"{escape(each.taken_for)}, the one shown with confidence {each.confidence:.2f}.</p>"
            f"{stage.player(name, shown)}</div>"
        )
    return f'<div class="pairs">{"".join(told)}</div>'


def _shares(label: str) -> Axis:
    return Axis(label, 0, 1, SHARES, percent=True)
