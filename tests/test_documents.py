"""Documents say what happens: their commands and their Python are run, and the output compared;
commands that need videos or a camera are parsed, and links lead somewhere."""

import ast
import contextlib
import io
import json
import os
import re
import shlex
import shutil
import subprocess
import sys
from pathlib import Path
from typing import Any

import make_figures
import make_reference
import pytest
import typer

from actioncli.cli.app import COMMANDS, app

ROOT = Path(__file__).parent.parent
PAGES = [ROOT / "README.md", *sorted((ROOT / "docs").rglob("*.md"))]
NAMES = [str(page.relative_to(ROOT)) for page in PAGES]
SUMMARY = re.compile(r"\d{4}-\d\d-\d\dT[\d:]+Z|\(\d+ s\)|\d+ ms")


@pytest.fixture(scope="module")
def made() -> dict[Path, str]:
    """The pages that are made from the code."""
    return {ROOT / "docs" / name: page() for name, page in make_reference.PAGES.items()}


def blocks(page: Path, *languages: str) -> list[tuple[str, str]]:
    """Language and content of the fenced blocks of some languages, in their order."""
    text = page.read_text(encoding="utf-8")
    pattern = rf"^```({'|'.join(languages)})\n(.*?)^```"
    return re.findall(pattern, text, re.MULTILINE | re.DOTALL)


def without_times(text: str) -> str:
    """Moments and durations differ from run to run."""
    return SUMMARY.sub("<time>", text)


@pytest.mark.parametrize("name", NAMES)
def test_sessions_and_snippets(name: str, tmp_path: Path) -> None:
    """One after another, as a reader would: what one writes, the next may read."""
    shutil.copytree(ROOT / "examples", tmp_path / "examples")
    place = {**os.environ, "ACTIONCLI_HOME": str(tmp_path / "home"), "COLUMNS": "100"}

    def run(*words: str, error: int) -> str:
        done = subprocess.run(
            [sys.executable, *words],
            cwd=tmp_path,
            env=place,
            stdout=subprocess.PIPE,
            stderr=error,
            text=True,
            check=False,
        )
        return done.stdout

    for language, content in blocks(ROOT / name, "console", "python"):
        if language == "python":
            if "import pandas" in content:
                pytest.importorskip("pandas")
            wanted = re.findall(r"# (.*)$", content, re.MULTILINE)[-1]
            printed = run("-c", content, error=subprocess.STDOUT)
            assert printed.split() == wanted.split(), content
            continue
        for step in re.split(r"^\$ ", content, flags=re.MULTILINE)[1:]:
            command, _, output = step.partition("\n")
            program, *arguments = shlex.split(command)
            assert program == "actioncli"
            printed = run("-m", "actioncli", *arguments, error=subprocess.STDOUT)
            assert without_times(printed) == without_times(output), command


def understood(line: str) -> None:
    """Fails where a command line has a command or an option that there is not."""
    _, name, *words = shlex.split(line)
    if name.startswith("--") or "--help" in words:
        return
    group: Any = typer.main.get_command(app)
    command = group.get_command(typer.Context(group), name)
    assert command is not None, line
    with command.make_context(name, words, parent=typer.Context(group)):
        pass


def commands_of(text: str) -> list[str]:
    """The calls of the program in lines of a shell: what comes before a pipe or a comment."""
    found = [re.split(r"\s\||\s#", line)[0].strip() for line in text.splitlines()]
    return [line for line in found if line.startswith("actioncli ")]


@pytest.mark.parametrize("name", NAMES)
def test_commands_are_understood(name: str) -> None:
    lines = [line for _, content in blocks(ROOT / name, "sh") for line in commands_of(content)]
    # And those within a sentence, but for abbreviations.
    text = (ROOT / name).read_text(encoding="utf-8")
    lines += [line for line in re.findall(r"`(actioncli [^`]+)`", text) if "COMMAND" not in line]
    for line in lines:
        understood(line)


def test_commands_in_the_help_are_understood(made: dict[Path, str]) -> None:
    """Examples in columns have what they do after two blanks, or in brackets."""
    page = made[ROOT / "docs/commands.md"]
    lines = [re.split(r"  +", line.strip())[0] for line in page.splitlines()]
    found = [line for line in lines if line.startswith("actioncli ")]
    assert len(found) > 50
    for line in found:
        understood(line)


