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
from typer.core import TyperCommand, TyperGroup
from typer.exceptions import TyperException

from actioncli._version import __version__
from actioncli.cli.command import DebugOption, JsonOption, QuietOption, Settings, StoreOption
from actioncli.cli.output import OutputError, error_entry, note, printable, say, write_json
from actioncli.errors import ActionCliError, UsageError

# Name to module and function, in the order of the help.
COMMANDS: Mapping[str, str] = MappingProxyType(
    {
        "enroll": "actioncli.cli.enroll:enroll",
        "classify": "actioncli.cli.classify:classify",
        "batch": "actioncli.cli.batch:batch",
        "watch": "actioncli.cli.watch:watch",
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
EXIT_REJECTED = 1
EXIT_USAGE = 2
EXIT_UNEXPECTED = 70
EXIT_INTERRUPTED = 130
EXIT_BROKEN_PIPE = 141


def _build(name: str) -> TyperCommand:
    module, _, function = COMMANDS[name].partition(":")
    single = typer.Typer(add_completion=False, rich_markup_mode=None)
    single.command(name, cls=Command)(getattr(import_module(module), function))
    built = typer.main.get_command(single)
    assert isinstance(built, TyperCommand)
    return built


class Command(TyperCommand):
    """A command whose help may find nowhere to go."""

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        """Read the words; where they ask for help, it is written here.

        Raises:
            OutputError: it cannot be written.
        """
        try:
            return super().parse_args(ctx, args)
        except BrokenPipeError:
            raise
        except OSError as failed:
            raise OutputError(f"the output cannot be written: {failed.strerror}.") from failed


class Application(TyperGroup):
    """Loads commands when they are asked for, and turns every exception into an exit code."""

    def list_commands(self, ctx: Any) -> list[str]:
        return list(COMMANDS)

    def get_command(self, ctx: Any, cmd_name: str) -> TyperCommand | None:
        # An unknown name loads them all, so that Typer can suggest the one that was meant.
        for name in [cmd_name] if cmd_name in COMMANDS else COMMANDS:
            if name not in self.commands:
                self.commands[name] = _build(name)
        found = self.commands.get(cmd_name)
        return found if isinstance(found, TyperCommand) else None

    def main(self, args: Sequence[str] | None = None, *rest: Any, **extra: Any) -> Any:
        """Run, and end the process with an exit code."""
        _replace_closed_streams()
        with _ended_like_ctrl_c():
            self._main(args, *rest, **extra)

    def _main(self, args: Sequence[str] | None, *rest: Any, **extra: Any) -> NoReturn:
        for stream in (sys.stdout, sys.stderr):
            if isinstance(stream, io.TextIOWrapper):
                # A label that the terminal's encoding lacks is escaped, not an error.
                stream.reconfigure(errors="backslashreplace")
        given = list(sys.argv[1:] if args is None else args)
        extra["standalone_mode"] = False
        try:
            code = super().main(args, *rest, **extra)
        except TyperException as error:
            # What was typed is no command line: the options are not known, only the words.
            words = given[: given.index("--")] if "--" in given else given
            command = getattr(getattr(error, "ctx", None), "command_path", "actioncli")
            said = error.format_message()
            message = f"{said}{'' if said.endswith(('.', '?')) else '.'} See '{command} --help'."
            told = Settings(json="--json" in words, debug="--debug" in words)
            code = _report(UsageError(message), EXIT_USAGE, told)
        except typer.Abort as error:
            code = _report(error, EXIT_INTERRUPTED, Settings(), "interrupted")
        except (OutputError, OSError) as failed:
            # Help and version are written while the command line is read.
            _drop_output()
            if isinstance(failed, OSError):
                failed = OutputError(f"the output cannot be written: {failed.strerror}.")
            code = _report(failed, failed.exit_code, Settings())
        sys.exit(code if isinstance(code, int) else 0)

    def invoke(self, ctx: Any) -> Any:
        """Run the command.

        Raises:
            typer.Exit: whatever went wrong, with its exit code, after it has been told.
        """
        try:
            super().invoke(ctx)
        except OutputError as error:
            _drop_output()
            code = _report(error, error.exit_code, Settings())
        except ActionCliError as error:
            code = _report(error, error.exit_code, ctx.obj)
        except KeyboardInterrupt as error:
            code = _report(error, EXIT_INTERRUPTED, ctx.obj, "interrupted")
        except BrokenPipeError:
            # Whoever read the output has seen enough, as in `actioncli list-support | head`.
            _drop_output()
            code = EXIT_BROKEN_PIPE
        except (TyperException, typer.Exit, typer.Abort):
            raise
        except ImportError as error:
            message = f"a package cannot be loaded: {error}; `actioncli doctor` tries them all."
            code = _report(error, EXIT_UNEXPECTED, ctx.obj, message)
        except Exception as error:
            if isinstance(error, FileNotFoundError) and _in_no_folder():
                told = UsageError("The folder that this runs in is gone; go to another one (cd).")
                raise typer.Exit(_report(told, told.exit_code, ctx.obj)) from error
            code = _report(
                error,
                EXIT_UNEXPECTED,
                ctx.obj,
                f"unexpected {type(error).__name__}: {error} (this is a bug; --debug shows where)",
            )
        else:
            return
        raise typer.Exit(code)


def _report(
    error: BaseException, code: int, settings: Settings | None, message: str | None = None
) -> int:
    """Tell an error: one line on standard error, and one document where JSON is wanted."""
    settings = settings or Settings()
    text = " ".join((str(error) if message is None else message).splitlines())
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
    was begun is tidied up, and what was found out is told or kept."""
    wanted = [getattr(signal, name, None) for name in ("SIGTERM", "SIGHUP")]
    # One that is ignored, as after nohup, stays so. Only the main thread may ask for signals.
    caught = [
        each
        for each in wanted
        if each is not None
        and signal.getsignal(each) is signal.SIG_DFL
        and threading.current_thread() is threading.main_thread()
    ]
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


def _tell_version(asked: bool) -> None:
    if asked:
        say(f"actioncli {__version__}")
        raise typer.Exit


@app.callback(invoke_without_command=True)
def root(
    ctx: typer.Context,
    store: StoreOption = None,
    as_json: JsonOption = False,
    quiet: QuietOption = False,
    debug: DebugOption = False,
    version: bool = typer.Option(
        False, "--version", callback=_tell_version, is_eager=True, help="Print the version."
    ),
) -> None:
    """Record one clip of an action; recognise it in new clips; reject everything else.

    \b
    Examples:
      actioncli enroll wave wave.npy
      actioncli classify query.npy
      actioncli list-support

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
      70   a bug        74   the output could not be written
      130  interrupted  141  the output was closed
    Where clips were rejected and others could not be read, it is 3.

    With --json, standard output holds one JSON document and nothing else; an error that ends a
    command is {"error": {"type", "message", "exit_code"}}. Its line on standard error stays.
    """
    ctx.obj = Settings(store, as_json, quiet, debug)
    if ctx.invoked_subcommand is None:
        note(ctx.get_help())
        raise typer.Exit(EXIT_USAGE)
