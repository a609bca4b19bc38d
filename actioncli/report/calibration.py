"""The report of a calibration: what each threshold would do to the user's own clips."""

from __future__ import annotations

import csv
from collections.abc import Iterator, Mapping, Sequence
from html import escape
from pathlib import Path
from typing import Any

import numpy as np

from actioncli.calibration.threshold import Calibration
from actioncli.calibration.trials import KNOWN, Trials
from actioncli.errors import UsageError
from actioncli.files import csv_cell, json_text, replacing
from actioncli.report.page import page, table
from actioncli.report.plots import SHARES, Axis, Plot, fitting

Row = dict[str, Any]

# The page of a report; `figures.json` also marks a folder as one.
PAGE, FIGURES = "index.html", "figures.json"

_GRID = np.linspace(0, 1, 101)
_BINS = np.linspace(0, 1, 21)


def write_calibration(
    folder: Path,
    found: Calibration,
    outcome: str,
    document: Mapping[str, Any],
) -> Path:
    """Write the report, over an earlier one if there is one; the page's path.

    Args:
        folder: new, empty, or an earlier report.
        found: the threshold, and the trials behind it.
        outcome: the same in words.
        document: as `calibrate --json` has it.

    Raises:
        UsageError: the folder holds something else, or cannot be written.
    """
    body = "\n".join(_sections(found, outcome, document))
    rows = {
        "rates": [{"tau": line["tau"], **_flat(line)} for line in document["table"]],
        "unknown": [{"kind": line["kind"], **_flat(line)} for line in document["unknown"]],
        "actions": [
            {key: line[key] for key in ("label", "examples", "tau")} | _flat(line)
            for line in document["actions"]
        ],
        "scores": _scores(found.trials),
    }
    return write_folder(folder, page("Calibration", body), document, rows)


def _sections(found: Calibration, outcome: str, document: Mapping[str, Any]) -> Iterator[str]:
    yield "<h1>Calibration</h1>"
    yield f'<p class="verdict{" yes" if found.measured else ""}">{escape(outcome)}.</p>'
    yield (
        "<p>Every clip was answered as <code>classify</code> would answer it: enrolled examples "
        "against the support set without them, and motions that show none of the actions. The "
        f"wanted rate of false accepts is {document['target_far']:g}.</p>"
    )
    yield "<h2>What each threshold would do</h2>"
    yield f'<div class="plots">{_rates(found)}{_histogram(found)}</div>'
    if document["notes"]:
        lines = "".join(f"<li>{escape(note)}</li>" for note in document["notes"])
        yield f"<h2>What the figures cannot tell</h2><ul>{lines}</ul>"
    yield "<h2>Over the threshold</h2>"
    yield table(
        "Rates with their 95 % intervals",
        ("τ", "false accepts", "false rejects", "misnamed"),
        [
            (
                f"{line['tau']:g}{' (recommended)' if _is_recommended(line, found) else ''}",
                *(_cell(line[key]) for key in ("false_accepts", "false_rejects", "misnamed")),
            )
            for line in document["table"]
        ],
    )
    yield "<h2>By kind and by action</h2>"
    yield table(
        "Motions that show none of the actions: your examples put to the other actions, your "
        "negatives, and other people’s motions (cohort)",
        ("kind", "false accepts"),
        [(line["kind"], _cell(line["false_accepts"])) for line in document["unknown"]],
    )
    yield table(
        "Actions, each at its threshold",
        ("action", "examples", "τ", "false accepts", "false rejects"),
        [
            (
                line["label"],
                str(line["examples"]),
                f"{line['tau']:g}",
                _cell(line["false_accepts"]),
                _cell(line["false_rejects"]),
            )
            for line in document["actions"]
        ],
    )


def _rates(found: Calibration) -> str:
    trials = found.trials
    plot = Plot(
        "False accepts and false rejects over τ",
        Axis("threshold τ", 0, 1, SHARES),
        Axis("share of the clips", 0, 1, SHARES, percent=True),
    )
    measured = (
        (1, "false accepts", [trials.false_accepts(float(tau)) for tau in _GRID]),
        (0, "false rejects", [trials.false_rejects(float(tau)) for tau in _GRID]),
    )
    for series, name, rates in measured:
        if not rates[0].of:
            continue
        low, high = zip(*(rate.interval for rate in rates), strict=True)
        plot.band(_GRID, low, high, series)
        plot.line(_GRID, [rate.rate for rate in rates], series, name)
    plot.rule(found.tau, f"τ {found.tau:g}")
    unasked = "" if (trials.kind == KNOWN).any() else " False rejects could not be asked."
    return plot.html(f"Bands: 95 % intervals (Wilson).{unasked}")


def _histogram(found: Calibration) -> str:
    trials = found.trials
    shares = []
    for asked in (trials.kind != KNOWN, trials.kind == KNOWN):
        counted, _ = np.histogram(trials.score[asked], _BINS)
        shares.append(counted / max(asked.sum(), 1))
    top = max(float(share.max()) for share in shares)
    plot = Plot(
        "Confidence of the nearest action",
        Axis("confidence", 0, 1, SHARES),
        fitting("share of the clips", 0, top, percent=True),
    )
    plot.steps(_BINS, shares[0], 1, "motions that show no enrolled action")
    plot.steps(_BINS, shares[1], 0, "enrolled examples")
    plot.rule(found.tau, f"τ {found.tau:g}")
    return plot.html("What stands right of τ is accepted.")


def _scores(trials: Trials) -> list[Row]:
    return [
        {"kind": str(kind), "nearest": trials.labels[nearest], "confidence": float(score)}
        for kind, nearest, score in zip(trials.kind, trials.nearest, trials.score, strict=True)
    ]


def _flat(line: Mapping[str, Any]) -> Row:
    """A row's rates as columns."""
    return {
        f"{name}_{key}": value
        for name, rate in line.items()
        if isinstance(rate, dict)
        for key, value in rate.items()
    }


def _cell(rate: Mapping[str, Any]) -> str:
    if not rate["of"]:
        return "none asked"
    return (
        f"{rate['count']} of {rate['of']}: {rate['rate']:.0%} ({rate['low']:.0%} to "
        f"{rate['high']:.0%})"
    )


def _is_recommended(line: Mapping[str, Any], found: Calibration) -> bool:
    return found.measured and bool(np.isclose(line["tau"], found.tau))


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
    html: str,
    document: Mapping[str, Any],
    rows: Mapping[str, Sequence[Mapping[str, Any]]],
) -> Path:
    """Write a page, `figures.json` and, by name, the rows of CSV files; the page's path.

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
            part.write_text(html, encoding="utf-8")
    except OSError as error:
        where = error.filename or folder
        raise UsageError(f"{where}: cannot be written: {error.strerror or error}.") from error
    return folder / PAGE


def write_csv(path: Path, rows: Sequence[Mapping[str, Any]]) -> None:
    """Write rows of equal keys under a header; nothing but an empty file where there are none.

    Raises:
        OSError: the file cannot be written.
    """
    with path.open("w", encoding="utf-8", errors="backslashreplace", newline="") as file:
        if rows:
            writer = csv.DictWriter(file, list(rows[0]))
            writer.writeheader()
            writer.writerows({key: csv_cell(value) for key, value in row.items()} for row in rows)
