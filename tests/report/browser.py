"""Pages in a real browser, where Chromium is installed."""

import json
import re
import shutil
import subprocess
from html import unescape
from pathlib import Path
from typing import Any

import pytest
from axe_playwright_python.sync_playwright import Axe
from playwright.sync_api import sync_playwright

CHROMIUM = shutil.which("chromium") or shutil.which("chromium-browser")
needs_chromium = pytest.mark.skipif(CHROMIUM is None, reason="needs chromium")

# Runs before the page: what it logs as an error, and what it tries to load.
_WATCH = """<script>
window.problems = [];
addEventListener("error", (e) => problems.push(String(e.message)));
addEventListener("unhandledrejection", (e) => problems.push(String(e.reason)));
addEventListener("securitypolicyviolation", (e) => problems.push("blocked " + e.blockedURI));
console.error = (...all) => problems.push(all.join(" "));
// Where only the document is wanted, Chromium paints no frames that could be waited for.
window.requestAnimationFrame = (draw) => setTimeout(() => draw(performance.now()), 16);
const wait = (ms) => new Promise((done) => setTimeout(done, ms));
</script>"""
_ASK = """<script>(async () => {
const result = await (async () => { %s })();
const loaded = performance.getEntriesByType("resource").map((entry) => entry.name);
const pre = document.createElement("pre");
pre.id = "result";
pre.textContent = JSON.stringify({ result, problems, loaded });
document.body.append(pre);
})();</script>"""


def ask(page: Path, script: str, width: int = 1280, dark: bool = False) -> Any:
    """Open a page, run the body of an async function in it, and return what it returns.

    Fails where the page logs an error or loads anything.
    """
    text = page.read_text(encoding="utf-8")
    text = text.replace("<title>", _WATCH + "<title>", 1)
    text = text.replace("</body>", _ASK % script + "</body>", 1)
    copy = page.with_name(f"asked_{page.name}")
    copy.write_text(text, encoding="utf-8")
    assert CHROMIUM is not None
    profile = page.parent / "profile"
    options = [
        "--headless", "--no-sandbox", "--disable-gpu", "--disable-quic", "--no-first-run",
        "--disable-background-networking", "--disable-component-update", "--disable-sync",
        f"--user-data-dir={profile}", f"--window-size={width},1200",
        "--virtual-time-budget=5000", "--dump-dom",
    ]  # fmt: skip
    if dark:
        options.append("--blink-settings=preferredColorScheme=0")
    done = subprocess.run(
        [CHROMIUM, *options, copy.as_uri()], capture_output=True, text=True, timeout=90, check=False
    )
    found = re.search(r'<pre id="result">(.*?)</pre>', done.stdout, re.DOTALL)
    assert found, done.stderr[-2000:]
    answer = json.loads(unescape(found[1]))
    assert answer["problems"] == []
    assert answer["loaded"] == []
    return answer["result"]


def accessible(page: Path) -> None:
    """No violation is found by axe, on a desk and on a phone, light and dark; figures turn.

    Fails where the page logs an error, is wider than its window, or asks for anything.
    """
    problems: list[str] = []
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=CHROMIUM, args=["--no-sandbox"])
        for width in (1280, 390):
            tab = browser.new_page(viewport={"width": width, "height": 900})
            tab.on("pageerror", lambda error: problems.append(str(error)))
            tab.on("request", lambda request: problems.append(request.url))
            tab.on("console", lambda message: problems.append(message.text))
            tab.goto(page.as_uri())
            assert problems.pop(0) == page.as_uri()
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
                tab.mouse.move(box["x"] + box["width"] / 2, box["y"] + box["height"] / 2)
                tab.mouse.down()
                tab.mouse.move(box["x"] + box["width"] / 2 + 60, box["y"] + box["height"] / 2)
                tab.mouse.up()
                assert canvas.evaluate("canvas => canvas.toDataURL()") != before
        browser.close()
    assert problems == []
