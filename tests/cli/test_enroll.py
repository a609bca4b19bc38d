"""enroll."""

import json
from pathlib import Path

import numpy as np

from actioncli import Recognizer, SupportStore, enrol, read_clip
from actioncli.clips.skeleton import LAYOUTS, default_columns

from .conftest import EXAMPLES, ask, invoke


def test_clips_are_added_and_told(store: SupportStore) -> None:
    file = EXAMPLES / "squat/ada.npz"
    result = invoke("enroll", "squat", file, "--note", "porch")
    assert result.exit_code == 0
    [example] = store.examples("squat")
    assert result.stdout == f"squat: ada.npz added as example {example.id} (108 frames, 3.6 s)\n"
    assert (example.source, example.note) == ("ada.npz", "porch")
    # What reading decided is told beside the result, not in it.
    assert "note: ada.npz: " in result.stderr
    np.testing.assert_array_equal(store.clip(example.id).joints, read_clip(file).joints)


def test_the_same_clip_is_not_added_twice(store: SupportStore) -> None:
    ada = EXAMPLES / "squat/ada.npz"
    invoke("enroll", "squat", ada)
    again = invoke("enroll", "squat", ada, EXAMPLES / "squat/cleo.npz")
    assert again.exit_code == 0
    assert "ada.npz already there as example 1" in again.stdout
    assert "cleo.npz added as example 2" in again.stdout
    counts = ask("enroll", "squat", ada)
    assert (counts["added"], counts["known"], counts["failed"]) == (0, 1, 0)
    assert len(store.examples()) == 2


def test_folders_and_patterns_are_taken_and_each_file_once(store: SupportStore) -> None:
    squat = EXAMPLES / "squat"
    result = invoke("enroll", "squat", squat, squat / "*.npz", squat / "ada.npz", "-q")
    assert (result.exit_code, result.output) == (0, "")
    assert len(store.examples("squat")) == len(list(squat.iterdir()))


def test_bad_clips_are_left_out_and_the_rest_is_enrolled(
    store: SupportStore, tmp_path: Path
) -> None:
    text = tmp_path / "text.npy"
    text.write_text("this is no array")
    unfit = tmp_path / "legs.npz"
    legs = np.random.default_rng(0).normal(size=(20, 3, 3))
    np.savez(unfit, joints=legs, joint_names=["lhip", "lkne", "lank"], fps=30, unit="m", up="y")
    words = ["enroll", "squat", text, EXAMPLES / "squat/ada.npz", tmp_path / "none.npy", unfit]
    result = invoke(*words)
    assert result.exit_code == 3
    errors = [line for line in result.stderr.splitlines() if line.startswith("error: ")]
    names = [Path(line.split()[1].rstrip(":")).name for line in errors]
    assert names == ["text.npy", "none.npy", "legs.npz"]
    assert len(store.examples()) == 1
    told = json.loads(invoke(*words, "--json").stdout)
    assert (told["added"], told["known"], told["failed"]) == (0, 1, 3)
    assert ["error" in entry for entry in told["clips"]] == [True, False, True, True]


def test_nothing_usable_leaves_no_store_behind(home: Path, tmp_path: Path) -> None:
    assert invoke("enroll", "wave", "nowhere.npy").exit_code == 3
    words = ["enroll", "wave", EXAMPLES / "squat/ada.npz"]
    assert invoke(*words, "--weights", tmp_path / "none.safetensors").exit_code == 6
    assert not home.exists()


def test_ambiguous_clips_name_the_option_that_helps(tmp_path: Path) -> None:
    file = tmp_path / "clip.npy"
    # 17 joints: two layouts have that many.
    clip = read_clip(EXAMPLES / "squat/ada.npz")
    columns = default_columns(clip.joint_names)
    joints = [list(columns.get(name, columns["neck"])) for name in LAYOUTS["h36m_17"]]
    np.save(file, np.stack([clip.joints[:20, each].mean(axis=1) for each in joints], axis=1))
    result = invoke("enroll", "wave", file)
    assert result.exit_code == 3
    assert "--layout" in result.stderr
    options = ["--layout", "h36m_17", "--unit", "m", "--up", "y", "--fps", "25"]
    told = json.loads(invoke("enroll", "wave", file, *options, "--json").stdout)
    assert told["clips"][0]["seconds"] == 0.76


def test_of_many_repetitions_one_is_enrolled(store: SupportStore, tmp_path: Path) -> None:
    """Five squats as one example made a squat fall from .91 to .04."""
    once = read_clip(EXAMPLES / "squat/ada.npz")
    many = {"joint_names": np.array(once.joint_names), "fps": once.fps, "unit": "m", "up": "y"}
    np.savez(tmp_path / "five.npz", joints=np.tile(once.joints, (5, 1, 1)), **many)
    done = invoke("enroll", "squat", tmp_path / "five.npz")
    assert "one of about 5 repetitions" in done.stderr
    assert store.clip(store.examples("squat")[0].id).duration < 1.2 * once.duration
    (found,) = ask("classify", EXAMPLES / "squat/ben.npz")["clips"]
    assert found["confidence"] > 0.9
    clip = read_clip(tmp_path / "five.npz")
    (one,) = enrol(store, Recognizer(), "squat", [clip])
    assert any("shows about 5 repetitions of 3." in line for line in one.warnings)
