"""What the commands ask the store for, and tell of what they read."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from actioncli.cli.options import checked_tau
from actioncli.cli.output import printable
from actioncli.errors import UsageError

if TYPE_CHECKING:
    from actioncli.cli.command import Settings
    from actioncli.recognition.recognizer import Recognizer
    from actioncli.recognition.support import SupportSet
    from actioncli.store.store import SupportStore


def tell_notes(settings: Settings, path: Path, notes: Sequence[str]) -> None:
    """Tell what reading a clip decided on the way."""
    for line in notes:
        settings.tell(f"note: {printable(path)}: {printable(line)}")


def check_place(output: Path) -> None:
    """Refuse, before any work, to write where no file can be.

    Raises:
        UsageError: there is no such folder, or a folder has this name.
    """
    if output.is_dir():
        raise UsageError(f"{output}: is a folder; name a file in it.")
    if not output.parent.is_dir():
        raise UsageError(f"{output}: there is no folder {output.parent}.")


def load_support(
    settings: Settings, store: SupportStore, recognizer: Recognizer, tau: float | None = None
) -> SupportSet:
    """What is enrolled; `tau` wins over the calibrated one, which is noted if it does not count.

    Raises:
        SupportError: nothing is enrolled.
        UsageError: `tau` is not within [0, 1].
    """
    from actioncli.recognition.support import SupportSet

    support = SupportSet.load(store, recognizer, None if tau is None else checked_tau(tau))
    support.require_actions()
    if support.foreign_threshold is not None:
        settings.tell(
            f"note: the calibrated tau, {support.foreign_threshold.tau:g}, belongs to other "
            f"weights; tau is {support.threshold.tau:g} until `actioncli calibrate` measures it "
            "anew."
        )
    return support
