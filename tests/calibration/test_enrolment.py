"""The way into a support set, and warnings about examples that look like something else."""

from pathlib import Path

import pytest

from actioncli import Decision, Recognizer, SupportSet, SupportStore, read_clip
from actioncli.calibration.enrolment import enrol, enrolment_warnings
from actioncli.recognition.decision import Ranked
from actioncli.recognition.threshold import Threshold

HALF = Threshold(0.5, "abc")
EXAMPLES = Path(__file__).parents[2] / "examples"
SQUAT, OTHER, BOW = (
    read_clip(EXAMPLES / f"{name}.npz") for name in ("squat/ada", "squat/ben", "bow/ben")
)


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
    ("seen", "expected"),
    [
        (decision(("wave", 0.9), ("clap", 0.2)), []),
        (
            decision(("wave", 0.5)),
            ["unlike the other examples of `wave`: confidence 0.50 <= tau 0.50"],
        ),
        (
            decision(("clap", 0.81), ("wave", 0.9)),
            ["closest to `clap`: confidence 0.81 > tau 0.50"],
        ),
        (decision(("clap", 0.1), ("wave", 0.9)), []),
        (
            decision(("clap", 0.4996), ("wave", 0.9)),
            ["closest to `clap`: confidence 0.4996 <= tau 0.5000"],
        ),
        (
            decision(("clap", 0.81), ("wave", 0.1)),
            [
                "unlike the other examples of `wave`: confidence 0.10 <= tau 0.50",
                "closest to `clap`: confidence 0.81 > tau 0.50",
            ],
        ),
        (
            decision(("wave", 0.9), ("bow", 0.6), ("clap", 0.81)),
            ["also like `clap`: confidence 0.81 > tau 0.50"],
        ),
        (decision(("wave", 0.9), negative=0.5), ["closest to a negative"]),
        # Its action has no other example.
        (decision(("bow", 0.3), ("clap", 0.81)), ["closest to `clap`: confidence 0.81 > tau 0.50"]),
        (decision(("clap", 0.5), ("bow", 0.3)), []),
        (decision(("clap", 0.5), negative=0.5), []),
    ],
)
def test_warnings(seen: Decision, expected: list[str]) -> None:
    assert enrolment_warnings(seen, "wave", HALF) == expected


def test_thresholds_are_those_of_the_actions() -> None:
    seen = decision(("wave", 0.5), ("clap", 0.81))
    assert enrolment_warnings(seen, "wave", Threshold(0.9, "abc", {"wave": 0.4})) == []
    assert enrolment_warnings(seen, "wave", Threshold(0.4, "abc", {"clap": 0.8})) == [
        "also like `clap`: confidence 0.81 > tau 0.80"
    ]


def test_clips_are_kept_with_their_embeddings_in_one_transaction(
    store: SupportStore, recognizer: Recognizer, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.delattr(SupportStore, "keep_embeddings")
    # As an older version, or other weights, would leave it.
    store.enroll("bow", BOW)
    first, again, other = enrol(store, recognizer, " squat ", [SQUAT, SQUAT, OTHER], "at home")
    assert (first.label, first.added, again.added, other.added) == ("squat", True, False, True)
    assert again.example == first.example != other.example
    assert {each.note for each in store.examples("squat")} == {"at home"}
    assert SupportSet.load(store, recognizer).recomputed == {}
    assert other.to_json() == {"example": other.example, "added": True, "warnings": []}


def test_an_example_like_another_action_comes_with_a_warning(
    store: SupportStore, recognizer: Recognizer
) -> None:
    enrol(store, recognizer, "squat", [SQUAT])
    (one,) = enrol(store, recognizer, "crouch", [OTHER])
    assert one.warnings[0].startswith("closest to `squat`: ")
    (one,) = enrol(store, recognizer, "", [OTHER], negative=True)
    assert (one.label, one.added, one.warnings) == ("negatives", True, ())


def test_a_damaged_threshold_keeps_no_clip_out(store: SupportStore, recognizer: Recognizer) -> None:
    store.set_setting("threshold", "half")
    (one,) = enrol(store, recognizer, "squat", [SQUAT])
    assert one.added
    assert one.warnings[0].startswith("not compared with the others: ")


def test_either_side_keeps_the_mirror_image_beside_the_clip(tmp_path: Path) -> None:
    left, right = (read_clip(EXAMPLES / f"wave_{side}/ada.npz") for side in ("left", "right"))
    recognizer = Recognizer()
    with SupportStore(tmp_path / "support.db") as store:
        enrol(store, recognizer, "wave_right", [right])
        assert not SupportSet.load(store, recognizer).classify(left).accepted
        store.remove("wave_right")
        clip, image = enrol(store, recognizer, "wave", [right], either_side=True)
        assert clip.added
        assert image.added
        assert clip.warnings == image.warnings == ()
        assert [each.source.endswith(" (mirrored)") for each in store.examples()] == [False, True]
        assert SupportSet.load(store, recognizer).classify(left).label == "wave"
