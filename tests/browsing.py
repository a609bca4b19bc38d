"""Pages in a real browser, watched: what goes wrong in one fails the test that opened it."""

import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any
from urllib.parse import urlsplit

import cv2
import pytest
from axe_playwright_python.sync_playwright import Axe
from playwright.sync_api import Browser, Page, expect, sync_playwright

CHROMIUM = shutil.which("chromium") or shutil.which("chromium-browser")
OPTIONS = (
    "--no-sandbox", "--disable-gpu", "--disable-background-networking",
    "--disable-component-update", "--disable-sync", "--no-first-run",
    "--use-fake-device-for-media-stream", "--use-fake-ui-for-media-stream",
)  # fmt: skip
# What the camera shows, over and over: one person does jumping jacks.
FILM = Path(__file__).parents[2] / "shared/video/jumping_jack/afrlW.mp4"
DESKTOP, PHONE = (1280, 900), (390, 844)
# What axe looks for: a theme changes colours, nothing else.
RULES: dict[str, dict[str, Any]] = {
    "light": {"resultTypes": ["violations"]},
    "dark": {"resultTypes": ["violations"], "runOnly": ["color-contrast"]},
}
# Milliseconds: machines that test are busy.
PATIENCE = 60_000
expect.set_options(timeout=PATIENCE)


@contextmanager
def launched(folder: Path) -> Iterator[Browser]:
    """Chromium, whose camera shows a film where there is one, else a test picture."""
    if CHROMIUM is None:
        pytest.skip("needs chromium")
    options = list(OPTIONS)
    if FILM.is_file():
        film = write_film(FILM, folder / "film.mjpeg")
        options.append(f"--use-file-for-fake-video-capture={film}")
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=CHROMIUM, args=options)
        yield browser
        browser.close()


@contextmanager
def watched(browser: Browser, address: str, size: tuple[int, int] = DESKTOP) -> Iterator[Page]:
    """A page in a browser that knows nothing of others.

    At the end, nothing may have been logged, and nothing asked for elsewhere.
    """
    width, height = size
    context = browser.new_context(
        viewport={"width": width, "height": height}, accept_downloads=True, reduced_motion="reduce"
    )
    context.set_default_timeout(PATIENCE)
    page = context.new_page()
    problems: list[str] = []
    page.on("console", lambda message: problems.append(message.text))
    page.on("pageerror", lambda error: problems.append(str(error)))
    asked: list[str] = []
    page.on("request", lambda request: asked.append(request.url))
    page.on("websocket", lambda socket: asked.append(socket.url))
    # A file may ask for nothing but itself.
    host = urlsplit(address).netloc
    own = (f"http://{host}/", f"ws://{host}/", f"blob:http://{host}/") if host else (address,)
    try:
        page.goto(address)
        yield page
        # A refusal is an answer like any other; only Chromium calls it an error.
        said = [each for each in problems if "server responded with a status" not in each]
        assert not said, said
        assert [url for url in asked if not url.startswith(own)] == []
    finally:
        context.close()


@contextmanager
def opened(browser: Browser, address: str, size: tuple[int, int] = DESKTOP) -> Iterator[Page]:
    """The same; at the end the page must be accessible and fit its window, light and dark."""
    with watched(browser, address, size) as page:
        yield page
        check(page)


def check(page: Page) -> None:
    """The page is accessible and fits its window, light and dark."""
    for scheme, rules in RULES.items():
        page.emulate_media(color_scheme=scheme)
        found = Axe().run(page, options=rules)
        assert found.violations_count == 0, found.generate_report()
        assert page.evaluate("document.documentElement.scrollWidth - innerWidth") <= 0
    page.emulate_media(color_scheme="light")


def ask(
    browser: Browser, page: Path, script: str, size: tuple[int, int] = DESKTOP, dark: bool = False
) -> Any:
    """Open a file, run the body of an async function in it, and return what it returns."""
    helpers = """const wait = (ms) => new Promise((done) => setTimeout(done, ms));
        const until = async (done) => { while (!done()) await wait(10); };"""
    with watched(browser, page.as_uri(), size) as tab:
        tab.emulate_media(color_scheme="dark" if dark else "light")
        return tab.evaluate(f"async () => {{ {helpers}\n{script} }}")


def accessible(browser: Browser, page: Path) -> None:
    """A file is for everyone, on a desk and on a phone; its figures turn."""
    for size in (DESKTOP, PHONE):
        with opened(browser, page.as_uri(), size) as tab:
            for canvas in tab.locator("canvas").all()[:1]:
                canvas.scroll_into_view_if_needed()
                before = canvas.evaluate("canvas => canvas.toDataURL()")
                box = canvas.bounding_box()
                assert box is not None
                x, y = box["x"] + box["width"] / 2, box["y"] + box["height"] / 2
                tab.mouse.move(x, y)
                tab.mouse.down()
                tab.mouse.move(x + 60, y)
                tab.mouse.up()
                assert canvas.evaluate("canvas => canvas.toDataURL()") != before


def send(page: Page, *files: Path) -> None:
    """Choose files in the studio."""
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
