"""A report's folder: a page, and what its plots show as tables for spreadsheets and programs."""

from __future__ import annotations

import csv
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from actioncli.errors import UsageError
from actioncli.files import csv_cell, json_text, replacing

Row = dict[str, Any]

# The page of a report; `figures.json` also marks a folder as one.
PAGE, FIGURES = "index.html", "figures.json"

# Some spreadsheets read the signs of full width like the others.


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
