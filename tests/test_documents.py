"""README says what happens: its commands and its Python are run, and their output compared."""

import os
import re
import shlex
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).parent.parent
README = (ROOT / "README.md").read_text(encoding="utf-8")


def blocks(language: str) -> list[str]:
    return re.findall(rf"^```{language}\n(.*?)^```", README, re.MULTILINE | re.DOTALL)


def without_times(text: str) -> str:
    """Moments and durations differ from run to run."""
    return re.sub(r"\d{4}-\d\d-\d\dT[\d:]+Z|\d+ ms", "<time>", text)


def test_console_session(tmp_path: Path) -> None:
    environment = {**os.environ, "ACTIONCLI_HOME": str(tmp_path), "COLUMNS": "100"}
    for session in blocks("console"):
        for step in re.split(r"^\$ ", session, flags=re.MULTILINE)[1:]:
            command, _, output = step.partition("\n")
            program, *arguments = shlex.split(command)
            assert program == "actioncli"
            ran = subprocess.run(
                [sys.executable, "-m", "actioncli", *arguments],
                cwd=ROOT,
                env=environment,
                stdout=subprocess.PIPE,
                stderr=subprocess.STDOUT,
                text=True,
                check=False,
            )
            assert without_times(ran.stdout) == without_times(output), command


def test_python_snippets() -> None:
    for snippet in blocks("python"):
        ran = subprocess.run(
            [sys.executable, "-c", snippet], cwd=ROOT, capture_output=True, text=True, check=False
        )
        assert ran.returncode == 0, ran.stderr
        assert ran.stdout.split() == re.findall(r"# (.*)$", snippet, re.MULTILINE)[-1].split()


def test_exit_codes_are_those_of_the_program() -> None:
    helped = subprocess.run(
        [sys.executable, "-m", "actioncli", "--help"], capture_output=True, text=True, check=True
    ).stdout
    for code, meaning in re.findall(r"^\| (\d+) \| (.+) \|$", README, re.MULTILINE):
        assert re.search(rf"\b{code} +{re.escape(meaning)}", helped), (code, meaning)
