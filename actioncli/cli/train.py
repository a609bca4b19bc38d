"""`train`: make weights from collections of recordings."""

from __future__ import annotations

import time
from contextlib import contextmanager
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from actioncli.cli.command import Settings, command
from actioncli.cli.common import check_output
from actioncli.cli.options import ForceOption
from actioncli.cli.output import note, printable, progress, say, write_json
from actioncli.cli.output import steps as progress_steps
from actioncli.errors import UsageError, WeightsError

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    from actioncli.training.loop import Progress

RECIPES = ("default", "paper")
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
        str,
        typer.Option(metavar="NAME", help="default, or paper (TRX-OS as published)."),
    ] = "default",
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
    device: Annotated[
        str, typer.Option(metavar="NAME", help="Where PyTorch computes; cuda: a graphics card.")
    ] = "cpu",
    force: ForceOption = False,
) -> None:
    """Train a model on recordings of actions by several people.

    Needs the extra: pip install 'actioncli[train]'. Some classes are held out to tell how well
    the model does on actions that it has never seen, and the best weights on those are kept.
    A run that was interrupted goes on where it was when the same command is given again.

    \b
    Examples:
      actioncli train recordings/*.npz --out my.safetensors
      actioncli train recordings/*.npz --recipe paper --splits splits.json --out paper.safetensors
      actioncli classify query.mp4 --weights my.safetensors

    \b
    JSON keys:
      weights, checksum, recipe, seed, steps, best_step, seconds, validation
      validation: step, closed_accuracy, auroc, oscr, score
    """
    if find_spec("torch") is None:
        raise UsageError("training needs PyTorch: pip install 'actioncli[train]'.")
    check_output(out, collections, force, _is_weights)
    import torch

    from actioncli.clips.collection import read_collection
    from actioncli.evaluation.splits import read_splits
    from actioncli.model.weights import read_weights
    from actioncli.training import default, loop, paper
    from actioncli.training.data import hold_out, training_set

    if recipe not in RECIPES:
        raise UsageError(f"unknown recipe {recipe!r}; there are {', '.join(RECIPES)}.")
    try:
        torch.empty(0, device=device)
    except (RuntimeError, AssertionError) as error:
        raise UsageError(f"--device {device}: {str(error).splitlines()[0]}") from error
    if threads is not None:
        torch.set_num_threads(threads)
    parts = read_splits(splits) if splits else None
    paths = progress(collections, "Reading", shown=not settings.quiet)
    read = [read_collection(path) for path in paths]
    data, held = hold_out(training_set(read, parts), seed)
    settings.tell(
        f"Training on {len(data.clips)} clips of {len(data.members)} classes, validating on "
        f"{len(held.clips)} of {len(held.members)} others."
    )
    begun = time.monotonic()
    given = (data, held, seed, [collection.name for collection in read], device)
    run: loop.Run[Any]
    if recipe == "default":
        run = default.DefaultRun(default.DefaultRecipe(), *given)
    else:
        run = paper.PaperRun(paper.PaperRecipe(), *given)
    with _reports(settings) as report:
        loop.train(run, out, report)
    weights, steps = read_weights(out), run.recipe.steps
    best, seconds = weights.metadata["validation"], time.monotonic() - begun
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


def _is_weights(file: Path) -> bool:
    from actioncli.model.weights import read_weights

    try:
        read_weights(file)
    except WeightsError:
        return False
    return True


@contextmanager
def _reports(settings: Settings) -> Iterator[Callable[[Progress], None]]:
    """What shows how far a run is: a bar on a terminal, a line every half minute in a log."""
    logged, unsaved = time.monotonic(), False
    with progress_steps(shown=not settings.quiet) as bar:

        def report(now: Progress) -> None:
            nonlocal logged, unsaved
            if now.unsaved is not None and not unsaved:
                note(f"warning: {printable(now.unsaved)} Training goes on; it is tried again.")
            unsaved = now.unsaved is not None
            figures = f"loss {now.loss:.3f}  accuracy {now.accuracy:.3f}"
            if now.validation is not None:
                figures += f"  unseen classes: accuracy {now.validation['closed_accuracy']:.3f}"
                figures += f" OSCR {now.validation['oscr']:.3f}"
            if bar is not None:
                bar(figures, now.step, now.steps)
            elif not settings.quiet and (
                time.monotonic() - logged > _LOG_SECONDS or now.step == now.steps
            ):
                logged = time.monotonic()
                left = f"{now.seconds_left / 60:.0f} min left"
                note(f"step {now.step}/{now.steps}  {figures}  {left}")

        yield report
