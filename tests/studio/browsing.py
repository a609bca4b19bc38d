"""Pages in a real browser, watched: what goes wrong in one fails the test that opened it."""

from __future__ import annotations

import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from urllib.parse import urlsplit

import cv2
from axe_playwright_python.sync_playwright import Axe
from playwright.sync_api import Browser, Page, expect

CHROMIUM = shutil.which("chromium") or shutil.which("chromium-browser")
OPTIONS = (
    "--no-sandbox", "--disable-gpu", "--disable-background-networking",
    "--disable-component-update", "--disable-sync", "--no-first-run",
    "--use-fake-device-for-media-stream", "--use-fake-ui-for-media-stream",
)  # fmt: skip
# What the camera shows, over and over: one person does jumping jacks.
FILM = Path(__file__).parents[3] / "shared/video/jumping_jack/afrlW.mp4"
DESKTOP, PHONE = (1280, 900), (390, 844)
# Milliseconds: machines that test are busy.
PATIENCE = 60_000
expect.set_options(timeout=PATIENCE)


@contextmanager
def opened(browser: Browser, address: str, size: tuple[int, int] = DESKTOP) -> Iterator[Page]:
    """A page in a browser that knows nothing of others.

    At the end, no error may have been logged, nothing asked for elsewhere, and the page must be
    accessible and fit its window, light and dark.
    """
    width, height = size
    context = browser.new_context(
        viewport={"width": width, "height": height}, accept_downloads=True, reduced_motion="reduce"
    )
    context.set_default_timeout(PATIENCE)
    page = context.new_page()
    problems: list[str] = []
    page.on(
        "console",
        lambda message: (
            problems.append(message.text) if message.type in {"error", "warning"} else None
        ),
    )
    page.on("pageerror", lambda error: problems.append(str(error)))
    hosts: set[str] = set()
    page.on("request", lambda request: hosts.add(urlsplit(request.url).netloc))
    page.on("websocket", lambda socket: hosts.add(urlsplit(socket.url).netloc))
    try:
        page.goto(address)
        yield page
        check(page)
        # A refusal is an answer like any other; only Chromium calls it an error.
        unexpected = [text for text in problems if "the server responded with a status" not in text]
        assert unexpected == []
        assert hosts - {""} == {urlsplit(address).netloc}
    finally:
        context.close()


def check(page: Page) -> None:
    """The page is accessible and fits its window, light and dark."""
    for scheme in ("light", "dark"):
        page.emulate_media(color_scheme=scheme)
        found = Axe().run(page)
        assert found.violations_count == 0, found.generate_report()
        assert page.evaluate("document.documentElement.scrollWidth - innerWidth") <= 0
    page.emulate_media(color_scheme="light")


def send(page: Page, *files: Path) -> None:
    """Choose files."""
    page.locator("#files").set_input_files(list(files))


def enroll(page: Page, file: Path, label: str) -> None:
    """Send a file, and enrol it once it has been read."""
    send(page, file)
    card = page.get_by_role("article", name=f"Clip {file.name}")
    card.get_by_label("Name of the action").fill(label)
    card.get_by_role("button", name="Enrol").click()
    expect(card).to_have_count(0)


def write_film(video: Path, film: Path, height: int = 360) -> Path:
    """A video as a row of JPEG pictures, which is what Chromium's fake camera plays."""
    capture = cv2.VideoCapture(str(video))
    with film.open("wb") as file:
        while True:
            read, image = capture.read()
            if not read:
                return film
            width = round(image.shape[1] * height / image.shape[0] / 2) * 2
            file.write(cv2.imencode(".jpg", cv2.resize(image, (width, height)))[1].tobytes())
