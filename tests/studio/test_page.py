"""The studio in a real browser."""

import itertools
import json
import re
import threading
from collections.abc import Iterator
from pathlib import Path

import cv2
import numpy as np
import pytest
from playwright.sync_api import Browser, Page, WebSocketRoute, expect

from actioncli import SupportStore, read_clip
from actioncli.clips.skeleton import DEFAULT_JOINTS
from actioncli.pose.frames import VideoFile
from actioncli.recognition.threshold import kept_threshold
from actioncli.studio.app import Studio
from actioncli.studio.server import Server
from tests.browsing import DESKTOP, FILM, PHONE, check, enroll, opened, send
from tests.pose.videos import Quiet, answering, part, web_server, write_video

from .serving import EXAMPLES, Client, serving, until

SHARED = FILM.parents[1]
SQUAT, OTHER_SQUAT = EXAMPLES / "squat/ada.npz", EXAMPLES / "squat/ben.npz"
WAVE, OTHER_WAVE = EXAMPLES / "wave_right/ada.npz", EXAMPLES / "wave_right/cleo.npz"


def count(page: Page, rate: str) -> int:
    text = page.locator(f"[data-rate={rate}]").text_content()
    found = re.match(r"(\d+) of (\d+)", text or "")
    assert found, text
    return int(found[1])


def test_enrol_and_classify_then_move_tau(tab: Page, studio: Studio) -> None:
    expect(tab).to_have_url(re.compile(r"^http://127\.0\.0\.1:\d+/$"))
    expect(tab.get_by_role("heading", name="Record or drop a clip")).to_be_visible()
    check(tab)
    enroll(tab, SQUAT, "squat")
    enroll(tab, OTHER_SQUAT, "squat")
    enroll(tab, WAVE, "wave")
    expect(tab.get_by_role("article", name="squat", exact=True)).to_contain_text("2 examples")
    send(tab, OTHER_WAVE, EXAMPLES / "bow/ben.npz")
    accepted = tab.get_by_role("article", name="Clip cleo.npz")
    rejected = tab.get_by_role("article", name="Clip ben.npz")
    expect(accepted.locator(".verdict")).to_contain_text(
        re.compile(r"Recognised: wave \(confidence 0\.9\d > τ 0\.\d\d\)")
    )
    # Two examples of one action: enrolment chose a threshold.
    expect(tab.locator("#kept")).to_contain_text("chosen by what you enrolled")
    expect(accepted.get_by_text("nearest: wave")).to_be_visible()
    expect(rejected.locator(".verdict")).to_contain_text("Rejected (nearest squat")
    check(tab)

    slider = tab.get_by_label("τ", exact=True)
    expect(tab.locator("[data-rate=false_accepts]")).to_contain_text("of 99 clips")
    before = count(tab, "false_accepts")
    assert count(tab, "false_rejects") == 0
    slider.fill("5")
    accepts = count(tab, "false_accepts")
    assert accepts > before
    words = tab.locator("#words")
    expect(words).to_contain_text(re.compile(r"About \w+ false alarms? in a hundred other clips"))
    slider.fill("100")
    expect(words).to_contain_text("No false alarm in 99 other clips.")
    expect(words).to_contain_text("2 of your 2 own examples would be missed.")
    assert (count(tab, "false_accepts"), count(tab, "false_rejects")) == (0, 2)
    expect(slider).to_have_attribute(
        "aria-valuetext", re.compile("2 of your 2 own examples would be missed")
    )
    expect(accepted.locator(".verdict")).to_contain_text("Rejected (nearest wave")
    slider.press("ArrowLeft")
    expect(tab.locator("#tau-said")).to_have_text("0.99")
    slider.fill("62")
    tab.get_by_role("button", name="Keep τ 0.62").click()
    expect(tab.get_by_text("In use: 0.62.")).to_be_visible()
    kept = kept_threshold(studio.actions.store)
    assert kept is not None
    assert kept.tau == 0.62
    tab.get_by_role("button", name="Back to 0.50").click()
    expect(tab.get_by_text("In use: 0.50")).to_be_visible()
    assert kept_threshold(studio.actions.store) is None

    rejected.get_by_role("button", name="Never accept").click()
    expect(tab.get_by_role("article", name="negatives")).to_contain_text("never accepted")
    accepted.get_by_role("button", name="Discard").click()
    expect(accepted).to_have_count(0)
    expect(tab.locator("#uploads")).to_be_hidden()
    assert [(a.label, a.examples) for a in studio.actions.store.actions()] == [
        ("negatives", 1),
        ("squat", 2),
        ("wave", 1),
    ]


