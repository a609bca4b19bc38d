"""`tour`: what the tool does, shown with its own commands on clips that came along."""

from __future__ import annotations

import contextlib
import io
import json
import os
import shlex
import tempfile
from collections.abc import Iterator
from typing import Any

import typer

from actioncli.cli.app import EXIT_UNEXPECTED, app
from actioncli.cli.command import Settings, command
from actioncli.cli.output import note, say
from actioncli.files import HOME_VARIABLE, examples_folder

# What is said first, the command, and the exit code that belongs to it.
_STEPS = (
    (
        "One clip of an action and its name are enough. These came along; nobody was recorded "
        "for them:\nthey are synthetic. Yours will be videos.",
        "enroll wave_right wave_right/ada.npz",
        0,
    ),
    ("", "enroll squat squat/ada.npz", 0),
    ("", "enroll jumping_jack jumping_jack/ada.npz", 0),
    ("Of a clip only the skeleton is kept.", "show wave_right", 0),
    ("A child waves, whom the tool has not seen before.", "classify wave_right/cleo.npz", 0),
    ("A tall man bows. Nobody enrolled bowing.", "classify bow/ben.npz", 1),
)
_NEXT = """
That was the tour; what it enrolled is gone again. Now with your own actions:
  actioncli enroll wave --camera 0     record one before the camera,
  actioncli enroll squat squat.mp4     or take one from a video
  actioncli classify query.mp4         which action does it show, or none?
  actioncli watch                      tell every action before the camera
  actioncli studio                     all of this on a page in the browser"""


@command
def tour(settings: Settings) -> None:
    """See what the tool does, without a camera or files.

    Three example clips that came along are enrolled in a support set of the tour's own, a clip of
    a known action and one of an unknown action are classified, and everything is deleted again.
    Your own support set is not touched. With --json, the result of a step is the document of its
    command.

    \b
    Examples:
      actioncli tour

    \b
    JSON keys:
      steps
      steps[]: command, exit_code, result
    """
    steps = []
    # The commands run where the clips lie, so that what is shown is what is run.
    with _own_home(), contextlib.chdir(examples_folder()):
        for words, line, expected in _STEPS:
            if not (settings.json or settings.quiet):
                say(f"\n{words}\n" if words else "")
                say(f"$ actioncli {line}")
            code, result = _ran(settings, line)
            if code != expected:
                raise typer.Exit(code or EXIT_UNEXPECTED)
            steps.append({"command": line, "exit_code": code, "result": result})
    settings.answer({"steps": steps}, _NEXT)


def _ran(settings: Settings, line: str) -> tuple[int, Any]:
    """Run a command; its exit code, and its document where JSON is wanted.

    Its notes, on what the files leave open, are no part of the tour.
    """
    asked = [f"--{name}" for name in ("json", "quiet", "debug") if getattr(settings, name)]
    written, told = io.StringIO(), io.StringIO()
    answer = contextlib.redirect_stdout(written) if settings.json else contextlib.nullcontext()
    code: Any = 0
    with answer, contextlib.redirect_stderr(told):
        try:
            app([*shlex.split(line), *asked], prog_name="actioncli")
        except SystemExit as ended:
            code = ended.code
    for each in told.getvalue().splitlines():
        if not each.startswith("note: "):
            note(each)
    return code, json.loads(written.getvalue()) if settings.json else None


@contextlib.contextmanager
def _own_home() -> Iterator[None]:
    """A home of the tool for the while; nothing of the user's is read or written."""
    before = {name: text for name, text in os.environ.items() if name.startswith("ACTIONCLI_")}
    with tempfile.TemporaryDirectory(prefix="actioncli-tour-") as home:
        for name in before:
            del os.environ[name]
        os.environ[HOME_VARIABLE] = home
        try:
            yield
        finally:
            del os.environ[HOME_VARIABLE]
            os.environ.update(before)
