"""`train`: make weights from collections of recordings."""

from __future__ import annotations

import sys
import time
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from actioncli.cli.command import Settings, command
from actioncli.cli.output import note, printable, progress, say, write_json
from actioncli.errors import UsageError

if TYPE_CHECKING:
    from collections.abc import Callable

    from actioncli.training.loop import Progress

RECIPES = ("parts", "paper")
# Seconds between progress lines where standard error is a file.
_LOG_SECONDS = 30.0


@command
def train(
    settings: Settings,
    collections: Annotated[
        list[Path],
        typer.Argument(
            metavar="COLLECTION...", help="Collections (.npz), or folders label/clip.*."
        ),
    ],
    out: Annotated[Path, typer.Option(metavar="FILE", help="Where the weights go.")],
    recipe: Annotated[
        str, typer.Option(metavar="NAME", help="parts; or paper: TRX-OS as published.")
    ] = "parts",
    splits: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE", help="Train on its train classes only.  [default: all classes]"
        ),
    ] = None,
    seed: Annotated[int, typer.Option(metavar="N", min=0, help="Of tensors and episodes.")] = 0,
    threads: Annotated[
        int | None,
        typer.Option(metavar="N", min=1, help="Processor threads.  [default: all cores]"),
    ] = None,
) -> None:
    """Train a model on recordings of actions by several people.

    Needs the extra: pip install 'actioncli[train]'. Some classes are held out to tell how well
    the model does on actions that it has never seen, and the best weights on those are kept.
    A run that was interrupted goes on where it was when the same command is given again.

    \b
    Examples:
      actioncli train recordings/*.npz --out my.safetensors
      actioncli train recordings/*.npz --recipe paper --splits splits.json --out paper.safetensors
      actioncli classify query.npy --weights my.safetensors

    \b
    JSON keys:
      weights, checksum, recipe, seed, steps, best_step, seconds, validation
      validation: step, closed_accuracy, auroc, oscr, score
    """
    if find_spec("torch") is None:
        raise UsageError("training needs PyTorch: pip install 'actioncli[train]'.")
    if out.is_dir():
        raise UsageError(f"{out}: is a folder; name a file in it.")
    import torch

    from actioncli.clips.collection import read_collection
    from actioncli.evaluation.splits import read_splits
    from actioncli.model.weights import read_weights
    from actioncli.training.data import hold_out, training_set
    from actioncli.training.paper import PaperRecipe, train_paper
    from actioncli.training.paper_validation import Validation
    from actioncli.training.parts_loop import PartsRecipe, train_parts
    from actioncli.training.parts_validation import PartsValidation

    if recipe not in RECIPES:
        raise UsageError(f"unknown recipe {recipe!r}; there are {', '.join(RECIPES)}.")
    if threads is not None:
        torch.set_num_threads(threads)
    parts = read_splits(splits) if splits else None
    read = [
        read_collection(path) for path in progress(collections, "Reading", shown=not settings.quiet)
    ]
    data, held = hold_out(training_set(read, parts), seed)
    settings.tell(
        f"Training on {len(data.clips)} clips of {len(data.members)} classes, validating on "
        f"{len(held.clips)} of {len(held.members)} others."
    )
    begun = time.monotonic()
    names = [collection.name for collection in read]
    with _reporter(settings) as report:
        if recipe == "parts":
            parts_recipe = PartsRecipe()
            validation = PartsValidation(held, parts_recipe.config, seed)
            train_parts(parts_recipe, data, validation, out, seed, names, report)
        else:
            train_paper(PaperRecipe(), data, Validation(held, seed), out, seed, names, report)
    weights = read_weights(out)
    best, steps = weights.metadata["validation"], weights.metadata["recipe"]["steps"]
    seconds = time.monotonic() - begun
    if settings.json:
        write_json(
            {
                "weights": str(out),
                "checksum": weights.checksum,
                "recipe": recipe,
                "seed": seed,
                "steps": steps,
                "best_step": best["step"],
                "seconds": seconds,
                "validation": best,
            }
        )
    else:
        say(
            f"{printable(out)}: step {best['step']} of {steps}; on unseen classes closed "
            f"accuracy {best['closed_accuracy']:.3f}, AUROC {best['auroc']:.3f}, "
            f"OSCR {best['oscr']:.3f}; {seconds / 60:.0f} min"
        )


class _reporter:  # noqa: N801 - used like a function in a `with` statement
    """A progress bar on a terminal; a line every half minute in a log."""

    def __init__(self, settings: Settings) -> None:
        self._quiet = settings.quiet
        self._told = time.monotonic()
        self._unsaved: str | None = None

    def __enter__(self) -> Callable[[Progress], None]:
        self._bar = None
        if self._quiet:
            return self._warn
        if not sys.stderr.isatty():
            return self._log
        from rich.console import Console
        from rich.progress import Progress as Bar

        self._bar = Bar(console=Console(stderr=True), transient=True, redirect_stdout=False)
        self._task = self._bar.add_task("Training", total=None)
        self._bar.start()
        return self._move

    def __exit__(self, *_: object) -> None:
        if self._bar is not None:
            self._bar.stop()

    def _warn(self, now: Progress) -> None:
        if now.unsaved is not None and self._unsaved is None:
            note(f"warning: {printable(now.unsaved)} Training goes on; it is tried again.")
        self._unsaved = now.unsaved

    def _move(self, now: Progress) -> None:
        assert self._bar is not None
        self._warn(now)
        self._bar.update(self._task, total=now.steps, completed=now.step, description=_figures(now))

    def _log(self, now: Progress) -> None:
        self._warn(now)
        if time.monotonic() - self._told > _LOG_SECONDS or now.step == now.steps:
            self._told = time.monotonic()
            left = f"{now.seconds_left / 60:.0f} min left"
            note(f"step {now.step}/{now.steps}  {_figures(now)}  {left}")


def _figures(now: Progress) -> str:
    told = f"loss {now.loss:.3f}  accuracy {now.accuracy:.3f}"
    if now.validation is not None:
        told += f"  unseen classes: accuracy {now.validation['closed_accuracy']:.3f}"
        told += f" OSCR {now.validation['oscr']:.3f}"
    return told