def test_the_page_leads_from_an_example_to_the_camera(browser: Browser, client: Client) -> None:
    """With nothing of one's own, on a phone, by keyboard alone."""
    with opened(browser, client.address, PHONE) as page:
        expect(page.get_by_role("heading", name="Record or drop a clip")).to_be_visible()
        expect(page.locator("#steps")).to_be_visible()
        check(page)

        def press(name: str) -> None:
            button = page.get_by_role("button", name=name, exact=True)
            button.focus()
            button.press("Enter")

        for action, title in (("squat", "Record or drop a second action"), ("bow", "Try it live")):
            press(action)
            expect(page.get_by_role("article").get_by_label("Name of the action")).to_have_value(
                action
            )
            press("Enrol")
            expect(page.get_by_role("heading", name=title)).to_be_visible()
            expect(page.get_by_role("heading", name=title)).to_be_focused()
        expect(page.locator("#steps")).to_be_hidden()
        expect(page.get_by_text("Do bow or squat before the camera.")).to_be_visible()
        press("squat")
        another = page.get_by_role("article", name="Clip squat ben.npz")
        expect(another.locator(".verdict")).to_contain_text("Recognised: squat")
        titles = page.get_by_role("heading", level=2).all_inner_texts()
        assert titles == [
            "Try it live", "Clips to decide on", "Your actions", "How sure must it be?",
        ]  # fmt: skip
        another.get_by_label("Name of the action").fill("my own")
        press("Enrol")
        expect(page.get_by_role("article", name="my own")).to_be_visible()
        expect(page.locator("#samples")).to_be_hidden()


def test_events_are_counted_in_large_letters(browser: Browser, client: Client) -> None:
    """What the detector tells is put into the server's answers: this is about how it is shown."""
    told = [
        {"label": "squat", "start": 1, "end": 2, "confidence": 0.91, "repetitions": 1},
        {"label": "squat", "start": 2, "end": 3, "confidence": 0.97, "repetitions": 2},
        {"label": "<b>bow", "start": 5, "end": 6, "confidence": 0.72, "repetitions": 1},
        {"label": "squat", "start": 8, "end": 9, "confidence": 0.88, "repetitions": 1},
    ]

    def between(page_side: WebSocketRoute) -> None:
        server = page_side.connect_to_server()

        def answer(message: str | bytes) -> None:
            shown = json.loads(message)
            if "bones" not in shown and told:
                shown["events"] = [told.pop(0)]
            page_side.send(json.dumps(shown))

        server.on_message(answer)

    client.enroll(SQUAT, "squat")
    for size in (DESKTOP, PHONE):
        waiting = list(told)
        with opened(browser, client.address, size) as page:
            page.route_web_socket(re.compile("/api/live"), between)
            expect(page.locator("#mine")).to_be_visible()
            page.get_by_role("button", name="Use the camera").click()
            seen = page.get_by_role("list", name="Actions seen so far").get_by_role("listitem")
            expect(seen).to_have_text(["squat ×1 0.88", "<b>bow ×1 0.72", "squat ×2 0.97"])
            first, screen = seen.first, page.locator(".screen")
            assert first.evaluate("e => parseFloat(getComputedStyle(e).fontSize)") >= 36
            expect(first).to_be_in_viewport()
            assert screen.evaluate("e => e.clientWidth") > size[0] / 2
        told[:] = waiting


