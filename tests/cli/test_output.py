"""Escaping, tables, numbers."""

import json
import sys
import unicodedata

import pytest
from hypothesis import given
from hypothesis import strategies as st

from actioncli.cli import output
from actioncli.cli.output import plural, printable, progress, steps, table, write_json

from .conftest import at_terminal


@given(st.text(alphabet=st.characters(categories=["C", "Z", "L", "M"])))
def test_nothing_that_steers_a_terminal_is_printed(text: str) -> None:
    shown = printable(text)
    assert not [c for c in shown if unicodedata.category(c)[0] == "C"]
    assert shown.splitlines() in ([shown], [])


def test_what_people_read() -> None:
    assert printable("grüßen 手") == "grüßen 手"
    assert printable("a\x1b[2J\n\u202e\udc80\u2028") == r"a\x1b[2J\n\u202e\udc80\u2028"
    assert [plural(n, "clip") for n in (0, 1, 2)] == ["0 clips", "1 clip", "2 clips"]
    assert table(("a", "b"), [], indent="  ") == "  a  b"
    rows = [("手", 1, 0.5, "x"), ("e\u0301tude", 10, 12.25, "")]
    assert table(("action", "n", "m", "note"), rows) == (
        "action   n      m  note\n手       1   0.50  x\ne\u0301tude   10  12.25"
    )


def test_json_is_ascii_and_its_numbers_are_short_and_finite(
    capsys: pytest.CaptureFixture[str],
) -> None:
    values = {"a": [0.123456789, 1234567.0, 1234567], "b": (float("nan"), {"c": float("inf")})}
    write_json({"label": "手\x9b\x1b\udc80", **values})
    written = capsys.readouterr().out
    assert written.isascii()
    assert written.replace("\n", "").isprintable()
    assert json.loads(written) == {
        "label": "手\x9b\x1b\udc80",
        "a": [0.123457, 1234570.0, 1234567],
        "b": [None, {"c": None}],
    }


def test_progress_passes_everything_on_and_is_silent_without_a_terminal(
    capsys: pytest.CaptureFixture[str],
) -> None:
    assert list(progress([1, 2, 3], "Counting")) == [1, 2, 3]
    with steps(shown=True) as step:
        assert step is None
    assert capsys.readouterr() == ("", "")


EACH = """
import time
from actioncli.cli import output
from actioncli.cli.output import progress
output._PATIENCE_SECONDS = 0.3
for seconds in progress([{seconds}, 0, 0], "Sleeping"):
    time.sleep(seconds)
"""
STEPS = """
import time
from actioncli.cli import output
from actioncli.cli.output import steps
output._PATIENCE_SECONDS = 0.3
with steps(shown=True) as step:
    step("Waking", 0, 2)
    time.sleep({seconds})
    step("Sleeping", 1, 2)
    step("Sleeping", 2, 2)
"""


@pytest.mark.parametrize("script", [EACH, STEPS], ids=["each", "steps"])
def test_progress_is_drawn_on_a_terminal_once_it_takes_long(script: str) -> None:
    def drawn(seconds: float) -> bytes:
        words = [sys.executable, "-c", script.format(seconds=seconds)]
        done, shown = at_terminal(words, "stderr")
        assert (done.returncode, done.stdout) == (0, "")
        return shown

    assert drawn(0) == b""
    assert b"Sleeping" in drawn(0.4)
    assert 1 <= output._PATIENCE_SECONDS <= 2
