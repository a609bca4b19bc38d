"""What the commands share: the options that all of them take, and what they ask the store for."""

from __future__ import annotations

import functools
import inspect
import os
import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Concatenate, ParamSpec

import typer

from actioncli.cli.output import note, printable
from actioncli.errors import ActionCliError, UsageError

if TYPE_CHECKING:
    from actioncli.clips.clip import FloatArray
    from actioncli.recognizer import Recognizer
    from actioncli.store.store import SupportStore
    from actioncli.threshold import Threshold

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


def command(function: Callable[Concatenate[Settings, P], None]) -> Callable[..., None]:
    """Turn a function of `Settings` and its own parameters into a command.

    Its first parameter is filled from the common options, which the command then takes beside
    those of its own, and from those given before the command's name. An own parameter of the
    same name replaces a common one.
    """
    signature = inspect.signature(function, eval_str=True)
    _, *own = signature.parameters.values()
    taken = {parameter.name for parameter in own}
    common = [
        parameter.replace(kind=inspect.Parameter.KEYWORD_ONLY)
        for parameter in inspect.signature(_common_options, eval_str=True).parameters.values()
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
        body(root.obj, **arguments)

    parameters = [context, *own, *common]
    # What Typer reads to learn a command's parameters.
    run.__dict__["__signature__"] = signature.replace(parameters=parameters)
    run.__annotations__ = {parameter.name: parameter.annotation for parameter in parameters}
    return run


def complete_label(ctx: typer.Context, incomplete: str) -> list[str]:
    """Enrolled labels for the shell; none where there is no readable support set."""
    from actioncli.store.store import SupportStore

    given = ctx.params.get("store") or ctx.find_root().params.get("store")
    try:
        with SupportStore(given) as store:
            labels = [action.label for action in store.actions()]
    except ActionCliError:
        return []
    fitting = [label for label in labels if label.startswith(incomplete)]
    if os.environ.get("_ACTIONCLI_COMPLETE") == "complete_bash":
        # bash takes a word as it is given; the other shells' scripts quote it.
        return [re.sub(r"([^\w@%+=:,./-])", r"\\\1", label) for label in fitting]
    return fitting


def complete_layout(incomplete: str) -> list[str]:
    """Names of the skeleton layouts for the shell."""
    from actioncli.clips.layouts import LAYOUTS

    return [name for name in LAYOUTS if name.startswith(incomplete)]


ClipArguments = Annotated[
    list[Path],
    typer.Argument(
        metavar="CLIP...",
        help="Clip files or videos, folders of them, or patterns such as 'day1/*.npy'.",
    ),
]
LayoutOption = Annotated[
    str | None,
    typer.Option(
        metavar="NAME",
        help="Skeleton layout of files that do not name their joints, such as smpl+head_30.",
        autocompletion=complete_layout,
    ),
]
UnitOption = Annotated[
    str | None,
    typer.Option(metavar="m|cm|mm|in", help="Unit of the files, or a number: metres per unit."),
]
UpOption = Annotated[
    str | None,
    typer.Option(metavar="AXIS", help="Axis that points up in the files, such as z or -y."),
]
FpsOption = Annotated[
    float | None, typer.Option(metavar="RATE", help="Frames per second of the files.")
]
TauOption = Annotated[
    float | None,
    typer.Option(
        metavar="0..1",
        help="Accept where the confidence is above it.  [default: the calibrated one, else 0.5]",
        show_default=False,
    ),
]
WeightsOption = Annotated[
    Path | None,
    typer.Option(metavar="FILE", help="Weights to use instead of those that came along."),
]


def tell_notes(settings: Settings, path: Path, notes: Sequence[str]) -> None:
    """Tell what reading a clip decided on the way."""
    for line in notes:
        settings.tell(f"note: {printable(path)}: {printable(line)}")


def stored_negatives(store: SupportStore, recognizer: Recognizer) -> FloatArray:
    """Embeddings (N, F, E) of the clips that must never be accepted."""
    import numpy as np

    kept = store.embeddings(recognizer.weights.checksum, recognizer.embed, negative=True)
    return np.concatenate([recognizer.embed([]), *kept.values()])


def used_threshold(
    settings: Settings, store: SupportStore, recognizer: Recognizer, tau: float | None = None
) -> Threshold:
    """`tau` if given, else the calibrated one if it was measured with these weights, else 0.5.

    Raises:
        UsageError: `tau` is not within [0, 1].
    """
    from actioncli.recognizer import DEFAULT_TAU
    from actioncli.threshold import Threshold, kept_threshold

    checksum = recognizer.weights.checksum
    if tau is not None:
        return Threshold(checked_tau(tau), checksum)
    kept = kept_threshold(store)
    if kept is not None and kept.weights == checksum:
        return kept
    if kept is not None:
        settings.tell(
            f"note: the calibrated tau, {kept.tau:g}, belongs to other weights; tau is "
            f"{DEFAULT_TAU:g} until `actioncli calibrate` measures it anew."
        )
    return Threshold(DEFAULT_TAU, checksum)


def checked_tau(tau: float) -> float:
    """`tau` if it is a threshold.

    Raises:
        UsageError: it is not within [0, 1].
    """
    if not 0 <= tau <= 1:
        raise UsageError(f"tau must lie between 0 and 1, not {tau:g}.")
    return tau
