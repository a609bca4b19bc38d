"""The `actioncli` application: its commands, its global options, and how it ends.

A command's module is loaded when that command runs, and modules import what they need inside
their functions: `list-support` answers before numpy could have been imported.
"""

from __future__ import annotations

import contextlib
import io
import os
import signal
import sys
import threading
import traceback
from collections.abc import Iterator, Mapping, Sequence
from importlib import import_module
from pathlib import Path
from types import MappingProxyType
from typing import Any, NoReturn

import typer
from typer.core import TyperGroup
from typer.exceptions import TyperException

from actioncli._version import __version__
from actioncli.cli.command import DebugOption, JsonOption, QuietOption, Settings, StoreOption
from actioncli.cli.output import (
    OutputError,
    disk_is_full,
    error_entry,
    note,
    printable,
    say,
    write_json,
)
from actioncli.errors import ActionCliError, UsageError
from actioncli.files import ending_signals, user_settings

# Name to module and function, in the order of the help.
COMMANDS: Mapping[str, str] = MappingProxyType(
    {
        "tour": "actioncli.cli.tour:tour",
        "enroll": "actioncli.cli.enroll:enroll",
        "classify": "actioncli.cli.classify:classify",
        "batch": "actioncli.cli.batch:batch",
        "watch": "actioncli.cli.watch:watch",
        "cameras": "actioncli.cli.cameras:cameras",
        "review": "actioncli.cli.review:review",
        "studio": "actioncli.cli.studio:studio",
        "extract": "actioncli.cli.extract:extract",
        "calibrate": "actioncli.cli.calibrate:calibrate",
        "list-support": "actioncli.cli.support:list_support",
        "show": "actioncli.cli.support:show",
        "remove": "actioncli.cli.support:remove",
        "rename": "actioncli.cli.support:rename",
        "clear": "actioncli.cli.support:clear",
        "export": "actioncli.cli.archive:export",
        "import": "actioncli.cli.archive:import_",
        "train": "actioncli.cli.train:train",
        "evaluate": "actioncli.cli.evaluate:evaluate",
        "doctor": "actioncli.cli.doctor:doctor",
    }
)

# Beside the exit codes that `actioncli.errors` gives to its exceptions.
EXIT_USAGE = 2
EXIT_UNEXPECTED = 70
EXIT_INTERRUPTED = 130
EXIT_BROKEN_PIPE = 141
# Commands that do nothing but answer on standard output.
_ANSWERS = {"classify", "list", "list-support", "show", "evaluate"}
# Short names; and what people type, and what they mean.
_SHORT = {"list": "list-support"}
_MEANT = {"ls": "list", "help": "--help", "version": "--version"}


def _build(name: str) -> Any:
    module, _, function = COMMANDS[name].partition(":")
    single = typer.Typer(add_completion=False, rich_markup_mode=None)
    single.command(name)(getattr(import_module(module), function))
    return typer.main.get_command(single)


class Application(TyperGroup):
    """Loads commands when they are asked for, and turns every exception into an exit code."""

    def list_commands(self, ctx: Any) -> list[str]:
        return list(COMMANDS)

    def get_command(self, ctx: Any, cmd_name: str) -> Any:
        if cmd_name in _MEANT:
            ctx.fail(f"There is no command {cmd_name!r}; try 'actioncli {_MEANT[cmd_name]}'.")
        cmd_name = _SHORT.get(cmd_name, cmd_name)
        # An unknown name loads them all, so that Typer can suggest the one that was meant.
        for name in [cmd_name] if cmd_name in COMMANDS else COMMANDS:
            if name not in self.commands:
                self.commands[name] = _build(name)
        return self.commands.get(cmd_name)

    def main(self, args: Sequence[str] | None = None, *rest: Any, **extra: Any) -> NoReturn:
        """Run, and end the process with an exit code."""
        closed = sys.stdout is None
        _replace_closed_streams()
        for stream in (sys.stdout, sys.stderr):
            if isinstance(stream, io.TextIOWrapper):
                # A label that the terminal's encoding lacks is escaped, not an error.
                stream.reconfigure(errors="backslashreplace")
        words = list(sys.argv[1:] if args is None else args)
        try:
            if closed and next((w for w in words if w in COMMANDS or w in _SHORT), "") in _ANSWERS:
                raise OutputError("standard output is closed, and the answer would be lost.")
            with _ended_like_ctrl_c():
                code = super().main(args, *rest, **{**extra, "standalone_mode": False})
        except TyperException as error:
            # What was typed is no command line: there are no options, only words.
            words = words[: words.index("--")] if "--" in words else words
            command = getattr(getattr(error, "ctx", None), "command_path", "actioncli")
            wrong = error.format_message()
            message = f"{wrong}{'' if wrong.endswith(('.', '?')) else '.'} See '{command} --help'."
            settings = Settings(json="--json" in words, debug="--debug" in words)
            code = _report(UsageError(message), settings)
        except (typer.Abort, OSError, OutputError) as error:
            code = _report(error, Settings())
        sys.exit(code if isinstance(code, int) else 0)

    def invoke(self, ctx: Any) -> Any:
        """Run the command.

        Raises:
            typer.Exit: whatever went wrong, with its exit code, after it has been reported.
        """
        try:
            super().invoke(ctx)
        except (TyperException, typer.Exit, typer.Abort):
            raise
        except (Exception, KeyboardInterrupt) as error:
            raise typer.Exit(_report(error, ctx.obj or Settings())) from error


