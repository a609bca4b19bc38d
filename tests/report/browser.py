"""Pages in a real browser, where Chromium is installed."""

import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest
from axe_playwright_python.sync_playwright import Axe
from playwright.sync_api import Page, sync_playwright

CHROMIUM = shutil.which("chromium") or shutil.which("chromium-browser")
needs_chromium = pytest.mark.skipif(CHROMIUM is None, reason="needs chromium")


@contextmanager
def opened(page: Path, width: int) -> Iterator[Page]:
    """A page in a window of that width.

    Fails where the page logs anything, a script of it fails, or it asks for anything.
    """
    problems: list[str] = []
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=CHROMIUM, args=["--no-sandbox"])
        tab = browser.new_page(viewport={"width": width, "height": 900})
        tab.on("pageerror", lambda error: problems.append(str(error)))
        tab.on("request", lambda request: problems.append(request.url))
        tab.on("console", lambda message: problems.append(message.text))
        tab.goto(page.as_uri())
        yield tab
        browser.close()
    assert problems == [page.as_uri()]


def ask(page: Path, script: str, width: int = 1280, dark: bool = False) -> Any:
    """Open a page, run the body of an async function in it, and return what it returns."""
    wait = "const wait = (ms) => new Promise((done) => setTimeout(done, ms));"
    with opened(page, width) as tab:
        tab.emulate_media(color_scheme="dark" if dark else "light")
        return tab.evaluate(f"async () => {{ {wait}\n{script} }}")


def accessible(page: Path) -> None:
    """No violation is found by axe, on a desk and on a phone, light and dark; figures turn."""
    for width in (1280, 390):
        with opened(page, width) as tab:
            for scheme in ("light", "dark"):
                tab.emulate_media(color_scheme=scheme)
                found = Axe().run(tab)
                assert found.violations_count == 0, found.generate_report()
            assert tab.evaluate("document.documentElement.scrollWidth - innerWidth") <= 0
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
