"""calibrate, and what classify makes of it."""

import json
from pathlib import Path

import numpy as np
import pytest

from actioncli import Clip, Recognizer, SupportStore, read_clip
from actioncli.calibration.threshold import TAUS
from actioncli.calibration.trials import KINDS
from actioncli.clips.write import write_clip
from actioncli.recognition.threshold import Threshold, keep_threshold, kept_threshold

from .conftest import EXAMPLES, ask, invoke
from .test_json_keys import documented, found

SQUAT = EXAMPLES / "squat/ada.npz"
# Three motions are enough to tell a quarter.
LOOSE = ["--target-far", "0.25"]


@pytest.fixture
def several(store: SupportStore) -> SupportStore:
    """Four actions with two or three examples each, and one of which there is only one."""
    for folder in ("squat", "wave_right", "kick_right", "jumping_jack", "bow"):
        assert invoke("enroll", folder, EXAMPLES / folder, "-q", "--keep-tau").exit_code == 0
    return store


@pytest.fixture
def checksum() -> str:
    return Recognizer().weights.checksum


def test_the_table_is_told_and_the_threshold_kept_and_used(
    several: SupportStore, checksum: str
) -> None:
    assert invoke("calibrate", *LOOSE, "--dry-run").stdout.endswith(": not kept\n")
    assert kept_threshold(several) is None
    result = invoke("calibrate", *LOOSE)
    assert result.exit_code == 0
    header, *lines = result.stdout.splitlines()
    assert header.split() == ["tau", "false", "accepts", "false", "rejects", "misnamed"]
    [recommended] = [line for line in lines if line.endswith("<- recommended")]
    tau = float(recommended.split()[0])
    assert lines[-1] == f"tau {tau:g}: kept, classify uses it unless --tau is given"
    assert kept_threshold(several) == Threshold(tau, checksum, {})
    assert "1 of 5 actions have one example" in result.stderr
    quiet = invoke("calibrate", *LOOSE, "-q")
    assert (quiet.stdout, quiet.stderr) == (f"{lines[-1]}\n", "")

    def used(*words: str) -> float:
        answer = ask("classify", SQUAT, *words)
        assert answer["clips"][0]["tau"] == answer["tau"]
        return float(answer["tau"])

    assert used() == tau
    assert used("--tau", "0.75") == 0.75
    assert invoke("calibrate", "--reset", "-q").output == ""
    assert used() == 0.5


def test_json(several: SupportStore, checksum: str) -> None:
    told = ask("calibrate", *LOOSE)
    assert (told["measured"], told["kept"], told["weights"]) == (True, True, checksum)
    taus = [row["tau"] for row in told["table"]]
    assert taus == sorted({*TAUS, told["tau"]})
    cohort = len(Recognizer().cohort)
    [row] = [row for row in told["table"] if row["tau"] == told["tau"]]
    assert row["false_accepts"]["of"] == 12 + cohort
    assert row["false_accepts"]["motions"] == 5 + cohort
    assert row["false_accepts"]["rate"] <= 0.25
    # Eleven of the twelve examples have another of their action.
    assert (row["false_rejects"]["of"], row["misnamed"]["of"]) == (11, 11)
    assert [kind["kind"] for kind in told["unknown"]] == list(KINDS)
    assert [kind["false_accepts"]["of"] for kind in told["unknown"]] == [12, 0, cohort]
    nothing = told["unknown"][1]["false_accepts"]
    assert nothing == {"count": 0, "of": 0, "motions": 0, "rate": None, "low": 0, "high": 1}
    assert [action["examples"] for action in told["actions"]] == [1, 3, 2, 3, 3]
    assert sum(action["false_rejects"]["of"] for action in told["actions"]) == 11
    assert sum(action["false_accepts"]["of"] for action in told["actions"]) == 12 + cohort


def test_keys_are_the_documented_ones(several: SupportStore) -> None:
    keys = found(ask("calibrate"), "", {})
    rates = {
        path: keys.pop(path) for path in list(keys) if path.endswith(("s", "d")) and "." in path
    }
    documentation = documented(invoke("calibrate", "--help").stdout)
    figures = documentation.pop(".false_accepts, .false_rejects, .misnamed")
    reset = documentation.pop("With --reset")
    for path in ("With --background", "rates[]", "events[]"):
        documentation.pop(path)
    assert keys == documentation
    kinds = {path.rpartition(".")[2] for path in rates}
    assert kinds == {"false_accepts", "false_rejects", "misnamed"}
    assert all(names == figures for names in rates.values())
    assert set(ask("calibrate", "--reset")) == reset


