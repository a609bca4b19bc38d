"""`classify --explain`: the page that tells why."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from actioncli.cli.command import Settings
from actioncli.cli.output import printable
from actioncli.errors import UsageError

if TYPE_CHECKING:
    from actioncli.clips.clip import Clip
    from actioncli.recognition.decision import Decision
    from actioncli.recognition.recognizer import Recognizer


def check_explanation(clips: Sequence[Path], page: Path) -> None:
    """Refuse, before anything is read, what --explain cannot do.

    Raises:
        UsageError: not one clip, or no place for a page.
    """
    from actioncli.clips.read import find_clips
    from actioncli.report.explanation import check_page

    check_page(page)
    if len(list(find_clips(clips))) != 1:
        raise UsageError("--explain tells about one clip: name one file, and no other.")


def explain_decision(
    settings: Settings, recognizer: Recognizer, clip: Clip, decision: Decision, page: Path
) -> None:
    """Write the page.

    Raises:
        UsageError: it cannot be written.
        SupportError: the action was removed meanwhile.
    """
    from actioncli.clips.edit import cut
    from actioncli.recognition.explanation import explain
    from actioncli.report.explanation import SHOWN, Neighbour, write_explanation

    if decision.part is not None:
        clip = cut(clip, *(at - clip.start for at in decision.part))
    with settings.open_store() as store:
        enrolled = store.examples(decision.nearest)
        found = explain(recognizer, clip, [store.clip(example.id) for example in enrolled])
        shown = [enrolled[found.example]]
        shown += [store.examples(each.label)[0] for each in decision.ranking[1:SHOWN]]
        neighbours = [
            Neighbour(
                example.label, f"example {example.id}, {example.source}", store.clip(example.id)
            )
            for example in shown
        ]
    write_explanation(page, clip, decision, neighbours, found, recognizer.weights.trx_os)
    settings.tell(f"explained in {printable(page)}")
