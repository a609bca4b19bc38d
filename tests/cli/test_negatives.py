"""enroll --negative, what classify makes of it, and the warnings of enroll."""

import json

import pytest

from actioncli import Recognizer, SupportStore, read_clip
from actioncli.recognition.decision import compared
from actioncli.recognition.threshold import DEFAULT_TAU

from .conftest import EXAMPLES, ask, invoke

SQUAT = EXAMPLES / "squat/ada.npz"
WAVE_LEFT = EXAMPLES / "wave_left"
PUNCH = EXAMPLES / "punch_right/dev.npz"


def test_negatives_are_enrolled_without_a_label(store: SupportStore) -> None:
    result = invoke("enroll", "--negative", PUNCH, WAVE_LEFT, "--note", "not this")
    assert result.exit_code == 0
    assert result.stdout.splitlines()[0].startswith(
        "negatives: punch_right/dev.npz added as example 1 ("
    )
    assert "warning" not in result.stderr
    assert [example.negative for example in store.examples("negatives")] == [True] * 3
    assert store.support() == {}
    again = ask("enroll", PUNCH, "--negative")
    assert (again["label"], again["negative"], again["known"]) == ("negatives", True, 1)
    action = ask("enroll", "squat", SQUAT)
    assert (action["label"], action["negative"]) == ("squat", False)
    assert action["clips"][0]["warnings"] == []
    assert not store.examples("squat")[0].negative


def test_an_action_of_that_name_is_told(store: SupportStore) -> None:
    invoke("enroll", "negatives", SQUAT)
    result = invoke("enroll", "--negative", PUNCH)
    assert result.exit_code == 2
    assert "actioncli rename negatives NEW" in result.stderr
    invoke("rename", "negatives", "squat")
    assert invoke("enroll", "--negative", PUNCH).exit_code == 0
    assert invoke("enroll", "negatives", SQUAT).exit_code == 2


def test_what_is_nearer_to_a_negative_is_rejected(filled: SupportStore) -> None:
    words = ["classify", SQUAT, "--tau", "0"]
    [before] = ask(*words)["clips"]
    assert (before["accepted"], before["nearest_negative"]) == (True, None)
    # The same motion as a negative: the query is as near to it as to the action.
    invoke("remove", "squat", "--yes")
    invoke("enroll", "squat", EXAMPLES / "squat/cleo.npz")
    invoke("enroll", "--negative", SQUAT, PUNCH)
    result = invoke(*words)
    assert result.exit_code == 1
    [after] = ask(*words)["clips"]
    assert (after["label"], after["accepted"], after["nearest"]) == (None, False, "squat")
    assert after["confidence"] > 0
    assert after["nearest_negative"] < after["ranking"][0]["distance"]
    assert any("nearer to a negative" in note for note in after["notes"])
    assert [ranked["label"] for ranked in after["ranking"]].count("negatives") == 0
    assert sum(ranked["probability"] for ranked in after["ranking"]) == pytest.approx(1, abs=1e-4)
    first = result.stdout.splitlines()[0]
    assert first.startswith("✗ rejected ")
    assert " > 0.00 " in first
    assert first.endswith("ada.npz  (a negative is nearer)")
    invoke("remove", "negatives", "--yes")
    assert ask(*words)["clips"][0]["accepted"]


def test_only_negatives_is_an_empty_support_set(store: SupportStore) -> None:
    invoke("enroll", "--negative", PUNCH)
    assert invoke("classify", SQUAT).exit_code == 4
    listed = invoke("list-support")
    assert "never accepted" in listed.stdout
    assert "enrol an action" in listed.stderr


def test_they_are_listed_apart_shown_and_removed(filled: SupportStore) -> None:
    invoke("enroll", "--negative", PUNCH, WAVE_LEFT, "-q")
    lines = invoke("list-support").stdout.splitlines()
    place = next(n for n, line in enumerate(lines) if line.startswith("never accepted"))
    assert place == 1 + len(filled.support())
    assert [line.split()[:2] for line in lines[place + 1 :]] == [["negatives", "3"]]
    listed = ask("list-support")["actions"]
    assert [entry["label"] for entry in listed if entry["negative"]] == ["negatives"]
    shown = ask("show", "negatives")["examples"]
    assert [example["source"] for example in shown] == ["dev.npz", "ada.npz", "dev.npz"]
    words = ["remove", "negatives", "--example", shown[0]["id"], "--yes"]
    assert invoke(*words).exit_code == 0
    assert len(filled.negatives()) == 2


def test_an_example_of_another_action_is_told(filled: SupportStore) -> None:
    others = [EXAMPLES / f"squat/{who}.npz" for who in ("ben", "cleo")]
    invoke("enroll", "squat", *others, "-q", "--keep-tau")
    # A kick that was taken for a squat.
    stray = EXAMPLES / "kick_right/cleo.npz"
    seen = Recognizer().classify(read_clip(stray), filled.support())
    ranked = {one.label: one.confidence for one in seen.ranking}
    assert seen.nearest == "kick"
    result = invoke("enroll", "squat", stray, "--json")
    assert result.exit_code == 0
    [entry] = json.loads(result.stdout)["clips"]
    told = [f"closest to `kick`: {compared(ranked['kick'], DEFAULT_TAU)}"]
    if ranked["squat"] <= DEFAULT_TAU:
        about = compared(ranked["squat"], DEFAULT_TAU)
        told.insert(0, f"unlike the other examples of `squat`: {about}")
    assert (entry["added"], entry["warnings"]) == (True, told)
    assert "warning: cleo.npz: closest to `kick`: " in result.stderr
    # Once it is there, the same clip is told as such and not warned about.
    [again] = ask("enroll", "squat", stray)["clips"]
    assert (again["added"], again["warnings"]) == (False, [])


def test_clips_of_one_call_are_compared_with_one_another(store: SupportStore) -> None:
    files = [EXAMPLES / name for name in ("squat/ada.npz", "squat/ben.npz", "bow/ben.npz")]
    recognizer = Recognizer()
    clips = [read_clip(file) for file in files]
    entries = ask("enroll", "squat", *files)["clips"]
    for n, entry in enumerate(entries):
        rest = {"squat": [clip for m, clip in enumerate(clips) if m != n]}
        confidence = recognizer.classify(clips[n], rest).confidence
        about = compared(confidence, DEFAULT_TAU)
        told = [f"unlike the other examples of `squat`: {about}"]
        assert entry["warnings"] == (told if confidence <= DEFAULT_TAU else [])


def test_enrolment_needs_no_weights(store: SupportStore, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("actioncli.model.weights.DEFAULT_WEIGHTS", "none.safetensors")
    result = invoke("enroll", "squat", SQUAT)
    assert result.exit_code == 0
    assert "warning: the clips are not checked" in result.stderr
    assert len(store.examples("squat")) == 1
