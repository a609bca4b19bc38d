"""Draw the calibration of `actioncli evaluate --json` as the picture in the model card.

    python tools/plot_calibration.py FIGURES.json weights/calibration.svg

The plot is light or dark as its viewer is.
"""

from __future__ import annotations

import argparse
import json
import re
from importlib.resources import files
from pathlib import Path
from typing import Any

from actioncli.report.plots import HEIGHT, SHARES, WIDTH, Axis, Plot


def calibration(figures: dict[str, Any]) -> str:
    """The first mean of the figures as an SVG document."""
    mean = figures["means"][0]
    error = mean["expected_calibration_error"]
    plot = Plot(
        f"Calibration, expected error {error:.3f}",
        Axis("confidence", 0, 1, SHARES),
        Axis("queries right", 0, 1, SHARES, percent=True),
    )
    bins = mean["reliability"]
    xs, ys = ([each[key] for each in bins] for key in ("confidence", "accuracy"))
    plot.line([0, 1], [0, 1], 5, "confidence that is right as often as it says")
    radii = [2.5 + 14 * each["share"] ** 0.5 for each in bins]
    plot.line(xs, ys, 0, figures["scorer"], radii)
    drawn = re.search(r"<svg (.*?)>(.*?)</svg>", plot.html(), re.DOTALL)
    assert drawn is not None
    css = files("actioncli.report").joinpath("page.css").read_text(encoding="utf-8")
    colours = css[: css.index("* {")]
    text = re.search(r"svg text \{.*?\}", css)
    assert text is not None
    return (
        f'<svg xmlns="http://www.w3.org/2000/svg" width="{1.5 * WIDTH:g}" '
        f'height="{1.5 * HEIGHT:g}" {drawn[1]}>\n<style>\n{colours}{text[0]}\n</style>\n'
        f'<rect width="100%" height="100%" fill="var(--paper)"/>\n{drawn[2]}'
        '<text x="54" y="26">queries right</text></svg>\n'
    )


def main() -> None:
    """Write the picture."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("figures", type=Path)
    parser.add_argument("out", type=Path)
    asked = parser.parse_args()
    figures = json.loads(asked.figures.read_text(encoding="utf-8"))
    asked.out.write_text(calibration(figures), encoding="utf-8")


if __name__ == "__main__":
    main()