def _report(error: BaseException, settings: Settings) -> int:
    """Report an error, one line on standard error and one document where JSON is wanted; its exit
    code."""
    if isinstance(error, BrokenPipeError):
        # Whoever read the output has seen enough, as in `actioncli list-support | head`.
        _drop_output()
        return EXIT_BROKEN_PIPE
    if isinstance(error, FileNotFoundError) and _in_no_folder():
        error = UsageError("The folder that this runs in is gone; go to another one (cd).")
    code, text = EXIT_UNEXPECTED, str(error)
    full = disk_is_full(error)
    if isinstance(error, OutputError) or (full and isinstance(error, OSError)):
        _drop_output()
        settings = Settings(debug=settings.debug)
    if isinstance(error, OSError) and full:
        text = f"the output cannot be written: {error.strerror}."
    elif isinstance(error, ActionCliError):
        code = error.exit_code
    elif isinstance(error, KeyboardInterrupt | typer.Abort):
        code, text = EXIT_INTERRUPTED, "interrupted"
    elif isinstance(error, ImportError):
        text = f"a package cannot be loaded: {error}; `actioncli doctor` tries them all."
    else:
        kind = type(error).__name__
        text = f"unexpected {kind}: {error} (this is a bug; --debug shows where)"
    if full:
        code = OutputError.exit_code
    text = " ".join(text.splitlines())
    # Where nothing can be written, the exit code alone tells.
    with contextlib.suppress(OutputError, BrokenPipeError):
        if settings.debug:
            for line in "".join(traceback.format_exception(error)).splitlines():
                note(printable(line))
        note(f"error: {printable(text)}")
        if settings.json:
            write_json({"error": {**error_entry(error, code), "message": text}})
    return code


def _in_no_folder() -> bool:
    """Whether the working folder was deleted, so that no relative name means anything."""
    try:
        return not Path.cwd().is_dir()
    except OSError:
        return True


@contextlib.contextmanager
def _ended_like_ctrl_c() -> Iterator[None]:
    """What a terminal that is closed sends, and what a service is ended by, is like Ctrl-C: what
    was begun is tidied up, and what was found out is written."""
    # One that is ignored, as after nohup, stays so. Only the main thread may ask for signals.
    main = threading.current_thread() is threading.main_thread()
    found = ending_signals() if main else []
    caught = [each for each in found if signal.getsignal(each) is signal.SIG_DFL]
    for each in caught:
        signal.signal(each, signal.default_int_handler)
    try:
        yield
    finally:
        for each in caught:
            signal.signal(each, signal.SIG_DFL)


def _replace_closed_streams() -> None:
    """Of a process that was started with a standard stream closed, Python has None; and the next
    file that it opens would get the stream's number, to which libraries write their messages."""
    for name, mode in (("stdin", "r"), ("stdout", "w"), ("stderr", "w")):
        if getattr(sys, name) is None:
            # In this order each gets its number, the lowest that is free.
            setattr(sys, name, Path(os.devnull).open(mode, encoding="utf-8"))  # noqa: SIM115


def _drop_output() -> None:
    """Nothing can be written any more: keep Python from trying again when it ends."""
    os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())


app = typer.Typer(
    cls=Application,
    rich_markup_mode=None,
    pretty_exceptions_enable=False,
    context_settings={"help_option_names": ["-h", "--help"]},
)


def _print_version(asked: bool) -> None:
    if asked:
        say(f"actioncli {__version__}")
        raise typer.Exit


# Stands below the commands.
_EPILOG = """
--store, --json, --quiet and --debug are understood before a command's name and after it.

\b
Exit codes:
  0    done, and every clip was accepted
  1    at least one clip was rejected
  2    wrong usage
  3    a clip cannot be read or is unsuitable (the others were still worked on)
  4    the support set is empty, or a label is not in it
  5    the support set's file, or an exported one, cannot be used
  6    the weights cannot be used
  70   a bug        74   the output could not be written, or a disk is full
  130  interrupted  141  nobody reads the output any more
Where clips were rejected and others could not be read, it is 3.

With --json, standard output holds one JSON document and nothing else; an error that ends a
command is {"error": {"type", "message", "exit_code"}}. Its line on standard error stays.

Defaults of your own stand in config.toml beside the support set, `tau = 0.7` for instance: store,
quality, tau, camera, mqtt; or in the environment: ACTIONCLI_TAU. `doctor` shows them.
"""


@app.callback(invoke_without_command=True, epilog=_EPILOG)
def root(
    ctx: typer.Context,
    store: StoreOption = None,
    json: JsonOption = False,
    quiet: QuietOption = False,
    debug: DebugOption = False,
    version: bool = typer.Option(
        False, "--version", callback=_print_version, is_eager=True, help="Print the version."
    ),
) -> None:
    """Record one clip of an action; recognise it in new clips; reject everything else.

    \b
    Examples:
      actioncli tour                       see what it does, in the terminal
      actioncli enroll wave wave.mp4       one video of an action, and its name
      actioncli classify query.mp4         which action does it show, or none?
      actioncli watch                      tell every action before the camera
    """
    ctx.obj = Settings(store, json, quiet, debug)
    if ctx.invoked_subcommand is None:
        note(ctx.get_help())
        raise typer.Exit(EXIT_USAGE)
    # `doctor` is who tells what is wrong with them.
    if ctx.invoked_subcommand != "doctor":
        ctx.default_map = _defaults()


def _defaults() -> dict[str, Any]:
    """The user's settings as defaults of options, by command."""
    found = user_settings()
    quality = {"quality": found["quality"]} if "quality" in found else {}
    watch = {"camera": "source", "mqtt": "mqtt"}
    watched = {option: found[name] for name, option in watch.items() if name in found}
    return {**dict.fromkeys(COMMANDS, quality), "watch": {**quality, **watched}}
