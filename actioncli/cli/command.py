"""What makes a function a command: settings that all commands take, and groups of options."""

from __future__ import annotations

import functools
import inspect
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Concatenate, ParamSpec

import typer

from actioncli.cli.output import note, say, write_json

if TYPE_CHECKING:
    from actioncli.store.store import SupportStore

P = ParamSpec("P")

StoreOption = Annotated[
    Path | None,
    typer.Option(
        metavar="FILE",
        help="The support set's file.  [default: that of config.toml, else "
        "$ACTIONCLI_HOME/support.db or in the user's data folder]",
    ),
]
JsonOption = Annotated[bool, typer.Option("--json", help="Print one JSON document.")]
QuietOption = Annotated[bool, typer.Option("--quiet", "-q", help="Only results and errors.")]
DebugOption = Annotated[bool, typer.Option("--debug", help="Show the traceback of an error.")]


@dataclass(frozen=True, slots=True)
class Settings:
    """The options that every command takes, before its name or after it.

    Attributes:
        store: file of the support set; None means the default place.
        json: print one JSON document instead of text.
        quiet: print results and errors only.
        debug: print the traceback of an error.
    """

    store: StoreOption = None
    json: JsonOption = False
    quiet: QuietOption = False
    debug: DebugOption = False

    def open_store(self) -> SupportStore:
        """The support set; use it in a `with` statement.

        Raises:
            StoreError: it cannot be opened.
        """
        from actioncli.store.store import SupportStore

        return SupportStore(self.store)

    def merged(self, other: Settings) -> Settings:
        """These settings and those of `other`, whose store wins."""
        return Settings(
            store=other.store or self.store,
            json=self.json or other.json,
            quiet=self.quiet or other.quiet,
            debug=self.debug or other.debug,
        )

    def answer(self, document: object, line: str) -> None:
        """Print a result that is one line: the document where JSON is wanted, and nothing where
        quiet is."""
        if self.json:
            write_json(document)
        elif not self.quiet:
            say(line)

    def tell(self, line: str) -> None:
        """Write a note for people to standard error, unless they asked for quiet."""
        if not self.quiet:
            note(line)


@dataclass(frozen=True, slots=True)
class Options:
    """In the annotation of a command's parameter: some parameters of `make`, which are options as
    those of a command are, make its value."""

    make: Callable[..., object]
    names: str

    def parameters(self) -> list[inspect.Parameter]:
        """What the command takes instead of the one parameter."""
        found = inspect.signature(self.make, eval_str=True).parameters
        return [found[name] for name in self.names.split()]


def command(function: Callable[Concatenate[Settings, P], None]) -> Callable[..., None]:
    """Turn a function of `Settings` and its own parameters into a command.

    Its first parameter is filled from the common options, which the command then takes beside
    those of its own, and from those given before the command's name. An own parameter of the
    same name replaces a common one; one that is annotated with `Options` is made of these.
    """
    _, *own = inspect.signature(function, eval_str=True).parameters.values()
    groups: dict[str, Options] = {}
    taken: dict[str, inspect.Parameter] = {}
    for parameter in own:
        marks = getattr(parameter.annotation, "__metadata__", ())
        group = next((mark for mark in marks if isinstance(mark, Options)), None)
        if group is not None:
            groups[parameter.name] = group
        options = [parameter] if group is None else group.parameters()
        taken |= {option.name: option for option in options}
    common = inspect.signature(Settings, eval_str=True).parameters
    shared = [name for name in common if name not in taken]
    body: Callable[..., None] = function

    @functools.wraps(function)
    def run(ctx: typer.Context, **arguments: Any) -> None:
        root = ctx.find_root()
        # Kept at the root, where an error that leaves the command is reported.
        root.obj = root.obj.merged(Settings(**{name: arguments.pop(name) for name in shared}))
        for name, group in groups.items():
            arguments[name] = group.make(**{n: arguments.pop(n) for n in group.names.split()})
        body(root.obj, **arguments)

    # What Typer reads to learn a command's parameters. In a function what has no default comes
    # first, which on the command line means nothing.
    keyword = inspect.Parameter.KEYWORD_ONLY
    context = inspect.Parameter("ctx", keyword, annotation=typer.Context)
    options = [*taken.values(), *(common[name] for name in shared)]
    parameters = [context, *(option.replace(kind=keyword) for option in options)]
    run.__dict__["__signature__"] = inspect.Signature(parameters)
    run.__annotations__ = {parameter.name: parameter.annotation for parameter in parameters}
    return run
