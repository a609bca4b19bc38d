"""Pages that hold all they show, and their players."""

from pathlib import Path

import numpy as np
import pytest
from playwright.sync_api import Browser

from actioncli import Clip, read_clip
from actioncli.clips.skeleton import DEFAULT_JOINTS
from actioncli.report.figure import figure
from actioncli.report.page import page, playable, player, table
from actioncli.report.plots import SHARES, Axis, Plot
from tests.browsing import accessible, ask

EXAMPLES = Path(__file__).parents[2] / "examples"

# A canvas as numbers that change when the drawing does.
_PICTURE = """const canvases = [...document.querySelectorAll("canvas")];
const picture = () => canvases.map((c) => c.toDataURL());
const play = document.querySelector(".play"), scrub = document.querySelector(".scrub");
const said = document.querySelector(".said"), front = document.querySelector(".front");
const key = (name) => canvases[0].dispatchEvent(new KeyboardEvent("keydown", { key: name }));
await wait(50);
"""


@pytest.fixture(scope="module")
def two(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A page with two figures."""
    clips = [read_clip(EXAMPLES / f"{name}.npz") for name in ("squat/ada", "wave_right/ben")]
    body = "<h1>Two</h1>" + player("</script> & two", ["one", "two"])
    figures = [playable(figure(clip)) for clip in clips]
    file = tmp_path_factory.mktemp("page") / "page.html"
    file.write_text(page("two <figures>", body, figures), encoding="utf-8")
    return file


def test_play_scrub_and_turn(browser: Browser, two: Path) -> None:
    got = ask(
        browser,
        two,
        _PICTURE
        + """
        const start = picture(), opening = Number(scrub.value);
        play.click(); await until(() => Number(scrub.value) !== opening);
        const moved = picture(), playing = play.textContent;
        play.click(); await wait(50);
        const stopped = picture(); await wait(200); const still = picture();
        scrub.value = 500; scrub.dispatchEvent(new Event("input"));
        const middle = picture(), told = said.value;
        key("ArrowRight"); const turned = picture();
        key("ArrowUp"); const raised = picture();
        key("Home"); const home = picture();
        key("ArrowLeft"); front.click(); const front_again = picture();
        key(" "); const by_key = play.textContent; key(" ");
        const same = (a, b) => a.map((each, i) => each === b[i]);
        return { drawn: start.map((url) => url.length > 2000), moved: same(start, moved),
          opening, playing, stopped: same(stopped, still), middle: same(middle, start), told,
          turned: same(turned, middle), raised: same(raised, turned), home: same(home, middle),
          front: same(front_again, middle), by_key };
        """,
    )
    assert got["drawn"] == [True, True]
    assert got["moved"] == [False, False]
    assert 350 < got["opening"] < 550  # the squat is deepest there
    assert (got["playing"], got["by_key"]) == ("Pause", "Pause")
    assert got["stopped"] == [True, True]
    assert got["middle"] == [False, False]
    assert got["told"] == "50 %"
    assert got["turned"] == got["raised"] == [False, False]
    assert got["home"] == got["front"] == [True, True]


@pytest.mark.parametrize(("width", "dark"), [(1280, False), (500, True)])
def test_it_follows_the_theme(browser: Browser, two: Path, width: int, dark: bool) -> None:
    got = ask(
        browser,
        two,
        """return { paper: getComputedStyle(document.body).backgroundColor,
          tops: [...document.querySelectorAll("canvas")].map((c) => c.offsetTop) };""",
        (width, 900),
        dark,
    )
    assert got["paper"] == ("rgb(20, 23, 26)" if dark else "rgb(255, 255, 255)")
    assert got["tops"][0] == got["tops"][1]


def test_the_page_is_for_everyone(browser: Browser, two: Path) -> None:
    accessible(browser, two)


def test_a_page_names_nothing_outside(two: Path) -> None:
    text = two.read_text(encoding="utf-8")
    assert "default-src 'none'" in text
    assert "http://" not in text
    assert "https://" not in text
    assert "<title>two &lt;figures&gt;</title>" in text
    assert text.count("</script>") == 3


@pytest.mark.parametrize(
    ("frames", "fps", "kept"), [(600, 120, 120), (40_000, 25, 6667)], ids=["fast", "long"]
)
def test_figures_are_small_and_whole(frames: int, fps: float, kept: int) -> None:
    motion = np.random.default_rng(0).normal(size=(frames, 15, 3))
    clip = Clip(motion, DEFAULT_JOINTS, fps=fps)
    data = playable(figure(clip), clock=[0, frames / 2, frames - 1], glow=[0.1] * 15)
    assert data["frames"] == kept
    assert data["seconds"] == pytest.approx((frames - 1) / fps, abs=1e-3)
    assert data["clock"][::2] == [0, kept - 1]
    assert data["clock"][1] == pytest.approx(kept / 2, abs=1)


def test_tables_and_plots_escape() -> None:
    text = table("<c>", ["<h>", "x"], [["<r>", "1"]])
    assert "<c>" not in text
    assert "&lt;r&gt;" in text
    plot = Plot("<t>", Axis("<x>", 0, 1, SHARES), Axis("y", 0, 1, SHARES, percent=True))
    plot.line([0, 1], [0.5, 2], 0, "<s>")
    plot.steps([0, 0.5, 1], [0.2, 0.8], 1, "h")
    plot.rule(0.5, "<tau>")
    html = plot.html("<note>")
    for raw in ("<t>", "<x>", "<s>", "<tau>", "<note>"):
        assert raw not in html
    assert "25 %" in html
    assert "nan" not in html.lower()
