"""Comparison and decision types, and the rule that makes a decision of a comparison."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from html import escape
from typing import Any

import numpy as np
from numpy.typing import NDArray

from actioncli.clips.clip import FloatArray
from actioncli.files import data_frame
from actioncli.recognition.threshold import Threshold


@dataclass(frozen=True, slots=True, eq=False)
class Comparison:
    """Q queries against K enrolled actions.

    Attributes:
        labels: (K,) names of the actions.
        distance: (Q, K) float32, smaller is more alike: T(Q, S) of the paper, or with the
            default recipe the odds against query and action being the same,
            1 / confidence - 1.
        confidence: (Q, K) float32 in [0, 1], that query q shows action k, whatever else is
            enrolled.
        probability: (Q, K) float32, among the enrolled actions alone: softmax of -T, or with
            the default recipe the odds divided by their sum; rows sum to 1.
    """

    labels: NDArray[np.str_]
    distance: FloatArray
    confidence: FloatArray
    probability: FloatArray


@dataclass(frozen=True, slots=True)
class Ranked:
    """One enrolled action as seen from a query; the fields are those of `Comparison`."""

    label: str
    distance: float
    probability: float
    confidence: float

    def to_json(self) -> dict[str, object]:
        """As plain values."""
        return asdict(self)


@dataclass(frozen=True, slots=True, repr=False)
class Decision:
    """What a clip shows.

    Attributes:
        label: the recognised action, or None where the clip is rejected.
        accepted: confidence > tau, no negative is nearer than the nearest action, and somebody
            moves.
        confidence: that the clip shows the nearest action, in [0, 1].
        tau: the threshold of the nearest action.
        nearest: the nearest enrolled action, accepted or not.
        ranking: all enrolled actions, nearest first.
        notes: what reading the clip decided on the way, which part of it is meant, and whether
            a negative is nearest.
        nearest_negative: distance to the nearest negative; None where there are none.
        part: when the part that all of this is about begins and ends, seconds of the clip's
            source: the whole clip, or of a long clip the window that shows an action best.
            None for an embedding.
    """

    label: str | None
    accepted: bool
    confidence: float
    tau: float
    nearest: str
    ranking: tuple[Ranked, ...]
    notes: tuple[str, ...] = ()
    nearest_negative: float | None = None
    part: tuple[float, float] | None = None

    @property
    def negative_is_nearer(self) -> bool:
        """Whether a negative is nearer than the nearest action, which rejects at any tau."""
        return _is_nearer(self.nearest_negative, self.ranking[0])

    @property
    def comparison(self) -> str:
        """As `compared` has it."""
        return compared(self.confidence, self.tau)

    def __bool__(self) -> bool:
        """Whether the clip is accepted."""
        return self.accepted

    def __repr__(self) -> str:
        verdict = f"rejected, nearest {self.nearest}"
        if self.accepted:
            verdict = f"{self.label}, accepted"
        negative = ", but a negative is nearer" if self.negative_is_nearer else ""
        return f"Decision({verdict}, {self.comparison}{negative})"

    def _repr_html_(self) -> str:
        """For a notebook: the verdict, and the five nearest actions, whose confidence is a bar
        beside a mark at tau."""
        box = "position:relative;width:10em;height:1em;background:#8883"
        rows = "".join(
            f'<tr><td style="text-align:left">{escape(ranked.label)}</td><td><div style="{box}">'
            f'<div style="width:{ranked.confidence:.1%};height:100%;background:#38c"></div>'
            f'<div style="position:absolute;left:{self.tau:.1%};top:0;height:100%;'
            f'border-left:2px solid #e70"></div></div></td><td>{ranked.confidence:.2f}</td></tr>'
            for ranked in self.ranking[:5]
        )
        return f"<table><caption>{escape(repr(self)[9:-1])}</caption>{rows}</table>"

    def to_pandas(self) -> Any:
        """A DataFrame of the ranking, nearest first, by label.

        Raises:
            UsageError: pandas is not installed.
        """
        return data_frame([ranked.to_json() for ranked in self.ranking]).set_index("label")

    def to_json(self, top: int | None = None) -> dict[str, object]:
        """As plain values, with the `top` nearest actions; None for all."""
        part = self.part
        return {
            "label": self.label,
            "accepted": self.accepted,
            "confidence": self.confidence,
            "tau": self.tau,
            "nearest": self.nearest,
            "nearest_negative": self.nearest_negative,
            "ranking": [ranked.to_json() for ranked in self.ranking[:top]],
            "part": None if part is None else {"start": part[0], "end": part[1]},
            "notes": list(self.notes),
        }


def decide(
    comparison: Comparison,
    row: int,
    threshold: Threshold,
    negative: float | None = None,
    notes: tuple[str, ...] = (),
    part: tuple[float, float] | None = None,
    still: bool = False,
) -> Decision:
    """Accept or reject the nearest action, by its threshold and the nearest negative.

    Args:
        comparison: of queries with the enrolled actions.
        row: the query that is decided about.
        threshold: what confidence must exceed.
        negative: distance to the nearest negative.
        notes, part: as in `Decision`.
        still: nobody moves in what is decided about, which rejects it at any confidence.
    """
    order = np.argsort(comparison.distance[row], kind="stable")
    measured = (comparison.distance, comparison.probability, comparison.confidence)
    columns = [values[row, order].tolist() for values in measured]
    ranking = tuple(map(Ranked, comparison.labels[order].tolist(), *columns))
    nearest = ranking[0]
    tau = threshold.of(nearest.label)
    negative_is_nearer = _is_nearer(negative, nearest)
    if negative_is_nearer:
        notes += (
            f"nearer to a negative (distance {negative:.2f}) than to {nearest.label!r} "
            f"({nearest.distance:.2f})",
        )
    if still:
        notes += ("nobody moves, so it shows no action",)
    accepted = nearest.confidence > tau and not negative_is_nearer and not still
    return Decision(
        label=nearest.label if accepted else None,
        accepted=accepted,
        confidence=nearest.confidence,
        tau=tau,
        nearest=nearest.label,
        ranking=ranking,
        notes=notes,
        nearest_negative=negative,
        part=part,
    )


def _is_nearer(negative: float | None, action: Ranked) -> bool:
    return negative is not None and negative < action.distance


def compared(confidence: float, tau: float) -> str:
    """`confidence 0.93 > tau 0.50`, with as many digits as it takes to see that they differ."""
    for digits in range(2, 7):
        sure, threshold = f"{confidence:.{digits}f}", f"{tau:.{digits}f}"
        if sure != threshold or confidence == tau:
            break
    return f"confidence {sure} {'>' if confidence > tau else '<='} tau {threshold}"
