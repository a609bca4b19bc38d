"""The report of a calibration."""

import csv
import json
from pathlib import Path

import numpy as np
import pytest
from playwright.sync_api import Browser

from actioncli import SupportStore, UsageError, read_clip
from actioncli.calibration.threshold import Calibration
from actioncli.calibration.trials import Trials
from actioncli.report.calibration import write_calibration
from tests.browsing import DESKTOP, PHONE, accessible, ask

EXAMPLES = Path(__file__).parents[2] / "examples"
NOTHING = {"count": 0, "of": 0, "motions": 0, "rate": None, "low": 0.0, "high": 1.0}
SOME = {"count": 1, "of": 4, "motions": 4, "rate": 0.25, "low": 0.05, "high": 0.7}
DOCUMENT = {
    "tau": 0.6, "measured": True, "kept": True, "target_far": 0.05, "weights": "abc",
    "table": [{"tau": 0.6, "false_accepts": SOME, "false_rejects": NOTHING, "misnamed": NOTHING}],
    "unknown": [{"kind": "cohort", "false_accepts": SOME}],
    "actions": [{"label": "<i>bow", "examples": 1, "tau": 0.6, "false_accepts": SOME,
                 "false_rejects": NOTHING}],
    "notes": ["<few> clips"], "failed": 0,
}  # fmt: skip


def trials(*scores: float) -> Trials:
    numbers, kinds = np.arange(len(scores)), np.full(len(scores), "cohort")
    return Trials(
        ("<i>bow",),
        (1,),
        kinds,
        np.array(scores, float),
        0 * numbers,
        0 * numbers - 1,
        numbers,
        numbers < 0,
    )


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    found = Calibration(trials(0.1, 0.3, 0.5, 0.9), 0.05, 0.6, True, {}, ("<few> clips",))
    target = tmp_path / "report"
    assert write_calibration(target, found, "tau 0.6: kept", DOCUMENT).is_file()
    return target


def test_page_tables_and_figures(folder: Path) -> None:
    text = (folder / "index.html").read_text(encoding="utf-8")
    assert "tau 0.6: kept" in text
    assert "0.6 (recommended)" in text
    assert "1 of 4: 25% (5% to 70%)" in text
    assert "False rejects could not be asked" in text
    assert "<i>" not in text
    assert "<few>" not in text
    assert json.loads((folder / "figures.json").read_text()) == DOCUMENT
    with (folder / "scores.csv").open(newline="") as file:
        scores = list(csv.DictReader(file))
    assert [float(row["confidence"]) for row in scores] == [0.1, 0.3, 0.5, 0.9]
    with (folder / "rates.csv").open(newline="") as file:
        [row] = csv.DictReader(file)
    assert (row["false_accepts_count"], row["false_rejects_rate"]) == ("1", "")


def test_the_page_is_for_everyone(browser: Browser, folder: Path) -> None:
    accessible(browser, folder / "index.html")


@pytest.mark.parametrize(("size", "wide"), [(DESKTOP, [False] * 3), (PHONE, [True, False, True])])
def test_a_table_that_is_wider_than_the_page_says_so(
    browser: Browser, folder: Path, size: tuple[int, int], wide: list[bool]
) -> None:
    script = """await until(() => document.querySelectorAll(".sideways").length === 3);
        return [...document.querySelectorAll(".sideways")].map((e) => e.checkVisibility());"""
    assert ask(browser, folder / "index.html", script, size) == wide


def test_it_does_not_write_over_something_else(folder: Path, tmp_path: Path) -> None:
    (tmp_path / "mine").mkdir()
    (tmp_path / "mine" / "index.html").touch()
    with pytest.raises(UsageError, match="holds something else"):
        write_calibration(tmp_path / "mine", Calibration(trials(), 0.05), "", DOCUMENT)


def test_the_command_writes_it(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    from typer.testing import CliRunner

    from actioncli.cli.app import app

    store = SupportStore(tmp_path / "support.db")
    for name in ("squat/ada", "squat/ben", "bow/ben"):
        store.enroll(name.partition("/")[0], read_clip(EXAMPLES / f"{name}.npz"))
    words = ["calibrate", "--store", str(store.path), "--report", str(tmp_path / "report")]
    result = CliRunner().invoke(app, [*words, "--json"])
    assert result.exit_code == 0, result.stderr
    printed = json.loads(result.stdout)
    assert json.loads((tmp_path / "report" / "figures.json").read_text()) == printed
    assert CliRunner().invoke(app, [*words, "--reset"]).exit_code == 2