def test_nothing_is_kept_where_nothing_can_be_told(filled: SupportStore) -> None:
    keep_threshold(filled, Threshold(0.9, "abc"))
    words = ["calibrate", "--target-far", "0.001"]
    dry = json.loads(invoke(*words, "--dry-run", "--json").stdout)
    assert (dry["tau"], dry["measured"], dry["kept"]) == (0.5, False, False)
    assert kept_threshold(filled) == Threshold(0.9, "abc")
    result = invoke(*words)
    assert result.exit_code == 0
    assert kept_threshold(filled) is None
    assert "<- recommended" not in result.stdout
    assert result.stdout.endswith("tau 0.5, as without calibration: nothing else can be told\n")
    assert "false accept rate of 0.001 needs 999" in result.stderr
    assert "False rejects cannot be told: every action has one example" in result.stderr
    assert "none asked" in result.stdout


def test_clips_that_show_nothing_are_read_from_anywhere(
    several: SupportStore, tmp_path: Path
) -> None:
    words = ["calibrate", *LOOSE, "--json", "--dry-run"]
    punch = EXAMPLES / "punch_right/dev.npz"
    result = invoke(*words, "--negatives", EXAMPLES / "wave_left", "--negatives", punch)
    assert result.exit_code == 0
    assert json.loads(result.stdout)["unknown"][1]["false_accepts"]["of"] == 3
    assert len(several.negatives()) == 0

    text = tmp_path / "text.npy"
    text.write_text("this is no array")
    result = invoke(*words, "--negatives", text, "--negatives", punch)
    assert result.exit_code == 3
    assert f"error: {text}" in result.stderr
    told = json.loads(result.stdout)
    assert (told["failed"], told["unknown"][1]["false_accepts"]["of"]) == (1, 1)


def test_actions_with_thresholds_of_their_own(several: SupportStore, tmp_path: Path) -> None:
    words = ["calibrate", *LOOSE, "--per-action"]
    for folder in ("wave_left", "punch_right"):
        words += ["--negatives", str(EXAMPLES / folder)]
    told = json.loads(invoke(*words, "--json").stdout)
    kept = kept_threshold(several)
    assert kept is not None
    assert kept.actions
    taus = {action["label"]: action["tau"] for action in told["actions"]}
    assert {label: taus[label] for label in kept.actions} == pytest.approx(kept.actions)
    for action in told["actions"]:
        if action["label"] in kept.actions:
            assert action["false_accepts"]["rate"] <= 0.25
    text = invoke(*words).stdout
    assert "one of its own: kept" in text or "ones of their own: kept" in text
    for file in sorted(EXAMPLES.glob("*/*.npz")):
        [entry] = json.loads(invoke("classify", file, "--json").stdout)["clips"]
        assert entry["tau"] == pytest.approx(taus[entry["nearest"]])
        assert entry["accepted"] <= (entry["confidence"] > entry["tau"])


def test_a_threshold_of_other_weights_is_told_and_not_used(
    several: SupportStore, checksum: str
) -> None:
    keep_threshold(several, Threshold(0.9, "other", {"squat": 0.8}))
    result = invoke("classify", SQUAT, "--json")
    assert json.loads(result.stdout)["tau"] == 0.5
    assert "0.9, belongs to other weights" in result.stderr
    assert "other weights" not in invoke("classify", SQUAT, "--json", "--tau", "0.5").stderr
    assert "measured with other weights" in invoke("calibrate", *LOOSE).stderr
    kept = kept_threshold(several)
    assert kept is not None
    assert kept.weights == checksum


