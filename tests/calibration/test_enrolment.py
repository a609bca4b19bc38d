"""Warnings about examples that look like something else."""

import pytest

from actioncli import Decision
from actioncli.calibration.enrolment import doubts
from actioncli.recognition.decision import Ranked
from actioncli.recognition.threshold import Threshold

HALF = Threshold(0.5, "abc")


def decision(*ranked: tuple[str, float], negative: float | None = None) -> Decision:
    """Labels and confidences, nearest first, at distances 1, 2, ..."""
    ranking = tuple(
        Ranked(label, float(place), 0.0, confidence)
        for place, (label, confidence) in enumerate(ranked, start=1)
    )
    return Decision(
        None, False, ranking[0].confidence, 0.5, ranking[0].label, ranking, (), negative
    )


@pytest.mark.parametrize(
    ("seen", "told"),
    [
        (decision(("wave", 0.9), ("clap", 0.2)), []),
        (decision(("wave", 0.5)), ["unlike the other examples of `wave`, 0.50"]),
        (decision(("clap", 0.81), ("wave", 0.9)), ["closest to `clap`, 0.81"]),
        (decision(("clap", 0.1), ("wave", 0.9)), ["closest to `clap`, 0.10"]),
        (
            decision(("clap", 0.81), ("wave", 0.1)),
            ["unlike the other examples of `wave`, 0.10", "closest to `clap`, 0.81"],
        ),
        (decision(("wave", 0.9), ("bow", 0.6), ("clap", 0.81)), ["also like `clap`, 0.81"]),
        (decision(("wave", 0.9), negative=0.5), ["closest to a negative"]),
        # Its action has no other example.
        (decision(("bow", 0.3), ("clap", 0.81)), ["closest to `clap`, 0.81"]),
        (decision(("clap", 0.5), ("bow", 0.3)), []),
        (decision(("clap", 0.5), negative=0.5), []),
    ],
)
def test_doubts(seen: Decision, told: list[str]) -> None:
    assert doubts(seen, "wave", HALF) == told


def test_thresholds_are_those_of_the_actions() -> None:
    seen = decision(("wave", 0.5), ("clap", 0.81))
    assert doubts(seen, "wave", Threshold(0.9, "abc", {"wave": 0.4})) == []
    assert doubts(seen, "wave", Threshold(0.4, "abc", {"clap": 0.8})) == ["also like `clap`, 0.81"]
