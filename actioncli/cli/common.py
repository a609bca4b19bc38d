"""What the commands ask the store for, and tell of what they read."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from actioncli.cli.output import printable
from actioncli.errors import UsageError
from actioncli.files import weights_file

if TYPE_CHECKING:
    from actioncli.cli.command import Settings
    from actioncli.recognition.recognizer import Recognizer
    from actioncli.recognition.support import SupportSet
    from actioncli.store.store import SupportStore


def tell_notes(settings: Settings, path: Path | str, notes: Sequence[str]) -> None:
    """Tell what reading a clip decided on the way."""
    for line in notes:
        settings.tell(f"note: {printable(path)}: {printable(line)}")


def check_output(
    output: Path,
    inputs: Iterable[Path] = (),
    force: bool = True,
    own: Callable[[Path], bool] | None = None,
) -> None:
    """Refuse, before any work, to write where no file can be, or over what is not to be lost.

    Args:
        inputs: files that are read; none of them is written over, by whatever name.
        force: write over another file, too.
        own: whether this tool wrote the file that is there, which then may be written anew; a page
            of its own where None.

    Raises:
        UsageError: there is no such folder, a folder has this name, or such a file stands there.
    """
    if output.is_dir():
        raise UsageError(f"{output}: is a folder; name a file in it.")
    if not output.parent.is_dir():
        raise UsageError(f"{output}: there is no folder {output.parent}.")
    for file in inputs:
        if output == file or (output.exists() and file.exists() and output.samefile(file)):
            raise UsageError(f"{output}: is {file} itself; it is not written over.")
    if not force and output.is_file() and not (own or _is_own_page)(output):
        raise UsageError(f"{output}: stands there; --force writes over it.")


def _is_own_page(file: Path) -> bool:
    pages = {".html", ".htm"}
    return file.suffix.lower() in pages and "Made by actioncli" in file.read_text(errors="replace")


def load_support(
    settings: Settings, store: SupportStore, recognizer: Recognizer, tau: float | None = None
) -> SupportSet:
    """What is enrolled; `tau` wins over the calibrated one, which is noted if it does not count.

    Raises:
        SupportError: nothing is enrolled.
        UsageError: `tau` is not within [0, 1].
    """
    from actioncli.model.weights import DEFAULT_WEIGHTS
    from actioncli.recognition.support import SupportSet

    if tau is not None and not 0 <= tau <= 1:
        raise UsageError(f"tau must lie between 0 and 1, not {tau:g}.")
    if recognizer.weights.path != weights_file(DEFAULT_WEIGHTS):
        settings.tell(
            f"weights: {printable(recognizer.weights.path)} ({recognizer.weights.checksum})"
        )
    support = SupportSet.load(store, recognizer, tau)
    support.require_actions()
    if support.foreign_threshold is not None:
        settings.tell(
            f"note: the calibrated tau, {support.foreign_threshold.tau:g}, belongs to other "
            f"weights; tau is {support.threshold.tau:g} until `actioncli calibrate` measures it "
            "anew."
        )
    return support
