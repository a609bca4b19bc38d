"""The pages of the documentation that are made from the code, while mkdocs builds it: commands.md,
the help of every command as it is printed, and python.md, the docstrings of every public name."""

from __future__ import annotations

import enum
import inspect
import os
import re
from pathlib import Path
from typing import TYPE_CHECKING, Any

from typer.testing import CliRunner

import actioncli
from actioncli.cli.app import COMMANDS, app

if TYPE_CHECKING:
    from mkdocs.structure.files import Files

# What begins a section of a docstring.
_SECTION = re.compile(r"^(Args|Attributes|Returns|Raises|Yields):$")
# `name: what it is`, or `name, name: what they are`; classes of errors are names too.
_ENTRY = re.compile(r"^([\w*]+(?:, [\w*]+)*): (.*)$")


def commands() -> str:
    """The page of all commands."""
    # Nothing of this machine may show in defaults.
    place: dict[str, str | None] = {
        name: None for name in os.environ if name.startswith("ACTIONCLI_")
    } | {"TERM": "dumb", "ACTIONCLI_HOME": os.devnull}

    def help_of(*words: str) -> str:
        line = [*words, "--help"]
        return CliRunner(env=place).invoke(app, line, prog_name="actioncli").stdout.strip()

    page = ["# Commands", "What `actioncli COMMAND --help` says."]
    page += ["## actioncli", fenced(help_of())]
    for name in COMMANDS:
        page += [f"## {name}", fenced(help_of(name))]
    return "\n\n".join(page) + "\n"


def fenced(text: str) -> str:
    """As it is."""
    return f"```text\n{text}\n```"


def python() -> str:
    """The page of all public names: functions, classes, errors."""
    page = [
        "# Python reference",
        "What `import actioncli` offers; made from the docstrings by `tools/make_reference.py`. "
        "[Start here](index.md) has a first example, and the repository a notebook, "
        "`examples/first_steps.ipynb`.",
    ]
    # What most people need stands first.
    names = sorted(actioncli.__all__, key=lambda name: (name not in ("open", "Actions"), name))
    found = [(name, getattr(actioncli, name)) for name in names]
    functions = [(name, each) for name, each in found if inspect.isfunction(each)]
    classes = [(name, each) for name, each in found if inspect.isclass(each)]
    errors = [(name, each) for name, each in classes if issubclass(each, Exception)]
    page.append("## Functions")
    seen = set()
    for name, each in functions:
        if each in seen:
            page += [f"### {name}", f"Another name of `{each.__name__}`."]
            continue
        seen.add(each)
        page += documented(f"### {name}", f"actioncli.{name}", each)
    page.append("## Classes")
    for name, each in classes:
        if issubclass(each, Exception):
            continue
        page += documented(f"### {name}", "", each)
        for member, value in members(each):
            title = f"#### {name}.{member}"
            page += documented(title, f"{name[:1].lower()}{name[1:]}.{member}", value)
    page += ["## Errors", "All derive from `ActionCliError`, and so does what commands end with."]
    rows = [f"| `{n}` | {inspect.getdoc(e)} | {e.exit_code} |" for n, e in errors]
    page.append("\n".join(["| error | what it says | exit code |", "| --- | --- | --- |", *rows]))
    return "\n\n".join(page) + "\n"


def members(of: type) -> list[tuple[str, object]]:
    """Public methods and properties of a class itself, in the order of the code."""
    found = []
    for name, value in vars(of).items():
        plain = value.__func__ if isinstance(value, classmethod | staticmethod) else value
        if name.startswith("_") or not (inspect.isfunction(plain) or isinstance(plain, property)):
            continue
        if inspect.getdoc(plain):
            found.append((name, plain))
    return found


def documented(title: str, called: str, value: object) -> list[str]:
    """A heading, how it is called, and the docstring."""
    shown = [title]
    if inspect.isfunction(value):
        shown.append(f"```py\n{called}{signature(value)}\n```")
    return shown + docstring(inspect.getdoc(value) or "")


def signature(function: object) -> str:
    """`(label, *clips, note='')`: without types, which the text tells where they matter."""
    assert callable(function)
    bare = []
    for parameter in inspect.signature(function).parameters.values():
        if parameter.name in ("self", "cls"):
            continue
        default = parameter.default
        if isinstance(default, enum.Enum):
            parameter = parameter.replace(default=default.value)
        bare.append(parameter.replace(annotation=inspect.Parameter.empty))
    return str(inspect.Signature(bare))


def docstring(text: str) -> list[str]:
    """Paragraphs of markdown; the entries of a section become a list."""
    found: list[str] = []
    section, entries = "", list[str]()

    def close() -> None:
        if entries:
            found.append("\n".join(entries))
            entries.clear()

    for paragraph in text.split("\n\n"):
        first, *rest = paragraph.splitlines()
        heading = _SECTION.match(first)
        lines = rest if heading else [first, *rest]
        if heading:
            close()
            section = heading[1]
            found.append(f"**{section}**")
        elif not first.startswith(" "):
            close()
            section = ""
        if not section:
            found.append(" ".join(line.strip() for line in lines))
            continue
        for line in map(str.strip, lines):
            entry = _ENTRY.match(line)
            if entry:
                names = ", ".join(f"`{name}`" for name in entry[1].split(", "))
                entries.append(f"- {names}: {entry[2]}")
            elif entries:
                entries[-1] += f" {line}"
            else:
                entries.append(line)
    close()
    return found


def on_files(files: Files, config: Any) -> None:
    """What mkdocs calls when it has found the written pages."""
    from mkdocs.structure.files import File

    for name, page in PAGES.items():
        files.append(File.generated(config, name, content=page()))
    # Wide tables say that they go on, as in a report.
    script = Path(actioncli.__file__).with_name("report") / "scroll.js"
    files.append(File.generated(config, "scroll.js", content=script.read_text(encoding="utf-8")))


PAGES = {"commands.md": commands, "python.md": python}
