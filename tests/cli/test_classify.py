"""classify."""

import json
import os
import re
import shlex
import shutil
import sys
from pathlib import Path

import numpy as np
import pytest

from actioncli import SupportStore, read_clip
from actioncli.cli.answer import short_names

from .conftest import ACTIONS, EXAMPLES, at_terminal, invoke, run

SQUAT = EXAMPLES / "squat/ada.npz"


def test_accepted_and_rejected_clips(filled: SupportStore) -> None:
    result = invoke("classify", SQUAT, "--tau", "0")
    assert result.exit_code == 0
    # At tau 0 every action comes close, so that they are ranked.
    first, header, *ranking = result.stdout.splitlines()
    assert re.fullmatch(
        r"✓ squat         │━{12}  \d\.\d\d > 0\.00  0\.0 to 3\.6 s  ada\.npz", first
    )
    assert header.split() == ["action", "distance", "probability", "confidence"]
    assert ranking[0].split()[0] == "squat"
    assert len(ranking) == len(ACTIONS)
    # What reading decided comes after the verdict, and once.
    assert "note: ada.npz: unit inferred" in result.stderr
    for words in ([], ["--top", "0"], ["-q"]):
        result = invoke("classify", SQUAT, "--tau", "1", *words)
        [line] = result.stdout.splitlines()
        assert result.exit_code == 1
        assert line.startswith("✗ rejected      ━━━━━━━━━━━━│  ")
        assert " <= 1.00" in line
        assert line.endswith("  ada.npz  (nearest squat)")
        assert (result.stderr == "") == (words == ["-q"])
    for words, lines in ((["--top", "2"], 4), (["--tau", "0", "--top", "0"], 1)):
        assert len(invoke("classify", SQUAT, *words).stdout.splitlines()) == lines


@pytest.mark.parametrize("said", [{}, {"NO_COLOR": "1"}, {"TERM": "dumb"}])
def test_terminals_with_colours_get_them_unless_they_are_not_wanted(
    filled: SupportStore, said: dict[str, str]
) -> None:
    place = {name: text for name, text in os.environ.items() if name not in ("NO_COLOR", "TERM")}
    plain = bool(said)
    words = [sys.executable, "-m", "actioncli", "classify", str(SQUAT), "-q"]
    _, shown = at_terminal(words, "stdout", env=place | said)
    written = shown.decode()
    assert ("\x1b[32m✓\x1b[0m \x1b[1msquat" in written) != plain
    assert ("✓ squat" in written) == plain


def test_terminals_without_such_signs_get_others(filled: SupportStore) -> None:
    done = run("classify", SQUAT, env={**os.environ, "PYTHONIOENCODING": "ascii"})
    assert done.stdout.startswith("+ squat         ======|======  ")


def test_a_decision_fits_into_a_narrow_terminal_and_beside_a_long_label(
    filled: SupportStore,
) -> None:
    assert invoke("rename", "jumping jack", "a" * 100).exit_code == 0
    done = run("classify", SQUAT, env={**os.environ, "COLUMNS": "50"})
    assert re.fullmatch(r"✓ squat     \d\.\d\d > 0\.50  0\.0 to 3\.6 s  ada\.npz\n", done.stdout)
    [line] = invoke("classify", SQUAT).stdout.splitlines()
    assert "│" in line
    assert len(line) < 80


def test_of_one_rejected_clip_the_way_on_is_told(filled: SupportStore) -> None:
    bow = EXAMPLES / "punch_right/dev.npz"
    said = invoke("classify", bow).stderr.splitlines()
    assert re.search(r"as in the example it would have been accepted \(confidence", said[0])
    [again] = [line for line in said if line.startswith("If it is the same to you: ")]
    words = shlex.split(again.partition(": actioncli ")[2])
    assert invoke(*words).exit_code == 0
    assert words[0] == "enroll"
    assert any(f"actioncli classify {bow} --explain why.html" in line for line in said)
    assert invoke("classify", bow).exit_code == 0
    # Not of many, nor where it is nearer to a negative.
    assert "If it is" not in invoke("classify", SQUAT, bow, "--tau", "1").stderr
    invoke("enroll", "--negative", bow)
    invoke("remove", words[1], "--yes")
    said = invoke("classify", bow).stderr.splitlines()
    assert said[0].startswith("It is nearer to what you enrolled with --negative")
    assert not any("If it is" in line for line in said)


def test_names_are_short_and_notes_are_told_once(filled: SupportStore, tmp_path: Path) -> None:
    result = invoke("classify", EXAMPLES / "squat", EXAMPLES / "jumping_jack", EXAMPLES / "bow")
    names = [re.findall(r" s  (\S+\.npz)", line)[0] for line in result.stdout.splitlines()]
    assert names == [
        *("squat/ada.npz", "squat/ben.npz", "cleo.npz"),
        *("jumping_jack/ada.npz", "jumping_jack/ben.npz", "dev.npz", "bow/ben.npz"),
    ]
    notes = [line for line in result.stderr.splitlines() if line.startswith("note: ")]
    assert notes == sorted(set(notes), key=notes.index)
    assert "note: 7 clips: unit inferred from the size of the body: mm (--unit)" in notes
    paths = [Path(name) for name in ("a/b/c.npy", "x/b/c.npy", "b/c.npy", "d.npy", "")]
    assert list(short_names(paths).values()) == ["a/b/c.npy", "x/b/c.npy", "b/c.npy", "d.npy", ""]


