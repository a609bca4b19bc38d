"""What makes a function a command: settings that all commands take, and groups of options."""

from __future__ import annotations

import functools
import inspect
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Concatenate, ParamSpec

import typer

from actioncli.cli.output import note

if TYPE_CHECKING:
    from actioncli.store.store import SupportStore

P = ParamSpec("P")


@dataclass(frozen=True, slots=True)
class Settings:
    """The options that every command takes, before its name or after it.

    Attributes:
        store: file of the support set; None means the default place.
        json: print one JSON document instead of text.
        quiet: print results and errors only.
        debug: print the traceback of an error.
    """

    store: Path | None = None
    json: bool = False
    quiet: bool = False
    debug: bool = False

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

    def tell(self, line: str) -> None:
        """Write a note for people to standard error, unless they asked for quiet."""
        if not self.quiet:
            note(line)


StoreOption = Annotated[
    Path | None,
    typer.Option(
        "--store",
        metavar="FILE",
        help="The support set's file.  [default: $ACTIONCLI_HOME/support.db or the user's "
        "data folder]",
        show_default=False,
    ),
]
JsonOption = Annotated[bool, typer.Option("--json", help="Print one JSON document.")]
QuietOption = Annotated[bool, typer.Option("--quiet", "-q", help="Only results and errors.")]
DebugOption = Annotated[bool, typer.Option("--debug", help="Show the traceback of an error.")]


def _common_options(
    store: StoreOption = None,
    as_json: JsonOption = False,
    quiet: QuietOption = False,
    debug: DebugOption = False,
) -> Settings:
    return Settings(store, as_json, quiet, debug)


@dataclass(frozen=True, slots=True)
class Options:
    """In the annotation of a command's parameter: it is made of several options.

    Attributes:
        make: the value, from all that the parts give, by name.
        parts: functions of options, annotated as those of a command are.
    """

    make: Callable[..., object]
    parts: tuple[Callable[..., Mapping[str, object]], ...]

    def parameters(self) -> list[inspect.Parameter]:
        """What the command takes instead of the one parameter."""
        return [option for part in self.parts for option in _parameters(part)]

    def value(self, arguments: dict[str, Any]) -> object:
        """The value of the parameter; takes its options out of `arguments`."""
        fields: dict[str, object] = {}
        for part in self.parts:
            fields |= part(
                **{option.name: arguments.pop(option.name) for option in _parameters(part)}
            )
        return self.make(**fields)


def _parameters(function: Callable[..., object]) -> list[inspect.Parameter]:
    return list(inspect.signature(function, eval_str=True).parameters.values())


def _options(parameter: inspect.Parameter) -> Options | None:
    marks = getattr(parameter.annotation, "__metadata__", ())
    return next((mark for mark in marks if isinstance(mark, Options)), None)


def command(function: Callable[Concatenate[Settings, P], None]) -> Callable[..., None]:
    """Turn a function of `Settings` and its own parameters into a command.

    Its first parameter is filled from the common options, which the command then takes beside
    those of its own, and from those given before the command's name. An own parameter of the
    same name replaces a common one; one that is annotated with `Options` is made of these.
    """
    signature = inspect.signature(function, eval_str=True)
    _, *asked = signature.parameters.values()
    groups = {one.name: group for one in asked if (group := _options(one)) is not None}
    own: list[inspect.Parameter] = []
    for one in asked:
        own += groups[one.name].parameters() if one.name in groups else [one]
    # In a function what has no default comes first, which on the command line means nothing.
    own = [one.replace(kind=inspect.Parameter.KEYWORD_ONLY) for one in own]
    taken = {parameter.name for parameter in own}
    common = [
        parameter.replace(kind=inspect.Parameter.KEYWORD_ONLY)
        for parameter in _parameters(_common_options)
        if parameter.name not in taken
    ]
    context = inspect.Parameter(
        "ctx", inspect.Parameter.POSITIONAL_OR_KEYWORD, annotation=typer.Context
    )
    body: Callable[..., None] = function

    @functools.wraps(function)
    def run(ctx: typer.Context, **arguments: Any) -> None:
        given = {parameter.name: arguments.pop(parameter.name) for parameter in common}
        root = ctx.find_root()
        # Kept at the root, where an error that leaves the command is reported.
        root.obj = root.obj.merged(_common_options(**given))
        for name, group in groups.items():
            arguments[name] = group.value(arguments)
        body(root.obj, **arguments)

    parameters = [context, *own, *common]
    # What Typer reads to learn a command's parameters.
    run.__dict__["__signature__"] = signature.replace(parameters=parameters)
    run.__annotations__ = {parameter.name: parameter.annotation for parameter in parameters}
    return run
