"""`classify --explain`: the page, for accepted and for rejected clips."""

import re
from pathlib import Path

import pytest
from playwright.sync_api import Browser

from actioncli import SupportStore
from tests.browsing import accessible, ask

from .conftest import EXAMPLES, invoke

WAVE, PUNCH = EXAMPLES / "wave_right/ada.npz", EXAMPLES / "punch_right/dev.npz"


@pytest.mark.parametrize(("tau", "accepted"), [("0", True), ("1", False)])
def test_accepted_and_rejected_clips_get_the_same_page(
    filled: SupportStore, tmp_path: Path, tau: str, accepted: bool
) -> None:
    page = tmp_path / "why.html"
    result = invoke("classify", WAVE, "--tau", tau, "--explain", page)
    assert result.exit_code == (0 if accepted else 1), result.stderr
    assert f"explained in {page}" in result.stderr
    text = page.read_text(encoding="utf-8")
    assert ("Accepted as" if accepted else "is not above the threshold") in text
    for part in ("The nearest actions", "By body part", "By moment", "right arm",
                 "Attention between moments", "What happened to the clip before",
                 "unit inferred from the size of the body"):  # fmt: skip
        assert part in text
    assert text.count("<figure><figcaption>") == 4
    assert not re.search(r"\bnan\b", text, re.IGNORECASE)
    assert "https://" not in text


def test_a_nearer_negative_is_the_reason(filled: SupportStore, tmp_path: Path) -> None:
    assert invoke("enroll", "--negative", PUNCH).exit_code == 0
    page = tmp_path / "why.html"
    assert invoke("classify", PUNCH, "--tau", 0, "--explain", page).exit_code == 1
    assert "a negative is nearer" in page.read_text(encoding="utf-8")


def test_the_page_is_for_everyone_and_plays_in_step(
    browser: Browser, filled: SupportStore, tmp_path: Path
) -> None:
    page = tmp_path / "why.html"
    invoke("classify", PUNCH, "--explain", page)
    accessible(browser, page)
    got = ask(
        browser,
        page,
        """
        const canvases = [...document.querySelectorAll("canvas")];
        const before = canvases.map((c) => c.toDataURL());
        const line = document.querySelector(".cursor");
        const scrub = document.querySelector(".scrub");
        scrub.value = 500; scrub.dispatchEvent(new Event("input"));
        const after = canvases.map((c) => c.toDataURL());
        return { moved: before.map((each, i) => each !== after[i]),
          follows: line.getAttribute("transform"), span: Number(line.dataset.span) };
        """,
    )
    assert got["moved"] == [True] * 4
    assert got["follows"] == f"translate({got['span'] / 2:g} 0)"
