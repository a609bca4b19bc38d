"""Draw what the documents show, from the example clips: `python tools/make_figures.py [FOLDER]`.

docs/film.svg is the moving picture at the top of README: enrol, recognise, reject, in the terminal
and as skeletons. What its terminal shows is what the commands print; only their notes are left out.
docs/attention.svg is which moments of a squat are compared with which of another's."""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
from html import escape
from pathlib import Path

import numpy as np

from actioncli import Recognizer, read_clip
from actioncli.clips.write import write_clip
from actioncli.recognition.explanation import explain
from actioncli.report.figure import figure, project
from actioncli.report.plots import SHARES, Axis, Plot

ROOT = Path(__file__).resolve().parent.parent
# Example, as which file of the film, the command, seconds it takes.
SCENES = (
    ("wave_right/ada", "wave.npz", "enroll wave wave.npz", 4.5),
    ("squat/ada", "squat.npz", "enroll squat squat.npz", 4.5),
    ("wave_right/cleo", "child.npz", "classify child.npz", 5.5),
    ("bow/ben", "bow.npz", "classify bow.npz", 6.5),
)
WIDTH, HEIGHT, STAGE = 960, 330, 715  # the stage of the skeletons begins at this column
LINE, LEFT, TOP = 19, 18, 34
ANSWER = 1.2  # seconds from a command to its answer
SCALE, GROUND = 118, 265  # pixels a metre
RATE = 12  # poses a second
YAW = 0.75  # radians that bodies are turned, so that a bow is seen
COLOURS = {"left": "#56b4e9", "right": "#f29544", "middle": "#d5dade"}
STYLE = """<style>
svg { --paper: #fff; --muted: #586069; --line: #d4d9de; --s0: #0072b2; background: var(--paper); }
text { fill: var(--muted); font: 12px system-ui, sans-serif; }
@media (prefers-color-scheme: dark) {
  svg { --paper: #14171a; --muted: #a5adb5; --line: #373e45; --s0: #56b4e9; }
}
</style>"""
YES, INK, MUTED = "#3fb950", "#e8eaed", "#9aa4ae"


def main(folder: Path) -> None:
    """Draw both."""
    (folder / "film.svg").write_text(film(), encoding="utf-8")
    (folder / "attention.svg").write_text(attention(), encoding="utf-8")


def attention() -> str:
    """The matrix, which follows the reader's colours."""
    query, example = (read_clip(ROOT / f"examples/squat/{name}.npz") for name in ("ben", "ada"))
    plot = Plot(
        "Attention between moments of two squats",
        Axis("way through ada's squat, the example", 0, 1, SHARES, percent=True),
        Axis("way through ben's", 0, 1, SHARES, percent=True),
    )
    plot.cells(explain(Recognizer(), query, [example]).attention, 0)
    drawing = plot.html()
    drawing = drawing[drawing.index("<svg") : drawing.index("</svg>") + 6]
    opened = '<svg xmlns="http://www.w3.org/2000/svg" width="480" '
    return drawing.replace("<svg ", opened, 1).replace(">", f">{STYLE}", 1) + "\n"


def film() -> str:
    """Run the commands, and draw."""
    length = sum(scene[3] for scene in SCENES)
    lines: list[str] = []
    bodies: list[str] = []
    row, begin = 0, 0.0
    for (example, name, command, seconds), printed in zip(SCENES, run(), strict=True):
        lines.append(line(row, f"$ actioncli {command}", INK, begin, length))
        verdict = None
        for text in printed:
            row += 1
            colour = YES if text[0] == "✓" else MUTED
            if text[0] in "✓✗":
                verdict = (" ".join(text.split()[:2]), colour)
            lines.append(line(row, text, colour, begin + ANSWER, length))
        row += 2
        bodies.append(body(ROOT / f"examples/{example}.npz", name, begin, seconds, length, verdict))
        begin += seconds
    told = (
        "Two actions are enrolled from one clip each; a child's wave is recognised, a bow rejected."
    )
    return (
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {WIDTH} {HEIGHT}" role="img" '
        f'aria-label="{escape(told)}"><title>{escape(told)}</title>\n'
        "<style>text{font:14px ui-monospace,SFMono-Regular,Menlo,Consolas,monospace;"
        "white-space:pre}path{fill:none;stroke-width:5;stroke-linecap:round;"
        "stroke-linejoin:round}.name{font-size:13px}.verdict{font-size:20px}</style>\n"
        f'<rect width="{WIDTH}" height="{HEIGHT}" rx="10" fill="#14171a"/>\n'
        f'<path d="M{STAGE} 20V{HEIGHT - 20}" stroke="#373e45" style="stroke-width:1"/>\n'
        + "\n".join([*lines, *bodies])
        + "\n</svg>\n"
    )


