"""Strips and animations in files."""

import sys
import xml.etree.ElementTree as ET
from collections.abc import Iterable, Iterator
from pathlib import Path

import cv2
import numpy as np
import pytest
from PIL import Image

from actioncli import Clip, UsageError, read_clip
from actioncli.clips.drawing import PALETTES, Drawing, Shape, Theme
from actioncli.report.pictures import write_picture

EXAMPLES = Path(__file__).parents[2] / "examples"
SVG = "{http://www.w3.org/2000/svg}"


@pytest.fixture(scope="module")
def squat() -> Clip:
    return read_clip(EXAMPLES / "squat/ada.npz")


def share(pixels: np.ndarray, colour: str) -> float:
    """Share of the pixels that have nearly this colour."""
    rgb = list(bytes.fromhex(colour[1:]))
    near = np.abs(pixels.astype(int) - rgb).max(axis=-1) <= 12
    return float(near.mean())


def test_svg_follows_its_reader_and_escapes(tmp_path: Path, squat: Clip) -> None:
    label = '<script>&"squat"'
    write_picture(tmp_path / "a.svg", label, [("<b>one", squat), ("two", squat)])
    text = (tmp_path / "a.svg").read_text()
    root = ET.fromstring(text)
    said = [element.text for element in root.iter(f"{SVG}text")]
    assert said[0] == label
    assert {"<b>one", "two", "left", "0.0 s"} <= set(said)
    assert "prefers-color-scheme:dark" in text
    write_picture(tmp_path / "wide.svg", "挥" * 100, [("a" * 255, squat)])
    said = [element.text or "" for element in ET.parse(tmp_path / "wide.svg").iter(f"{SVG}text")]
    assert [text[-1] for text in said if text[0] in "挥a"] == ["…", "…"]
    assert not any("http" in value for e in root.iter() for value in e.attrib.values())
    write_picture(tmp_path / "dark.svg", label, [("one", squat)], "dark")
    fixed = (tmp_path / "dark.svg").read_text()
    assert PALETTES["dark"]["paper"] in fixed
    assert "prefers-color-scheme" not in fixed


def test_guessed_joints_are_hollow_and_their_bones_dotted(tmp_path: Path, squat: Clip) -> None:
    confidence = np.ones(squat.joints.shape[:2])
    confidence[:, squat.joint_names.index("lwri")] = 0
    guessed = Clip(squat.joints, squat.joint_names, squat.fps, confidence)
    counts = []
    for clip in (squat, guessed):
        write_picture(tmp_path / "a.svg", "squat", [("", clip)])
        root = ET.fromstring((tmp_path / "a.svg").read_text())
        hollow = sum("stroke-width" in e.attrib for e in root.iter(f"{SVG}ellipse"))
        dotted = sum("stroke-dasharray" in e.attrib for e in root.iter(f"{SVG}line"))
        counts.append((hollow, dotted))
    (hollow, none), (more, dotted) = counts
    assert none == 0
    assert more > hollow
    assert dotted >= more - hollow


@pytest.mark.parametrize("theme", ["light", "dark"])
def test_png_shows_both_sides_on_its_paper(tmp_path: Path, squat: Clip, theme: Theme) -> None:
    write_picture(tmp_path / "a.png", "squat", [("", squat)], theme)
    pixels = np.asarray(Image.open(tmp_path / "a.png"))
    for role, least in (("paper", 0.8), ("left", 0.002), ("right", 0.002)):
        assert share(pixels, PALETTES[theme][role]) > least


def test_gif_lasts_as_long_as_the_clip_and_repeats(tmp_path: Path, squat: Clip) -> None:
    short = Clip(squat.joints[:31], squat.joint_names, 30)
    write_picture(tmp_path / "a.gif", "squat", [("", short)] * 3)
    with Image.open(tmp_path / "a.gif") as gif:
        seconds = gif.n_frames * gif.info["duration"] / 1000
        assert gif.info["loop"] == 0
    assert 1 < seconds < 2


def test_mp4_plays(tmp_path: Path, squat: Clip) -> None:
    short = Clip(squat.joints[:8], squat.joint_names, 30)
    write_picture(tmp_path / "a.mp4", "squat", [("", short)])
    video = cv2.VideoCapture(str(tmp_path / "a.mp4"))
    read, frame = video.read()
    assert read
    # A video's colours are not exact, but the paper is white.
    assert (frame > 240).all(axis=-1).mean() > 0.7
    assert video.get(cv2.CAP_PROP_FPS) == 20


def test_animations_show_how_far_they_are(tmp_path: Path, squat: Clip) -> None:
    totals, passed = [], []

    def progress(drawings: Iterable[Drawing], total: int) -> Iterator[Drawing]:
        totals.append(total)
        for drawing in drawings:
            passed.append(drawing)
            yield drawing

    short = Clip(squat.joints[:9], squat.joint_names)
    for name in ("a.gif", "a.mp4"):
        write_picture(tmp_path / name, "squat", [("", short)], progress=progress)
        assert len(passed) == sum(totals)
    assert totals == [18, 18]


@pytest.mark.parametrize("suffix", [".gif", ".mp4"])
def test_nobody_waits_for_an_animation_of_hours(tmp_path: Path, squat: Clip, suffix: str) -> None:
    slow = Clip(squat.joints, squat.joint_names, fps=0.01)
    with pytest.raises(UsageError, match=r"at most 60 seconds, and a clip lasts [\d,]+; name a"):
        write_picture(tmp_path / f"a{suffix}", "squat", [("", slow)])
    write_picture(tmp_path / "a.png", "squat", [("", slow)])


@pytest.mark.parametrize("suffix", [".png", ".svg", ".gif", ".mp4"])
def test_a_picture_is_there_whole_or_not_at_all(
    tmp_path: Path, squat: Clip, suffix: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    file, other = tmp_path / f"a{suffix}", tmp_path / "other"
    other.write_text("mine")
    file.symlink_to(other)
    clip = Clip(squat.joints[:9], squat.joint_names)
    with monkeypatch.context() as patch:
        # As Ctrl-C does, when a part is there.
        patch.setattr("actioncli.report.scenes.ground_and_body", interrupted)
        with pytest.raises(KeyboardInterrupt):
            write_picture(file, "squat", [("", clip)])
    assert file.is_symlink()
    write_picture(file, "squat", [("", clip)])
    assert not file.is_symlink()
    assert other.read_text() == "mine"
    assert sorted(path.name for path in tmp_path.iterdir()) == [file.name, "other"]


def interrupted(*_: object, **__: object) -> list[Shape]:
    raise KeyboardInterrupt


def test_errors_say_what_to_do(
    tmp_path: Path, squat: Clip, monkeypatch: pytest.MonkeyPatch
) -> None:
    for suffix in (".png", ".svg", ".gif", ".mp4"):
        (tmp_path / f"folder{suffix}").mkdir()
        with pytest.raises(UsageError, match="cannot be written"):
            write_picture(
                tmp_path / f"folder{suffix}", "", [("", Clip(squat.joints[:9], squat.joint_names))]
            )
    monkeypatch.setitem(sys.modules, "PIL", None)
    with pytest.raises(UsageError, match=r"pip install 'actioncli\[report\]'"):
        write_picture(tmp_path / "a.png", "squat", [("", squat)])
    write_picture(tmp_path / "a.svg", "squat", [("", squat)])
