"""Tables of what an evaluation found, for people."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

from actioncli.cli.output import printable, say, table

if TYPE_CHECKING:
    from actioncli.evaluation.acceptance import Acceptance
    from actioncli.evaluation.result import Evaluation, Result


def say_figures(found: Evaluation) -> None:
    """Print a row for each collection and number of ways, then how far tau is a good threshold."""
    say(
        f"{found.scorer}: {found.protocol}, shots {found.shots}, episodes {found.episodes}, "
        f"tau {found.tau:g}, seed {found.seed}; mean ± standard deviation over episodes"
    )
    say()
    metrics = {
        "fsos_accuracy": "FSOS-ACC",
        "closed_set_accuracy": "closed set",
        "auroc": "AUROC",
        "oscr": "OSCR",
        "fpr_at_95_tpr": "FPR95",
    }
    rows = [
        (
            _name(result),
            ways,
            f"{result['always_reject_fsos_accuracy'].mean:.3f}",
            *(f"{result[m].mean:.3f} ± {result[m].std:.3f}" for m in metrics),
        )
        for result, ways in _merged((*found.results, *found.means))
    ]
    say(table(("collection", "ways", "reject", *metrics.values()), rows))
    say()
    say(f"Where confidence above {found.tau:g} accepts:")
    rows_at_tau = [
        (
            _name(result),
            ways,
            f"{result['false_accept_rate'].mean:.3f}",
            f"{result['false_reject_rate'].mean:.3f}",
            f"{result.reliability.ece:.3f}",
        )
        for result, ways in _merged(found.means or found.results)
    ]
    headings = ("collection", "ways", "false accepts", "false rejects", "calibration error")
    say(table(headings, rows_at_tau))


def _name(result: Result) -> str:
    if not result.collections:
        return result.collection
    return f"mean of {len(result.collections)}"


def _merged(results: Sequence[Result]) -> list[tuple[Result, str]]:
    """Each different result once, with its ways: `5`, or `5,10 (4)` where only 4 could be drawn.

    Numbers of ways that come down to the same one for lack of classes have the same figures.
    """
    same: dict[tuple[str, int], list[Result]] = {}
    for result in results:
        # 0 stands for several numbers: such means differ from one another
        same.setdefault((result.collection, result.ways_used or -result.ways), []).append(result)
    merged = []
    for group in same.values():
        asked = ",".join(str(result.ways) for result in group)
        fewer = any(result.ways_used not in (0, result.ways) for result in group)
        merged.append((group[0], f"{asked} ({group[0].ways_used})" if fewer else asked))
    return merged


def say_acceptance(found: Acceptance, tau: float) -> None:
    """Print the matrix of acceptance rates."""
    say()
    say(
        f"{printable(found.collection)}: share of queries (columns, same order) that each action "
        f"enrolled alone accepts at tau {tau:g}"
    )
    say()
    header = ["enrolled", *(str(column + 1) for column in range(len(found.classes)))]
    rows = [
        [f"{row + 1} {label}", *("" if cell != cell else f"{cell:.2f}" for cell in rates)]
        for row, (label, rates) in enumerate(zip(found.classes, found.rate, strict=True))
    ]
    say(table(header, rows))