def test_delete_asks_rename_and_export(tab: Page, studio: Studio, tmp_path: Path) -> None:
    store = studio.actions.store
    for file in (SQUAT, OTHER_SQUAT):
        store.enroll("squat", read_clip(file))
    store.enroll("wave", read_clip(WAVE))
    tab.get_by_role("button", name="Delete wave").click()
    dialog = tab.get_by_role("dialog")
    expect(dialog).to_contain_text("Delete wave with its only example?")
    expect(dialog.get_by_role("button", name="Cancel")).to_be_focused()
    check(tab)
    tab.keyboard.press("Escape")
    expect(dialog).to_be_hidden()
    assert len(store.actions()) == 2
    tab.get_by_role("button", name="Delete wave").click()
    dialog.get_by_role("button", name="Delete").click()
    expect(tab.get_by_role("article", name="wave")).to_have_count(0)
    expect(tab.get_by_role("status").first).to_have_text("wave deleted.")
    first = store.examples()[0].id
    tab.get_by_role("button", name=f"Delete example {first} of squat").click()
    dialog.get_by_role("button", name="Delete").click()
    card = tab.get_by_role("article", name="squat", exact=True)
    expect(card).to_contain_text("1 example")
    tab.get_by_role("button", name="Rename squat").click()
    dialog.get_by_label("Name").fill("sit down")
    dialog.get_by_role("button", name="Rename").click()
    expect(tab.get_by_role("article", name="sit down")).to_be_visible()
    with tab.expect_download() as download:
        tab.get_by_role("button", name="Export all").click()
    assert download.value.suggested_filename == "actions.safetensors"
    file = tmp_path / "actions.safetensors"
    download.value.save_as(file)
    assert SupportStore(tmp_path / "other.db").import_(file) == (1, 0)


