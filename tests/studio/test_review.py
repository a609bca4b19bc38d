"""The page of `review`: recorded clips, decided on by a click or a key."""

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from playwright.sync_api import Browser, expect

import actioncli
from actioncli import SupportStore, read_clip
from actioncli.clips.write import write_clip
from actioncli.studio.review import Review
from tests.browsing import DESKTOP, PHONE, check, opened

from .serving import EXAMPLES, Client, record, serving

# The last is wider than a phone, and no place to break it.
LABELS = ("squat", "wave", "bow", "</b> " + 20 * "kick")


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """What `watch --record` filled, with four events."""
    folder = tmp_path / "seen"
    record(folder, *LABELS)
    return folder


@pytest.fixture
def review(folder: Path, tmp_path: Path) -> Iterator[tuple[Review, Client]]:
    """The page of that folder, for a support set that knows squats."""
    support = actioncli.open(tmp_path / "support.db")
    support.store.enroll("squat", read_clip(EXAMPLES / "squat/ben.npz"))
    review = Review(support, folder)
    with serving(review.app()) as address:
        yield review, Client(address)


def test_enrolled_made_a_negative_and_deleted(review: tuple[Review, Client], folder: Path) -> None:
    behind, client = review
    clips = client.get("/api/waiting")["clips"]
    assert [clip["label"] for clip in clips] == list(LABELS)
    first, second, third, _ = (f"/api/waiting/{clip['file']}" for clip in clips)
    shown = client.get(first)
    assert shown["figure"]["joints"] == shown["example"]["joints"]
    assert client.get(second)["example"] is None
    status, answer = client.ask("POST", first, {"decision": "enroll", "label": "squat"})
    assert (status, answer) == (200, {"warnings": []})
    assert client.ask("POST", second, {"decision": "negative"})[0] == 200
    assert client.ask("POST", third, {"decision": "delete"})[0] == 200
    assert client.ask("POST", third, {"decision": "delete"})[0] == 404
    assert dict(behind.done) == {"enroll": 1, "negative": 1, "delete": 1}
    examples = behind.actions.store.examples()
    assert [(e.label, e.negative) for e in examples] == [
        ("negatives", True),
        ("squat", False),
        ("squat", False),
    ]
    assert examples[2].note.startswith("camera 0 0.0 s to")
    assert len(list(folder.iterdir())) == 2


def test_of_several_repetitions_one_is_enrolled(
    review: tuple[Review, Client], folder: Path
) -> None:
    behind, client = review
    once = read_clip(EXAMPLES / "squat/ada.npz")
    file = folder / client.get("/api/waiting")["clips"][0]["file"]
    write_clip(file, replace(once, joints=np.tile(once.joints, (5, 1, 1)), confidence=None))
    asked = {"decision": "enroll", "label": "squat"}
    status, answer = client.ask("POST", f"/api/waiting/{file.name}", asked)
    assert status == 200
    assert "one of about 5 repetitions" in answer["warnings"][0]
    enrolled = behind.actions.store.clip(behind.actions.store.examples("squat")[-1].id)
    assert 0.5 < enrolled.duration / once.duration < 1.5


@pytest.mark.parametrize(
    "document",
    [{}, {"decision": "burn"}, {"decision": "enroll"}, {"decision": "enroll", "label": ""}],
)
def test_what_is_no_decision_changes_nothing(
    review: tuple[Review, Client], folder: Path, document: dict[str, str]
) -> None:
    _, client = review
    path = f"/api/waiting/{client.get('/api/waiting')['clips'][0]['file']}"
    assert client.ask("POST", path, document)[0] == 400
    assert len(list(folder.glob("*.npz"))) == 4


@pytest.mark.parametrize(
    "name", ["..%2fsupport.db", "0001_squat.json", "9999_none.npz", "..%2f..%2fx"]
)
def test_only_what_waits_can_be_named(review: tuple[Review, Client], name: str) -> None:
    _, client = review
    assert client.ask("GET", f"/api/waiting/{name}")[0] == 404
    assert client.ask("POST", f"/api/waiting/{name}", {"decision": "delete"})[0] == 404


def test_by_keys_and_clicks(browser: Browser, review: tuple[Review, Client], folder: Path) -> None:
    behind, client = review
    store: SupportStore = behind.actions.store
    with opened(browser, client.address, PHONE) as page:
        title = page.get_by_role("heading", level=2)
        expect(title).to_have_text("1 of 4: event, squat")
        expect(page.get_by_text("Confidence 0.60, τ 0.50; camera 0")).to_be_visible()
        expect(page.get_by_text("example of squat")).to_be_visible()
        for width, height in (DESKTOP, PHONE):
            page.set_viewport_size({"width": width, "height": height})
            check(page)
        opening = page.get_by_label("Moment").input_value()
        page.get_by_role("button", name="Play or pause").click()
        expect(page.get_by_label("Moment")).not_to_have_value(opening)
        page.keyboard.press("e")
        expect(title).to_have_text("1 of 3: event, wave")
        expect(page.locator("#said")).to_have_text("0001_squat.npz enrolled as squat.")
        page.keyboard.press("s")
        expect(title).to_have_text("2 of 3: event, bow")
        page.keyboard.press("o")
        expect(page.get_by_label("Name of the action")).to_be_focused()
        # Letters that are typed decide nothing.
        page.keyboard.type("deep end")
        page.keyboard.press("Enter")
        expect(title).to_have_text(f"2 of 2: event, {LABELS[-1]}")
        assert page.evaluate("document.documentElement.scrollWidth - innerWidth") <= 0
        page.get_by_role("button", name="Never accept").click()
        expect(page.get_by_text("That was the last one; 1 clip skipped.")).to_be_visible()
        page.get_by_role("button", name="Show what was skipped").click()
        expect(title).to_have_text("1 of 1: event, wave")
        page.get_by_role("button", name="Delete").click()
        expect(page.get_by_text("Nothing waits for review.")).to_be_visible()
    assert not list(folder.iterdir())
    assert [(a.label, a.examples) for a in store.actions()] == [
        ("deep end", 1),
        ("negatives", 1),
        ("squat", 2),
    ]
    assert dict(behind.done) == {"enroll": 2, "negative": 1, "delete": 1}


def test_a_damaged_clip_can_be_deleted(
    browser: Browser, review: tuple[Review, Client], folder: Path
) -> None:
    _, client = review
    (folder / "0001_squat.npz").write_bytes(b"no clip")
    with opened(browser, client.address) as page:
        expect(page.locator("#stage .problem")).to_contain_text("0001_squat.npz")
        page.get_by_role("button", name="Enrol").click()
        expect(page.get_by_role("alert")).to_contain_text("0001_squat.npz")
        page.keyboard.press("d")
        expect(page.get_by_role("heading", level=2)).to_have_text("1 of 3: event, wave")