def run() -> list[list[str]]:
    """What each command prints, in a support set of its own."""
    with tempfile.TemporaryDirectory() as home:
        for example, name, *_ in SCENES:
            write_clip(Path(home) / name, read_clip(ROOT / f"examples/{example}.npz"))
        place = {**os.environ, "ACTIONCLI_HOME": home, "PYTHONIOENCODING": "utf-8"}
        printed = []
        for _, _, command, _ in SCENES:
            done = subprocess.run(
                [sys.executable, "-m", "actioncli", *command.split()],
                cwd=home, env=place, text=True, encoding="utf-8", check=False, capture_output=True,
            )  # fmt: skip
            # Of a rejected clip, what would have had to be alike.
            why = [each for each in done.stderr.splitlines() if each.startswith("With ")]
            printed.append(done.stdout.splitlines() + wrapped(why))
        return printed


def wrapped(lines: list[str], width: int = 68) -> list[str]:
    """Long lines broken at words."""
    found = []
    for text in lines:
        while len(text) > width:
            at = text.rindex(" ", 0, width)
            found.append(text[:at])
            text = "  " + text[at + 1 :]
        found.append(text)
    return found


def shown(begin: float, end: float, length: float) -> str:
    """An animation that shows what it stands in between two moments of the loop."""
    times = f"0;{begin / length:.4f};{end / length:.4f}"
    return (
        f'<animate attributeName="opacity" dur="{length}s" repeatCount="indefinite" '
        f'calcMode="discrete" values="0;1;0" keyTimes="{times}"/>'
    )


def line(row: int, text: str, colour: str, begin: float, length: float) -> str:
    """A line of the terminal, from `begin` on."""
    return (
        f'<text x="{LEFT}" y="{TOP + LINE * row}" fill="{colour}">'
        f"{shown(begin, length, length)}{escape(text)}</text>"
    )


def body(
    clip: Path, name: str, begin: float, seconds: float, length: float, verdict: tuple | None
) -> str:
    """The skeleton of a clip in motion, its file's name and, later, the verdict."""
    drawn = figure(read_clip(clip))
    points = project(drawn.points, YAW)
    middle = (STAGE + WIDTH) / 2
    lasting = min(seconds, drawn.duration)
    times = np.arange(0, lasting, 1 / RATE)
    frames = [drawn.at(float(time)) for time in times]
    keys = ";".join(["0", *(f"{(begin + time) / length:.4f}" for time in times), "1"])
    paths = []
    for side, colour in COLOURS.items():
        poses = []
        for frame in (frames[0], *frames, frames[-1]):
            at = [
                (round(middle + SCALE * float(x)), round(GROUND - SCALE * float(y)))
                for x, y in points[frame]
            ]
            poses.append(
                "".join(
                    "M{} {}L{} {}".format(*at[a], *at[b]) for a, b, s in drawn.bones if s == side
                )
            )
        paths.append(
            f'<path stroke="{colour}" d="{poses[0]}"><animate attributeName="d" dur="{length}s" '
            f'repeatCount="indefinite" values="{";".join(poses)}" keyTimes="{keys}"/></path>'
        )
    head = project(drawn.points[:, drawn.head], YAW)
    for axis, of in (
        ("cx", lambda p: middle + SCALE * p[0]),
        ("cy", lambda p: GROUND - SCALE * p[1]),
    ):
        values = ";".join(f"{of(head[frame]):.0f}" for frame in (frames[0], *frames, frames[-1]))
        paths.append(
            f'<animate attributeName="{axis}" dur="{length}s" repeatCount="indefinite" '
            f'values="{values}" keyTimes="{keys}"/>'
        )
    *bones, across, up = paths
    bones.append(f'<circle r="9" fill="{COLOURS["middle"]}">{across}{up}</circle>')
    placed = f'x="{middle}" text-anchor="middle"'
    said = f'<text class="name" y="{TOP}" {placed} fill="{MUTED}">{name}</text>'
    if verdict:
        text, colour = verdict
        said += (
            f'<g>{shown(begin + ANSWER, begin + seconds, length)}<text class="verdict" '
            f'y="{HEIGHT - 18}" {placed} fill="{colour}">{text}</text></g>'
        )
    return f"<g>{shown(begin, begin + seconds, length)}{''.join(bones)}{said}</g>"


if __name__ == "__main__":
    main(Path(sys.argv[1]) if len(sys.argv) > 1 else ROOT / "docs")