def test_mistakes_are_told_and_can_be_mended(
    tab: Page, studio: Studio, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    notes = tmp_path / "notes.txt"
    notes.write_text("no clip")
    film = tmp_path / "film.mp4"
    film.write_bytes(b"no film")
    send(tab, notes, film)
    expect(tab.get_by_role("alert").filter(has_text="notes.txt: .txt is neither")).to_be_visible()
    expect(tab.get_by_role("alert").filter(has_text="film.mp4: not a video")).to_be_visible()
    check(tab)
    for name in ("notes.txt", "film.mp4"):
        tab.get_by_role("button", name=f"Dismiss {name}").click()
    monkeypatch.setattr(studio, "limit", 1000)
    tab.reload()
    send(tab, SQUAT)
    expect(tab.get_by_role("alert").filter(has_text="larger than 0.001 MB")).to_be_visible()
    monkeypatch.undo()
    tab.reload()
    # Joints without names: the option that settles it.
    bare = tmp_path / "bare.npy"
    clip = read_clip(SQUAT)
    np.save(bare, clip.joints[:, [clip.joint_names.index(name) for name in DEFAULT_JOINTS]])
    send(tab, bare)
    expect(tab.get_by_role("article", name="Clip bare.npy").get_by_role("alert")).to_be_visible()
    tab.get_by_text("How to read files").click()
    tab.get_by_label("Layout").select_option("default_15")
    tab.get_by_role("button", name="Try bare.npy again").click()
    card = tab.get_by_role("article", name="Clip bare.npy")
    card.get_by_role("button", name="Enrol").click()
    expect(card.get_by_label("Name of the action")).to_be_focused()
    card.get_by_label("Name of the action").fill("squat")
    card.get_by_label("Name of the action").press("Enter")
    expect(tab.get_by_role("article", name="squat", exact=True)).to_be_visible()


def test_other_tabs_and_commands_are_followed(
    browser: Browser, tab: Page, client: Client, studio: Studio
) -> None:
    with opened(browser, client.address, PHONE) as phone:
        enroll(phone, SQUAT, "squat")
        expect(tab.get_by_role("article", name="squat", exact=True)).to_be_visible()
        SupportStore(studio.actions.store.path).enroll("wave", read_clip(WAVE))
        for page in (tab, phone):
            expect(page.get_by_role("article", name="wave")).to_be_visible()


def test_without_the_token_the_page_stays_empty(browser: Browser, client: Client) -> None:
    with opened(browser, client.headers["Origin"] + "/") as page:
        expect(page.locator("#lost")).to_contain_text("with its token")
        expect(page.locator("#store")).to_be_empty()
        # The address may be entered into the same tab.
        page.goto(client.address)
        expect(page.get_by_role("heading", name="Record or drop a clip")).to_be_visible()
        expect(page).to_have_url(client.headers["Origin"] + "/")


def test_the_file_that_a_browser_is_given_leads_to_the_page(
    browser: Browser, studio: Studio, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("BROWSER", "any")
    monkeypatch.setattr("webbrowser.open", lambda address: address.endswith("open.html"))
    server = Server()
    assert server.open(tmp_path)
    thread = threading.Thread(target=server.run, args=(studio.app(),))
    thread.start()
    page = browser.new_page()
    page.goto((tmp_path / "open.html").as_uri())
    expect(page.get_by_role("heading", name="Record or drop a clip")).to_be_visible()
    expect(page).to_have_url(f"http://127.0.0.1:{server.port}/")
    page.close()
    server.stop()
    thread.join()
    server.close()


def test_another_server_of_this_machine_never_sees_the_token(
    browser: Browser, client: Client, studio: Studio
) -> None:
    context = browser.new_context()
    tab = context.new_page()
    tab.goto(client.address)
    lead = tab.get_by_role("heading", name="Record or drop a clip")
    expect(lead).to_be_visible()
    seen: list[str] = []

    class Other(Quiet):
        def answer(self) -> None:
            seen.append(f"{self.requestline}\n{self.headers}")
            self.send_response(200)
            self.send_header("Content-Type", "text/html")
            self.end_headers()
            image = f"<img src='{other}again'>"
            self.wfile.write(f"<!doctype html><title>other</title>{image}".encode())

    with web_server(Other) as other:
        visitor = context.new_page()
        for host in ("127.0.0.1", "localhost"):
            visitor.goto(other.replace("127.0.0.1", host))
        # From the studio's own tab, which keeps the token, and by its link back.
        tab.goto(f"{other}from-the-studio")
        tab.go_back()
        expect(lead).to_be_visible()
    assert any("from-the-studio" in request for request in seen)
    assert client.token not in "".join(seen)
    assert context.cookies() == []
    context.close()


@pytest.mark.skipif(not FILM.is_file(), reason=f"needs {FILM}")
def test_a_real_video_is_looked_at_with_progress_and_cancelled(
    tab: Page, studio: Studio, tmp_path: Path
) -> None:
    frames = VideoFile(SHARED / "squat/darebeeW.mp4").frames(rate=12)
    squats = [cv2.resize(frame.image, None, fx=0.5, fy=0.5) for frame in frames]
    # So long that it is still looked at whatever else the machine does.
    long = write_video(tmp_path / "long.mp4", squats * 12, 12)
    card = tab.get_by_role("article", name="Clip long.mp4")
    looking = card.get_by_text(re.compile(r"Looking for the person: [\d.]+ of [\d.]+ s"))
    send(tab, long)
    expect(looking).to_be_visible()
    check(tab)
    card.get_by_role("button", name="Cancel").click()
    expect(card).to_have_count(0)
    # A page that goes away takes what it sent along.
    send(tab, long)
    expect(looking).to_be_visible()
    tab.reload()
    until(lambda: not list(studio.upload_folder.folder.iterdir()))
    enroll(tab, SHARED / "squat/hciproM.mp4", "squat")
    (example,) = studio.actions.store.examples("squat")
    assert example.source == "hciproM.mp4"
    assert not list(studio.upload_folder.folder.iterdir())


@pytest.mark.skipif(not FILM.is_file(), reason=f"needs {FILM}")
def test_recorded_from_the_camera_and_tested_live(tab: Page, studio: Studio) -> None:
    studio.actions.store.enroll("squat", read_clip(SQUAT))
    tab.get_by_role("button", name="Use the camera").click()
    expect(tab.locator("#view")).to_contain_text("The body is in view")
    tab.get_by_label("for").select_option("3")
    tab.get_by_role("button", name="Record").click()
    expect(tab.locator("#count")).to_have_text("recording")
    card = tab.get_by_role("article", name="Clip camera 1.webm")
    card.get_by_label("Name of the action").fill("jumping jack")
    check(tab)
    assert "cut off" not in card.inner_text()
    card.get_by_role("button", name="Enrol").click()
    expect(tab.get_by_role("article", name="jumping jack", exact=True)).to_be_visible()
    (example,) = studio.actions.store.examples("jumping jack")
    assert example.source == "camera 1.webm"
    assert 0.2 < (example.frames - 1) / example.fps < 4
    row = tab.locator("#ranking tr").filter(has_text="jumping jack")
    try:
        expect(row.locator("td").last).to_have_text(re.compile(r"0\.[5-9]\d|1\.00"))
        expect(tab.locator("#verdict")).to_have_text("jumping jack")
    except AssertionError:
        found = re.search(r"([\d.]+) pictures/s", tab.locator("#view").inner_text())
        if found and float(found[1]) < 5:
            pytest.skip(f"this machine looks at {found[1]} pictures a second, too few to follow")
        raise
    check(tab)
    tab.get_by_role("button", name="Stop the camera").click()
    expect(tab.locator("#camera")).to_be_hidden()


@pytest.mark.skipif(not FILM.is_file(), reason=f"needs {FILM}")
def test_a_camera_that_the_command_names(browser: Browser, studio: Studio) -> None:
    """It is recorded from, tested live and lost like one of the browser's own."""
    frames = VideoFile(FILM).frames(end=4, rate=12)
    pictures = [part(cv2.resize(frame.image, None, fx=0.5, fy=0.5)) for frame in frames]
    film: Iterator[bytes | float] = itertools.cycle(
        [each for picture in pictures for each in (picture, 1 / 12)]
    )
    with answering(film) as address:
        named = Studio(studio.actions, studio.upload_folder, source=address.replace("//", "//a:b@"))
        with serving(named.app()) as page_address, opened(browser, page_address) as tab:
            expect(tab.locator("#store")).not_to_be_empty()
            tab.get_by_role("button", name="Use the camera").click()
            expect(tab.locator("#view")).to_contain_text("The body is in view")
            assert tab.locator("#which option:checked").inner_text() == address
            check(tab)
            tab.get_by_role("button", name="Record").click()
            card = tab.get_by_role("article", name="Clip camera 1.webm")
            card.get_by_label("Name of the action").fill("jumping jack")
            card.get_by_role("button", name="Enrol").click()
            expect(tab.get_by_role("article", name="jumping jack", exact=True)).to_be_visible()
            tab.locator("#which").select_option(index=0)  # the browser's own
            expect(tab.locator("#view")).to_contain_text("pictures/s")
            tab.locator("#which").select_option(label=address)
            expect(tab.locator("#view")).to_contain_text("pictures/s")
            tab.get_by_role("button", name="Stop the camera").click()
        named.close()
    lost = Studio(studio.actions, studio.upload_folder, source=address)
    # Where there is something to recognise, it is opened at once.
    with serving(lost.app()) as page_address, opened(browser, page_address) as tab:
        expect(tab.get_by_role("alert").filter(has_text="cannot be opened")).to_be_visible()
    lost.close()


def test_a_camera_that_is_refused_is_told(browser: Browser, client: Client) -> None:
    with opened(browser, client.address) as page:
        page.evaluate(
            "void (navigator.mediaDevices.getUserMedia = async () => {"
            " throw new DOMException('no', 'NotAllowedError'); })"
        )
        page.get_by_role("button", name="Use the camera").click()
        expect(page.get_by_role("alert").filter(has_text="may not use a camera")).to_be_visible()


def test_all_by_keyboard(tab: Page, studio: Studio) -> None:
    studio.actions.store.enroll("squat", read_clip(SQUAT))
    expect(tab.get_by_role("article", name="squat", exact=True).locator("canvas")).to_be_visible()
    expect(tab.locator("#words")).to_contain_text("other clips")
    tab.locator("body").press("Home")
    reached = []
    for _ in range(40):
        tab.keyboard.press("Tab")
        found = tab.evaluate(
            "(() => { const e = document.activeElement; const shown = e.id === 'files' ?"
            " e.nextElementSibling : e; const style = getComputedStyle(shown); return [e.tagName,"
            " e.id || e.getAttribute('aria-label') || e.textContent.trim(),"
            " style.outlineStyle !== 'none' && parseFloat(style.outlineWidth) > 0]; })()"
        )
        if found[0] == "BODY":
            break
        reached.append(found)
    assert [name for _, name, seen in reached if not seen] == []
    names = {name for _, name, _ in reached}
    assert {"camera-switch", "files", "tau", "keep", "Rename squat", "Delete squat"} <= names
    assert "Play or pause: squat" in names
    assert "export" in names
