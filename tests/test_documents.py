"""Documents say what happens: their commands and their Python are run, and the output compared."""

import ast
import contextlib
import io
import json
import os
import re
import shlex
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

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


def shown(code: str, names: dict[str, Any]) -> str:
    """What a cell of a notebook prints, and the value of its last line."""
    lines = ast.parse(code).body
    last = lines.pop() if isinstance(lines[-1], ast.Expr) else None
    printed = io.StringIO()
    with contextlib.redirect_stdout(printed):
        exec(compile(ast.Module(lines, []), "cell", "exec"), names)
        value = eval(compile(ast.Expression(last.value), "cell", "eval"), names) if last else None
    return printed.getvalue() + ("" if value is None else repr(value))


def test_notebook(monkeypatch: pytest.MonkeyPatch) -> None:
    """Every cell says what the file shows; one that is run anew is written by
    `jupyter execute --inplace examples/first_steps.ipynb`."""
    pytest.importorskip("pandas")
    monkeypatch.chdir(ROOT)
    notebook = json.loads((ROOT / "examples/first_steps.ipynb").read_text(encoding="utf-8"))
    names: dict[str, Any] = {}
    for cell in notebook["cells"]:
        if cell["cell_type"] != "code":
            continue
        kept = [each.get("text") or each["data"]["text/plain"] for each in cell["outputs"]]
        code = "".join(cell["source"])
        assert shown(code, names).split() == "".join(map("".join, kept)).split(), code
        assert "error" not in [each["output_type"] for each in cell["outputs"]]
