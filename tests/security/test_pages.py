"""Pages and tables of reports: labels and names in them stay text."""

import csv
import json
from collections.abc import Iterator
from html.parser import HTMLParser
from pathlib import Path

import numpy as np
import pytest
from playwright.sync_api import Browser

from actioncli import SupportStore, read_clip
from actioncli.clips.skeleton import DEFAULT_JOINTS
from actioncli.report.calibration import write_csv
from tests.browsing import ask

from .conftest import EXAMPLES, invoke

EVIL = [
    "</script><script>window.pwned=1</script>",
    "\"><img src=x onerror='window.pwned=1'>",
    "' onmouseover='window.pwned=1",
    "</title><svg onload=window.pwned=1>",
    "<!--<script>",
    "{{7*7}} ${7*7} javascript:window.pwned=1",
]


class Elements(HTMLParser):
    """The scripts of a page, and every attribute that could run or load something."""

    def __init__(self, page: str) -> None:
        super().__init__()
        self.scripts = 0
        self.running: list[str] = []
        self.feed(page)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.scripts += tag == "script"
        self.running += [
            f"{tag} {name}={value}"
            for name, value in attrs
            if name.startswith("on")
            or (name in ("src", "href", "srcset", "data", "action") and (value or "#")[0] != "#")
        ]
        if tag in ("img", "iframe", "object", "embed", "link", "base", "form"):
            self.running.append(tag)


@pytest.fixture
def hostile(store: SupportStore, tmp_path: Path) -> Path:
    """A support set with hostile labels and names of joints; a query with a hostile name."""
    for number, label in enumerate(EVIL):
        name = ("wave_right/cleo", "squat/ada", "bow/ben", "jumping_jack/ada", "kick_right/ada",
                "punch_right/dev")[number]  # fmt: skip
        store.enroll(label[:100], read_clip(EXAMPLES / f"{name}.npz"), note=EVIL[-number])
    clip = read_clip(EXAMPLES / "wave_right" / "ada.npz")
    extra = np.concatenate([clip.joints, clip.joints[:, :1]], axis=1)
    query = tmp_path / "<img src=x onerror=window.pwned=1>.npz"
    names = [*clip.joint_names, EVIL[0]]
    np.savez(query, joints=extra, joint_names=names, fps=clip.fps, unit="m", up="y")
    return query


def pages(hostile: Path, folder: Path) -> Iterator[Path]:
    invoke("classify", hostile, "--explain", folder / "why.html")
    yield folder / "why.html"
    invoke("calibrate", "--report", folder / "calibrated")
    yield folder / "calibrated" / "index.html"


def test_no_label_runs_in_a_page(browser: Browser, hostile: Path, tmp_path: Path) -> None:
    for page in pages(hostile, tmp_path):
        text = page.read_text(encoding="utf-8")
        assert "window.pwned=1" in text
        found = Elements(text)
        assert found.running == []
        # The hint at wide tables, the figures, the player: none of them came from a label.
        assert found.scripts <= 3
        assert "default-src 'none'" in text
        assert ask(browser, page, "await wait(100); return window.pwned ?? null;") is None


@pytest.mark.parametrize(
    "label",
    ["=1+1", "+1", "-1", "@SUM(A1)", "\t=1", "\r=1", "\n=1", "＝1", "=HYPERLINK(\"http://a\",\"b\")"],
)  # fmt: skip
def test_no_cell_is_a_formula(tmp_path: Path, label: str) -> None:
    write_csv(tmp_path / "a.csv", [{"label": label, "value": -1.5}])
    with (tmp_path / "a.csv").open(encoding="utf-8", newline="") as file:
        [row] = csv.DictReader(file)
    assert row["label"] == f"'{label}"
    assert float(row["value"]) == -1.5


def test_a_label_cannot_end_the_data_of_a_page() -> None:
    from actioncli.report.page import page

    text = page(EVIL[0], "", [{"label": EVIL[0], "names": list(DEFAULT_JOINTS)}])
    data = text.partition('id="figures">')[2].partition("</script>")[0]
    assert json.loads(data)[0]["label"] == EVIL[0]
    assert Elements(text).scripts == 3
