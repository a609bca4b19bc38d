"""`watch --exec`: what a label holds never becomes part of a command."""

import json
import sys
from pathlib import Path

import pytest

from actioncli.errors import UsageError
from actioncli.live.commands import CommandRunner
from actioncli.live.events import Event

LABELS = [
    "$(touch pwned)", "`touch pwned`", "; touch pwned", "| touch pwned", "&& touch pwned",
    "> pwned", "'; touch pwned; '", '"; touch pwned; "', "${IFS}", "$ACTIONCLI_START", "--help",
    "%PATH%", "*", "~", "\\", "#", "a b", "挥手",
]  # fmt: skip
# Writes its arguments and what it was told, as JSON.
PROGRAM = """
import json, os, sys
told = {key: value for key, value in os.environ.items() if key.startswith("ACTIONCLI_")}
open("told", "w").write(json.dumps([sys.argv[1:], told]))
"""


@pytest.mark.parametrize("label", LABELS)
def test_a_label_arrives_as_it_is_in_the_environment_alone(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, label: str
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("program.py").write_text(PROGRAM)
    run = CommandRunner(f"{sys.executable} program.py 'a b' $ACTIONCLI_LABEL ;", print)
    run(Event(label, 1.0, 2.5, 0.75))
    run.close()
    arguments, told = json.loads(Path("told").read_text())
    # No shell reads the command either: what looks like a variable is a word.
    assert arguments == ["a b", "$ACTIONCLI_LABEL", ";"]
    assert told["ACTIONCLI_LABEL"] == label
    assert told["ACTIONCLI_CONFIDENCE"] == "0.750"
    assert sorted(path.name for path in tmp_path.iterdir()) == ["program.py", "told"]


def test_a_shell_that_the_user_asks_for_gets_the_label_as_a_variable(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """As SECURITY.md says how: quoted, it is one word."""
    monkeypatch.chdir(tmp_path)
    run = CommandRunner("""sh -c 'printf %s "$ACTIONCLI_LABEL" > told'""", print)
    run(Event("$(touch pwned); `touch pwned`", 1.0, 2.5, 0.75))
    run.close()
    assert Path("told").read_text() == "$(touch pwned); `touch pwned`"
    assert not Path("pwned").exists()


def test_what_the_system_cannot_run_does_not_end_watching(
    tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    script = tmp_path / "script"
    script.write_text("echo no first line that names a program\n")
    script.chmod(0o700)
    run = CommandRunner(str(script), lambda line: print(line, file=sys.stderr))
    run(Event("wave", 1.0, 2.5, 0.75))
    script.unlink()
    run(Event("wave", 3.0, 4.5, 0.75))
    run.close()
    first, second = capfd.readouterr().err.splitlines()
    assert first == f"error: --exec {script}: cannot be run: Exec format error."
    assert second == f"error: --exec {script}: cannot be run: No such file or directory."


@pytest.mark.parametrize("line", ["", "  ", "no-such-program-anywhere", "echo 'open"])
def test_what_is_no_command_is_told_before_anything_is_watched(line: str) -> None:
    with pytest.raises(UsageError, match="--exec"):
        CommandRunner(line, print)
