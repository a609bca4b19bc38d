"""A report's folder: a page, and what its plots show as tables for spreadsheets and programs."""

from __future__ import annotations

import csv
import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from actioncli.errors import UsageError
from actioncli.evaluation.acceptance import Acceptance
from actioncli.evaluation.confusions import Confusion
from actioncli.evaluation.curves import Pool, curves, histogram
from actioncli.evaluation.result import CLASSES_FOR_MEAN, METRICS, Answers, Evaluation, Result
from actioncli.files import json_text, replacing

Row = dict[str, Any]

# The page of a report; `figures.json` also marks a folder as one.
PAGE, FIGURES = "index.html", "figures.json"

# Some spreadsheets read the signs of full width like the others.
_FORMULA = frozenset("=+-@\t\r\n＝＋－＠")


def check_folder(folder: Path) -> None:
    """Find out whether a report could be written there, before any work.

    Raises:
        UsageError: it is no folder, or one that holds something else.
    """
    if folder.exists() and not folder.is_dir():
        raise UsageError(f"{folder}: a report is a folder; this is a file.")
    if folder.is_dir() and any(folder.iterdir()) and not (folder / FIGURES).is_file():
        raise UsageError(f"{folder}: holds something else; give a new folder for the report.")


def write_folder(
    folder: Path,
    page: str,
    document: Mapping[str, Any],
    rows: Mapping[str, Sequence[Mapping[str, Any]]],
) -> Path:
    """Write a report, over an earlier one if there is one; the page's path.

    Args:
        folder: made if it is not there.
        page: HTML.
        document: becomes `figures.json`; its numbers as `json_text` has them.
        rows: for each name the rows of a CSV file.

    Raises:
        UsageError: as `check_folder`, or the files cannot be written.
    """
    check_folder(folder)
    text = json_text(document, indent=1)
    try:
        folder.mkdir(parents=True, exist_ok=True)
        # The folder may be shared: what lies there under these names is replaced, links too.
        with replacing(folder / FIGURES) as part:
            part.write_text(f"{text}\n", encoding="utf-8")
        for name, lines in rows.items():
            with replacing(folder / f"{name}.csv") as part:
                write_csv(part, lines)
        with replacing(folder / PAGE) as part:
            part.write_text(page, encoding="utf-8")
    except OSError as error:
        where = error.filename or folder
        raise UsageError(f"{where}: cannot be written: {error.strerror or error}.") from error
    return folder / PAGE


def shown_results(found: Evaluation) -> Sequence[Result]:
    """One result for each number of ways: means over collections, or those of the only one.

    Numbers of ways that come down to the same one for lack of classes are one.
    """
    distinct = {enrolled(result): result for result in reversed(found.means or found.results)}
    return [distinct[ways] for ways in sorted(distinct)]


def enrolled(result: Result) -> int:
    """How many actions were enrolled; how many should be, where that differs in a mean."""
    return result.ways_used or result.ways


def answers_behind(found: Evaluation, shown: Result) -> list[Answers]:
    """The answers that a mean, or a single result, was made of."""
    return [
        result.answers
        for result in found.results
        if result.answers is not None
        and result.ways == shown.ways
        and (result is shown or (bool(found.means) and result.classes >= CLASSES_FOR_MEAN))
    ]


def figure_rows(evaluations: Sequence[Evaluation]) -> list[Row]:
    """Every metric of every result."""
    return [
        {
            "scorer": found.scorer,
            "collection": result.collection,
            "ways": result.ways,
            "ways_used": result.ways_used,
            "metric": metric,
            "mean": result[metric].mean,
            "std": result[metric].std,
        }
        for found in evaluations
        for result in (*found.results, *found.means)
        for metric in METRICS
    ]


def curve_rows(evaluations: Sequence[Evaluation]) -> list[Row]:
    """ROC and OSCR; `tau` of the first point, which accepts nothing, is empty."""
    rows = []
    for found in evaluations:
        for shown in shown_results(found):
            drawn = curves(Pool.of(answers_behind(found, shown)))
            rows += [
                {
                    "scorer": found.scorer,
                    "collection": shown.collection,
                    "ways": enrolled(shown),
                    "tau": float(tau) if math.isfinite(tau) else None,
                    "false_accepts": float(false),
                    "accepted": float(accepted),
                    "named": float(named),
                }
                for tau, false, accepted, named in zip(
                    drawn.tau, drawn.false_accepts, drawn.accepted, drawn.named, strict=True
                )
            ]
    return rows


def score_rows(evaluations: Sequence[Evaluation]) -> list[Row]:
    """Histograms of confidence, of known and of unknown queries."""
    rows = []
    for found in evaluations:
        for shown in shown_results(found):
            edges, known, unknown = histogram(Pool.of(answers_behind(found, shown)))
            rows += [
                {
                    "scorer": found.scorer,
                    "collection": shown.collection,
                    "ways": enrolled(shown),
                    "from": float(edges[b]),
                    "to": float(edges[b + 1]),
                    "known": float(known[b]),
                    "unknown": float(unknown[b]),
                }
                for b in range(len(known))
            ]
    return rows


def calibration_rows(evaluations: Sequence[Evaluation]) -> list[Row]:
    """How often queries of a confidence are right."""
    return [
        {
            "scorer": found.scorer,
            "collection": shown.collection,
            "ways": enrolled(shown),
            **filled,
        }
        for found in evaluations
        for shown in shown_results(found)
        for filled in shown.as_json()["reliability"]
    ]


def acceptance_rows(tables: Sequence[Acceptance]) -> list[Row]:
    """Cells of the acceptance matrices; `rate` is empty where nothing was asked."""
    return [
        {
            "collection": each.collection,
            "enrolled": enrolled,
            "shown": shown,
            "rate": float(each.rate[i, j]) if each.asked[i, j] else None,
            "asked": int(each.asked[i, j]),
        }
        for each in tables
        for i, enrolled in enumerate(each.classes)
        for j, shown in enumerate(each.classes)
    ]


def confusion_rows(worst: Sequence[Confusion]) -> list[Row]:
    """The worst confusions."""
    return [
        {
            "collection": each.collection,
            "shown": each.shown,
            "taken_for": each.taken_for,
            "times": each.times,
            "asked": each.asked,
            "confidence": each.confidence,
        }
        for each in worst
    ]


def write_csv(path: Path, rows: Sequence[Mapping[str, Any]]) -> None:
    """Write rows of equal keys under a header; nothing but an empty file where there are none.

    Raises:
        OSError: the file cannot be written.
    """
    with path.open("w", encoding="utf-8", errors="backslashreplace", newline="") as file:
        if rows:
            writer = csv.DictWriter(file, list(rows[0]))
            writer.writeheader()
            writer.writerows({key: _cell(value) for key, value in row.items()} for row in rows)


def _cell(value: object) -> object:
    if isinstance(value, float):
        return f"{value:.6g}"
    # A spreadsheet takes what begins like this for a formula; labels come from anywhere.
    if isinstance(value, str) and value[:1] in _FORMULA:
        return f"'{value}"
    return value
