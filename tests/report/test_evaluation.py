"""The report of an evaluation."""

import csv
import json
from pathlib import Path

import numpy as np
import pytest

from actioncli import Clip, Collection, UsageError
from actioncli.clips.layouts import DEFAULT_JOINTS
from actioncli.clips.prepare import Preparation
from actioncli.evaluation.acceptance import acceptance
from actioncli.evaluation.baselines import AlwaysReject, Dtw
from actioncli.evaluation.protocol import evaluate
from actioncli.report.evaluation import Report, write_report
from actioncli.report.figures import check_folder, write_csv

from .browser import accessible, ask, needs_chromium
from .test_figure import standing

LABELS = ["<i>nod", "b", "c", "d", "e", "f"]


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A report on a made-up collection, some of whose classes look alike."""
    rng = np.random.default_rng(0)
    clips, labels, people = [], [], []
    for kind, label in enumerate(LABELS):
        swing = np.random.default_rng(kind // 2).normal(0, 0.2, (15, 3))
        for person in range(4):
            for _ in range(3):
                wave = np.sin(np.linspace(0, 3, 20))[:, None, None]
                joints = standing(20) + swing * wave + rng.normal(0, 0.02, (20, 15, 3))
                clips.append(Clip(joints, DEFAULT_JOINTS, source="toys.npz"))
                labels.append(label)
                people.append(f"p{person}")
    toys = Collection(tuple(clips), tuple(labels), tuple(people), "toys")
    scorers = [Dtw(Preparation()), AlwaysReject()]
    found = [evaluate(scorer, [toys], ways=(2, 4, 9), episodes=6) for scorer in scorers]
    tables = acceptance(scorers[0], [toys], episodes=3)
    target = tmp_path_factory.mktemp("report") / "new"
    document = {**found[0].as_json(), "weights": "abc", "others": []}
    page = write_report(target, Report(found, tables, [toys], document))
    assert page == target / "index.html"
    return target


def rows(folder: Path, name: str) -> list[dict[str, str]]:
    with (folder / f"{name}.csv").open(encoding="utf-8", newline="") as file:
        return list(csv.DictReader(file))


def test_figures_are_there_as_csv_and_json(folder: Path) -> None:
    figures = rows(folder, "figures")
    document = json.loads((folder / "figures.json").read_text())
    of_json = document["results"][0]["metrics"]["fsos_accuracy"]["mean"]
    [of_csv] = [
        row["mean"]
        for row in figures
        if (row["scorer"], row["collection"], row["ways"], row["metric"])
        == ("dtw", "toys", "2", "fsos_accuracy")
    ]
    assert float(of_csv) == pytest.approx(of_json, rel=1e-4)
    assert {row["ways"] for row in rows(folder, "curves")} == {"2", "4"}
    scores = rows(folder, "scores")
    assert {row["scorer"] for row in scores} == {"dtw", "always-reject"}
    assert sum(float(row["known"]) for row in scores) == pytest.approx(4, abs=1e-3)
    assert {row["enrolled"] for row in rows(folder, "acceptance")} == set(LABELS)
    assert len(document["confusions"]) == len(rows(folder, "confusions")) > 0
    assert rows(folder, "calibration")


def test_the_page_shows_all_of_it_and_escapes_labels(folder: Path) -> None:
    text = (folder / "index.html").read_text(encoding="utf-8")
    for part in ("FSOS-ACC over", "OSCR, 2-way", "ROC, 2-way", "Calibration of dtw",
                 "Confidence of dtw", "worst confusions", "Who accepts what"):  # fmt: skip
        assert part in text
    assert "<i>" not in text
    assert "&lt;i&gt;nod" in text
    assert ">NaN<" not in text
    assert "nan%" not in text


@needs_chromium
def test_the_page_works_in_a_browser(folder: Path) -> None:
    got = ask(
        folder / "index.html",
        """
        const play = document.querySelector(".play"), scrub = document.querySelector(".scrub");
        play.click(); await wait(300);
        const wide = document.documentElement.scrollWidth - innerWidth;
        return { moment: Number(scrub.value), players: document.querySelectorAll(".player").length,
          others: [...document.querySelectorAll(".scrub")].slice(1).every((e) => e.value === "0"),
          wide, plots: document.querySelectorAll("figure > svg").length };
        """,
        width=500,
    )
    assert got["moment"] > 0
    assert got["others"]
    assert got["players"] == len(rows(folder, "confusions"))
    assert got["plots"] == 5
    assert got["wide"] <= 0


@needs_chromium
def test_the_page_is_for_everyone(folder: Path) -> None:
    accessible(folder / "index.html")


def test_only_a_report_is_written_over(folder: Path, tmp_path: Path) -> None:
    check_folder(folder)
    check_folder(tmp_path)
    (tmp_path / "index.html").write_text("somebody's page")
    with pytest.raises(UsageError, match="holds something else"):
        check_folder(tmp_path)
    with pytest.raises(UsageError, match="this is a file"):
        check_folder(tmp_path / "index.html")


def test_formulas_in_labels_stay_text(tmp_path: Path) -> None:
    write_csv(tmp_path / "a.csv", [{"label": "=HYPERLINK(1)", "rate": None, "n": 0.5}])
    assert (tmp_path / "a.csv").read_text().splitlines()[1] == "'=HYPERLINK(1),,0.5"
