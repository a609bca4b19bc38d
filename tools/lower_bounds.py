"""Print `name==lower bound` for every requirement of a user's install and of its extras.

    pip install $(python tools/lower_bounds.py)

is the oldest set of versions that pyproject.toml allows; what passes with it and with the newest
passes with those between, as far as a test can tell.
"""

from __future__ import annotations

import re
import tomllib
from pathlib import Path

EXTRAS = ("ray", "report", "studio", "train")


def main() -> None:
    """One requirement a line."""
    card = Path(__file__).parent.parent / "pyproject.toml"
    project = tomllib.loads(card.read_text(encoding="utf-8"))["project"]
    extras = project["optional-dependencies"]
    for requirement in [*project["dependencies"], *(r for name in EXTRAS for r in extras[name])]:
        found = re.fullmatch(r"([\w.\[\]-]+)[>=]=([\d.]+)(,<[\d.]+)?", requirement)
        if found is None:
            raise SystemExit(f"{requirement}: no lower bound is told by it")
        print(f"{found[1]}=={found[2]}")


if __name__ == "__main__":
    main()
