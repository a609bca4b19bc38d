"""`actioncli.open()`: enrol, classify, explain and watch, as the commands do."""

import sys
from pathlib import Path

import numpy as np
import pytest

import actioncli
from actioncli import Actions, SupportError, SupportSet, SupportStore, UsageError
from actioncli.recognition.threshold import Threshold, keep_threshold

EXAMPLES = Path(__file__).parents[1] / "examples"
WAVE, SQUAT, BOW = (EXAMPLES / f"{name}.npz" for name in ("wave_right/ada", "squat/ada", "bow/ben"))


@pytest.fixture
def actions(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Actions:
    monkeypatch.setenv("ACTIONCLI_HOME", str(tmp_path))
    actions = actioncli.open()
    assert not list(tmp_path.iterdir())
    with pytest.raises(SupportError, match="enrol an action first"):
        actions.classify(WAVE)
    assert "none yet" in repr(actions)
    [first] = actions.enrol("wave", WAVE)
    assert first.added
    actions.enrol("squat", str(SQUAT))
    return actions


def test_files_and_clips_are_classified_as_the_commands_do(actions: Actions) -> None:
    query = EXAMPLES / "wave_right" / "cleo.npz"
    decision = actions.classify(query)
    assert decision == actions.classify(actioncli.read_clip(query))
    assert decision == SupportSet.load().classify(actioncli.read_clip(query))
    assert decision.label == "wave"
    assert actions.classify(query, tau=1).label is None
    assert repr(actions) == f"Actions(squat, wave; {actions.store.path})"


def test_what_others_enrol_and_calibrate_is_heeded(actions: Actions) -> None:
    same = actions.support
    assert actions.support is same
    other = SupportStore()
    keep_threshold(other, Threshold(1.0, actions.recognizer.weights.checksum))
    assert not actions.classify(WAVE)
    keep_threshold(other, None)
    assert actions.classify(WAVE)
    assert actions.classify(BOW, tau=0)
    actions.enrol("", BOW, negative=True, note="bowing")
    assert actions.classify(BOW, tau=0).negative_is_nearer
    assert {each.note for each in other.examples() if each.negative} == {"bowing"}


def test_all_clips_of_a_call_are_kept_or_none(actions: Actions) -> None:
    with pytest.raises(actioncli.ClipError, match=r"none\.npz"):
        actions.enrol("jump", EXAMPLES / "jumping_jack" / "ada.npz", "none.npz")
    assert "jump" not in actions.support.actions
    with pytest.raises(UsageError):
        actions.enrol("", WAVE)
    assert len(actions.enrol("kick", EXAMPLES / "kick_right" / "ada.npz", either_side=True)) == 2


def test_why(actions: Actions) -> None:
    why = actions.explain(BOW)
    assert why.score < 0
    assert "accepted (confidence 0.61 > tau 0.50)" in why.lacking(0.5)


def test_tables(actions: Actions, monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip("pandas")
    examples = actions.to_pandas()
    assert list(examples["label"]) == ["squat", "wave"]
    assert examples.loc[1, "source"] == "ada.npz"
    ranking = actions.classify(WAVE).to_pandas()
    assert list(ranking.index) == ["wave", "squat"]
    assert ranking.loc["wave", "confidence"] > 0.9
    clip = actioncli.read_clip(WAVE)
    table = clip.to_pandas()
    assert table.shape == (len(clip), 3 * len(clip.joint_names))
    assert table.index[-1] == pytest.approx(clip.duration)
    wrist = table[["rwri.x", "rwri.y", "rwri.z"]].to_numpy()
    np.testing.assert_array_equal(wrist, clip.joints[:, clip.joint_names.index("rwri")])
    monkeypatch.setitem(sys.modules, "pandas", None)
    with pytest.raises(UsageError, match="pip install pandas"):
        clip.to_pandas()


def test_watching_a_clip_or_its_file_gives_the_same_events(
    actions: Actions, tmp_path: Path
) -> None:
    clips = [actioncli.read_clip(path) for path in (SQUAT, WAVE, SQUAT)]
    joints = np.concatenate([clip.joints for clip in clips])
    file = tmp_path / "stream.npz"
    names = np.array(clips[0].joint_names)
    np.savez(file, joints=joints, joint_names=names, fps=clips[0].fps, unit="m", up="y")
    events = list(actions.watch(file))
    assert [event.label for event in events] == ["squat", "wave", "squat"]
    assert events == list(actions.watch(actioncli.read_clip(file)))
    assert not list(actions.watch(file, tau=1))