def test_a_damaged_threshold_is_code_5_until_it_is_forgotten(filled: SupportStore) -> None:
    filled.set_setting("threshold", "half")
    result = invoke("classify", SQUAT)
    assert result.exit_code == 5
    assert "calibrate --reset" in result.stderr
    # Enrolment goes on without comparing.
    result = invoke("enroll", "squat", EXAMPLES / "squat/cleo.npz")
    assert result.exit_code == 0
    assert "not compared" in result.stderr
    assert invoke("calibrate", "--reset").exit_code == 0
    assert invoke("classify", SQUAT).exit_code in (0, 1)


def test_reset_makes_no_support_set(home: Path) -> None:
    assert invoke("calibrate", "--reset").exit_code == 0
    assert not home.exists()


@pytest.fixture(scope="module")
def day(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Somebody waves, three times, and stands between."""
    clip = read_clip(EXAMPLES / "wave_right" / "cleo.npz")
    still = np.repeat(clip.joints[-1:], round(3 * clip.fps), axis=0)
    joints = np.concatenate([still, *[clip.joints, still] * 3])
    joints = joints + np.random.default_rng(0).normal(0, 1e-4, joints.shape)
    file = tmp_path_factory.mktemp("day") / "day.npz"
    write_clip(file, Clip(joints, clip.joint_names, clip.fps))
    return file


def test_an_ordinary_day_is_counted_and_becomes_negatives(
    store: SupportStore, day: Path, checksum: str
) -> None:
    assert invoke("enroll", "squat", SQUAT, "-q").exit_code == 0
    quiet = ask("calibrate", "--background", day)
    assert (quiet["tau"], quiet["kept"], quiet["negatives"], quiet["events"]) == (0.5, True, [], [])
    assert [row["events"] for row in quiet["rates"]] == [0] * 10
    # Three events were to be expected where e^-3.7 is 0.025, and there were none.
    hours = quiet["minutes"] / 60
    assert quiet["rates"][0]["high"] == pytest.approx(3.689 / hours, rel=1e-3)
    assert "minutes are few: it may be up to" in quiet["notes"][0]
    assert kept_threshold(store) == Threshold(0.5, checksum)

    # It is no ordinary day for whoever enrols what is done in it.
    wave = EXAMPLES / "wave_right" / "ada.npz"
    assert invoke("enroll", "wave", wave, "-q", "--keep-tau").exit_code == 0
    words = ["calibrate", "--background", day]
    dry = ask(*words, "--dry-run")
    assert [event["label"] for event in dry["events"]] == ["wave"] * 3
    assert dry["rates"][0]["events"] == 3
    counts = [row["events"] for row in dry["rates"]]
    assert counts == sorted(counts, reverse=True)
    [chosen] = [row for row in dry["rates"] if row["tau"] == dry["tau"]]
    assert (chosen["events"], dry["kept"], dry["negatives"]) == (0, False, [])
    # The lowest at which there are so few: how sure an event is depends on those before it.
    assert all(row["events"] for row in dry["rates"] if row["tau"] < dry["tau"])
    assert kept_threshold(store) == Threshold(0.5, checksum)
    assert len(store.negatives()) == 0
    often = ask(*words, "--dry-run", "--target-events", 1e4)
    assert (often["tau"], often["target_events"]) == (0.5, 1e4)
    part = ask(*words, "--dry-run", "--minutes", 0.2)
    assert part["minutes"] == pytest.approx(0.2, abs=0.02)
    assert len(part["events"]) < 3

    result = invoke(*words)
    assert result.exit_code == 0
    assert "What came nearest, 3 clips, is kept as negatives." in result.stdout
    assert result.stdout.endswith(f"\ntau {dry['tau']:g}: kept, watch and classify use it unless "
                                  "--tau is given\n")  # fmt: skip
    assert "actioncli remove negatives --example" in result.stderr
    assert kept_threshold(store) == Threshold(dry["tau"], checksum)
    assert [one.source for one in store.negatives()] == [
        f"{day.name} {event['start']:.1f} s to {event['end']:.1f} s" for event in dry["events"]
    ]


def test_keys_of_an_ordinary_day_are_the_documented_ones(several: SupportStore, day: Path) -> None:
    keys = found(ask("calibrate", "--background", day, "--dry-run"), "", {})
    documentation = documented(invoke("calibrate", "--help").stdout)
    assert keys[""] == documentation["With --background"]
    for path in ("rates[]", "events[]"):
        assert keys[path] == documentation[path]