@pytest.mark.parametrize("quiet", [False, True])
def test_a_long_clip_shows_how_far_it_is(filled: SupportStore, tmp_path: Path, quiet: bool) -> None:
    long = read_clip(SQUAT).joints
    np.save(tmp_path / "long.npy", np.concatenate([long, long[::-1]] * 2))
    told = ["--fps", "30", "--layout", "smpl+head_30", "--unit", "m", "--up", "y", "--tau", "0"]
    words = ["classify", str(tmp_path / "long.npy"), *told]
    # As if comparing took long; the bar over files never shows for one of them.
    script = (
        "from actioncli.cli import output; output._PATIENCE_SECONDS = -1; "
        "output.progress = lambda items, *_, **__: iter(items); "
        "from actioncli.__main__ import main; main()"
    )
    more = ["--quiet"] if quiet else []
    done, written = at_terminal([sys.executable, "-c", script, *words, *more], "stderr")
    assert (done.returncode, "✓ squat" in done.stdout) == (0, True), written
    assert (b"Comparing" in written, b"100%" in written) == (not quiet, not quiet)


def test_the_part_of_a_long_clip_is_told(filled: SupportStore, tmp_path: Path) -> None:
    clips = [read_clip(EXAMPLES / f"{name}.npz") for name in ("punch_right/dev", "squat/ben")]
    before, squat = clips
    joints = np.concatenate([before.joints, squat.joints, before.joints])
    long = tmp_path / "long.npz"
    np.savez(long, poses3d=joints, joint_names=squat.joint_names, fps=squat.fps, unit="m", up="y")
    result = invoke("classify", long)
    assert result.exit_code == 0, result.stdout
    assert re.search(r"matched \d+\.\d s to \d+\.\d s, the surest of \d+ windows", result.stderr)
    [entry] = json.loads(invoke("classify", long, "--json").stdout)["clips"]
    assert entry["label"] == "squat"
    assert 0 < entry["part"]["start"] < entry["part"]["end"] < (len(joints) - 1) / squat.fps
    page = tmp_path / "why.html"
    invoke("classify", long, "--explain", page)
    text = page.read_text(encoding="utf-8")
    assert "The clip is a window of a long one" in text
    assert "the surest of" in text
    [whole] = json.loads(invoke("classify", SQUAT, "--json").stdout)["clips"]
    assert whole["part"] == {"start": 0, "end": pytest.approx(read_clip(SQUAT).duration, rel=1e-4)}


def test_bad_clips_are_reported_and_the_rest_goes_on(filled: SupportStore, tmp_path: Path) -> None:
    empty = tmp_path / "empty.npy"
    empty.touch()
    text = tmp_path / "text.npy"
    text.write_text("text")
    (tmp_path / "folder").mkdir()
    bad = [tmp_path / "none.npy", empty, text, tmp_path / "folder", tmp_path / "no*.json",
           Path("a/" * 3000), Path("x" * 300 + ".npy")]  # fmt: skip
    words = ["classify", *bad, SQUAT, "--tau", "1"]
    result = invoke(*words)
    # A clip that cannot be read counts for more than one that is rejected.
    assert result.exit_code == 3
    errors = [line for line in result.stderr.splitlines() if line.startswith("error: ")]
    assert len(errors) == len(bad)
    assert all(str(path) in line for path, line in zip(bad, errors, strict=True))
    assert "squat" in result.stdout
    told = json.loads(invoke(*words, "--json").stdout)
    assert (told["accepted"], told["rejected"], told["failed"]) == (0, 1, len(bad))
    assert [entry["source"] for entry in told["clips"]] == [*map(str, bad), str(SQUAT)]
    for entry in told["clips"][:-1]:
        assert entry["error"]["exit_code"] == 3


def test_weights_that_cannot_be_used_are_code_6(filled: SupportStore, tmp_path: Path) -> None:
    damaged = tmp_path / "damaged.safetensors"
    damaged.write_bytes(b"\x08\0\0\0\0\0\0\0{}      ")
    for weights in (damaged, tmp_path / "none.safetensors", tmp_path):
        result = invoke("classify", SQUAT, "--weights", weights)
        assert result.exit_code == 6
        assert str(weights) in result.stderr


def test_batches_decide_as_each_clip_alone(
    filled: SupportStore, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    folder = tmp_path / "clips"
    folder.mkdir()
    queries = [SQUAT, *sorted(EXAMPLES.glob("wave_*/*.npz"))]
    for number, query in enumerate(queries):
        shutil.copy(query, folder / f"{number}.npz")
    np.save(folder / "3_broken.npy", np.zeros((4, 2)))
    # A clip whose joints the model cannot use is only found out when its batch is embedded.
    names = np.array(["nose", "pelv", "lhip", "rhip", "lkne", "lank", "rkne", "rank", "head"])
    walk = read_clip(SQUAT)
    some = walk.joints[:, [walk.joint_names.index(name) for name in names]]
    np.savez(folder / "4_half.npz", joints=some, joint_names=names, fps=30, unit="m", up="y")
    alone = {
        path.name: json.loads(invoke("classify", path, "--json").stdout)["clips"][0]
        for path in sorted(folder.iterdir())
    }
    monkeypatch.setattr("actioncli.cli.classify._BATCH", 4)
    result = invoke("classify", folder, "--json")
    assert result.exit_code == 3
    told = json.loads(result.stdout)
    assert told["failed"] == 2
    assert [Path(entry["source"]).name for entry in told["clips"]] == sorted(alone)
    for entry in told["clips"]:
        other = alone[Path(entry["source"]).name]
        assert entry.get("error") == other.get("error")
        assert entry.get("label") == other.get("label")
        assert entry.get("confidence", 0) == pytest.approx(other.get("confidence", 0), abs=1e-5)
