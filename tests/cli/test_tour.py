"""`tour`."""

import json
import os
import tempfile
from pathlib import Path

import pytest

from actioncli.cli import tour
from actioncli.files import HOME_VARIABLE

from .conftest import invoke, run


def test_the_tour_shows_what_it_promises(home: Path, tmp_path: Path) -> None:
    # What the user set is not heeded.
    place = {**os.environ, "TMPDIR": str(tmp_path / "temporary"), "ACTIONCLI_TAU": "1"}
    (tmp_path / "temporary").mkdir()
    # From a terminal's folder that holds none of the clips.
    done = run("tour", env=place, cwd=tmp_path, timeout=20)
    assert done.returncode == 0, done.stderr
    commands = [line[12:] for line in done.stdout.splitlines() if line.startswith("$ actioncli ")]
    assert commands == [line for _, line, _ in tour._STEPS]
    assert "✓ wave_right " in done.stdout
    assert done.stdout.index("✗ rejected ") < done.stdout.index("actioncli watch")
    assert "both arms as in the example" in done.stderr
    # Nothing of the user's was touched, and nothing is left.
    assert not home.exists()
    assert not list((tmp_path / "temporary").iterdir())


def test_as_json_it_is_what_its_commands_say(home: Path) -> None:
    before = Path.cwd()
    steps = json.loads(invoke("tour", "--json").stdout)["steps"]
    assert [step["exit_code"] for step in steps] == [0, 0, 0, 0, 0, 1]
    assert steps[4]["result"]["clips"][0]["label"] == "wave_right"
    assert steps[5]["result"]["rejected"] == 1
    assert (Path.cwd(), os.environ[HOME_VARIABLE]) == (before, str(home))


def test_without_words_it_is_the_results_alone() -> None:
    assert "$" not in invoke("tour", "--quiet").stdout


def test_a_step_that_goes_wrong_ends_it(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setattr(tour, "examples_folder", lambda: tmp_path)
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    monkeypatch.delenv(HOME_VARIABLE)
    result = invoke("tour")
    assert result.exit_code == 3
    assert result.stderr.startswith("error: wave_right/ada.npz")
    assert HOME_VARIABLE not in os.environ
    assert not list(tmp_path.glob("actioncli-tour-*"))
