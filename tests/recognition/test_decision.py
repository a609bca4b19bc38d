"""Accept or reject, and how a decision shows itself."""

import numpy as np
import pytest

from actioncli import Comparison, Decision
from actioncli.recognition.decision import decide
from actioncli.recognition.threshold import Threshold


def decided(
    confidence: float, negative: float | None = None, label: str = "wave", **own: float
) -> Decision:
    """Of a query at distance 1 of an action, and at 3 of `bow`."""
    measured = np.array([[3.0, 1.0]], np.float32), np.array([[0.01, confidence]])
    comparison = Comparison(np.array(["bow", label]), *measured, np.array([[0.25, 0.75]]))
    return decide(comparison, 0, Threshold(0.5, "abc", own), negative)


def test_confidence_must_exceed_the_threshold_of_the_nearest_action() -> None:
    assert decided(0.51).accepted
    rejected = decided(0.8, wave=0.8, bow=0.1)
    assert (rejected.accepted, rejected.label, rejected.tau) == (False, None, 0.8)
    accepted = decided(0.81, wave=0.8)
    assert (accepted.accepted, accepted.label, accepted.tau) == (True, "wave", 0.8)
    assert [ranked.label for ranked in accepted.ranking] == ["wave", "bow"]


def test_a_rejected_decision_is_false_and_says_by_how_little() -> None:
    assert decided(0.51)
    rejected = decided(0.4996)
    assert not rejected
    assert "confidence 0.4996 <= tau 0.5000" in repr(rejected)
    assert "confidence 0.50 <= tau 0.50" in repr(decided(0.5))


def test_no_confidence_accepts_what_is_nearer_to_a_negative() -> None:
    assert not decided(0.9, negative=0.9).accepted
    assert decided(0.9, negative=1.0).accepted


@pytest.mark.parametrize(
    ("decision", "shown"),
    [
        (decided(0.93), "Decision(wave, accepted, confidence 0.93 > tau 0.50)"),
        (decided(0.12), "Decision(rejected, nearest wave, confidence 0.12 <= tau 0.50)"),
        (
            decided(0.93, negative=0.5),
            "Decision(rejected, nearest wave, confidence 0.93 > tau 0.50, but a negative is "
            "nearer)",
        ),
    ],
)
def test_one_line_for_a_terminal(decision: Decision, shown: str) -> None:
    assert repr(decision) == str(decision) == shown


def test_a_table_for_a_notebook() -> None:
    shown = decided(0.93, label="<b>wave & co")._repr_html_()
    assert "<caption>&lt;b&gt;wave &amp; co, accepted, confidence 0.93 &gt; tau 0.50<" in shown
    assert shown.count("<tr>") == 2
    assert "width:93.0%" in shown
    assert "left:50.0%" in shown
    assert "<b>" not in shown


def test_plain_values() -> None:
    plain = decided(0.93, negative=0.5).to_json(top=1)
    assert plain["ranking"] == [
        {"label": "wave", "distance": 1.0, "probability": 0.75, "confidence": 0.93}
    ]
    assert (plain["accepted"], plain["nearest_negative"], plain["part"]) == (False, 0.5, None)