def test_commands_that_are_not_there_are_found() -> None:
    assert commands_of("actioncli watch --json | cat  # x\npip install .") == [
        "actioncli watch --json"
    ]
    for line in ("actioncli classify a.mp4 --no-such", "actioncli wach", "actioncli classify"):
        with pytest.raises((typer.exceptions.TyperException, AssertionError)):
            understood(line)


def anchors(text: str) -> set[str]:
    """What headings are called in links."""
    headings = re.findall(r"^#+ (.+)$", re.sub(r"^```.*?^```", "", text, flags=re.M | re.S), re.M)
    plain = [re.sub(r"[^\w\s-]", "", heading).strip().lower() for heading in headings]
    return {re.sub(r"[\s]+", "-", heading) for heading in plain}


@pytest.mark.parametrize("name", NAMES)
def test_links_lead_somewhere(name: str, made: dict[Path, str]) -> None:
    page = ROOT / name
    text = re.sub(r"^```.*?^```", "", page.read_text(encoding="utf-8"), flags=re.M | re.S)
    for link in re.findall(r"\]\(([^)\s]+)\)", text):
        if "://" in link:
            continue
        path, _, anchor = link.partition("#")
        target = (page.parent / path).resolve() if path else page
        assert target in made or target.exists(), link
        # What the site holds may lead to nothing else.
        if page.name != "README.md":
            assert target.is_relative_to(ROOT / "docs"), link
        if anchor:
            content = made.get(target) or target.read_text(encoding="utf-8")
            assert anchor in anchors(content), link


def test_pages_of_the_site_are_all_in_its_menu() -> None:
    menu = re.findall(r"^ +- .*: (\S+\.md)$", (ROOT / "mkdocs.yml").read_text(), re.MULTILINE)
    written = [str(page.relative_to(ROOT / "docs")) for page in PAGES[1:]]
    assert sorted(menu) == sorted([*written, *make_reference.PAGES])


def test_pages_from_the_code_have_every_command_and_every_name(made: dict[Path, str]) -> None:
    import actioncli

    commands, python = made[ROOT / "docs/commands.md"], made[ROOT / "docs/python.md"]
    assert {f"## {name}" for name in COMMANDS} <= set(commands.splitlines())
    assert "--help" in commands
    for name in actioncli.__all__:
        if name != "__version__":
            assert f"### {name}\n" in python or f"| `{name}` |" in python, name
    assert "<" not in re.sub(r"^```.*?^```|`[^`]*`", "", python, flags=re.M | re.S)


def test_site_is_built_and_asks_for_nothing(tmp_path: Path) -> None:
    pytest.importorskip("mkdocs")
    pytest.importorskip("material")
    words = ["-m", "mkdocs", "build", "--strict", "--quiet", "--site-dir", str(tmp_path)]
    place = {**os.environ, "NO_MKDOCS_2_WARNING": "1"}
    subprocess.run([sys.executable, *words], cwd=ROOT, env=place, check=True)
    pages = {str(page.relative_to(tmp_path)) for page in tmp_path.rglob("*.html")}
    assert {"index.html", "commands.html", "recipes/robot.html"} <= pages
    for page in pages:
        text = (tmp_path / page).read_text(encoding="utf-8")
        assert not re.search(r"""<(?:script|link|img|iframe)[^>]*(?:src|href)=["']?https?:""", text)


def test_pictures_are_what_the_tool_does(tmp_path: Path) -> None:
    """`python tools/make_figures.py` draws them anew."""
    make_figures.main(tmp_path)
    for drawn in tmp_path.iterdir():
        kept = ROOT / "docs" / drawn.name
        assert drawn.read_text(encoding="utf-8") == kept.read_text(encoding="utf-8"), drawn.name
        assert kept.stat().st_size < 1_000_000
    assert {drawn.name for drawn in tmp_path.iterdir()} == {"film.svg", "attention.svg"}


def test_readme_is_short() -> None:
    assert len((ROOT / "README.md").read_text(encoding="utf-8").splitlines()) <= 110


def test_exit_codes_are_those_of_the_program() -> None:
    helped = subprocess.run(
        [sys.executable, "-m", "actioncli", "--help"], capture_output=True, text=True, check=True
    ).stdout
    listed = (ROOT / "docs/index.md").read_text(encoding="utf-8")
    rows = re.findall(r"^\| (\d+) \| (.+) \|$", listed, re.MULTILINE)
    assert len(rows) == 9
    for code, meaning in rows:
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
