"""What commands refuse before they begin: one line that says what, and an exit code."""

import json
from pathlib import Path

import pytest

from actioncli import SupportStore

from .conftest import EXAMPLES, invoke

WAVE, SQUAT = str(EXAMPLES / "wave_right/ada.npz"), str(EXAMPLES / "squat/ada.npz")
USAGE = [
    ("clasify x", "Did you mean 'classify'?"),
    ("ls", "actioncli list"),
    ("version", "actioncli --version"),
    ("classify", "Missing argument"),
    ("enroll", "Missing argument"),
    ("enroll squat", "Missing argument 'CLIP...'"),
    ("enroll --negative", "Missing argument"),
    (f"enroll {__file__}", f"actioncli enroll LABEL {__file__}"),
    ("enroll \x20 x.npy", "a name is empty"),
    ("enroll a\x1b[31mb x.npy", "U+001B"),
    ("enroll \u3164 x.npy", "U+3164"),
    (f"enroll squat {SQUAT} --layout centaur", "--layout"),
    (f"enroll squat {SQUAT} --unit parsec", "--unit"),
    (f"enroll squat {SQUAT} --up left", "--up"),
    (f"enroll squat {SQUAT} --fps 0", "--fps"),
    ("enroll wave a.npz --camera 0", "--camera records"),
    ("enroll wave --camera 0 --seconds nan", "--seconds must be a number from 0.5 to 60"),
    ("remove wave --example two", "--example"),
    ("remove wave", "--yes"),
    ("clear", "--yes"),
    ("rename squat wave", "wave"),
    ("rename squat a\x07b", "U+0007"),
    ("classify --bogus x", "--bogus"),
    ("classify --tau high x", "--tau"),
    ("classify --tau 1.5 x", "0"),
    ("classify --tau nan x", "tau"),
    ("classify --top -1 x", "--top"),
    ("classify a.mp4 --quality best", "--quality"),
    ("classify a.npz --annotate b.mp4", "draws on one video"),
    ("classify a.mp4 b.mp4 --annotate c.mp4", "draws on one video"),
    ("classify a.mp4 --annotate b.avi", "end in .mp4"),
    ("classify a.mp4 --annotate a.mp4", "not written over"),
    ("classify a.mp4 --annotate no/b.mp4", "there is no folder no."),
    (f"classify {WAVE} {SQUAT} --explain a.html", "tells about one clip"),
    (f"classify {EXAMPLES}/squat --explain a.html", "tells about one clip"),
    (f"classify {WAVE} --explain a.png", "ends in .html"),
    (f"classify {WAVE} --explain none/a.html", "folder does not exist"),
    ("extract a.mp4 -o a.xyz", "does not say how to write it"),
    ("extract a.mp4 -o a.npz --format xyz", "--format is one of"),
    ("extract a.mp4 -o no/a.npz", "there is no folder"),
    ("watch a.mp4 --exec no-such-program-here", "no such program"),
    (f"watch a.mp4 --exec {SQUAT}", "it may not be run; `chmod +x` lets it"),
    ("watch a.mp4 --exec '", "is no command"),
    ("watch 0 --page --sets", "--page shows what is told, and takes no --sets"),
    ("show squat -o a.jpg", "drawings are written as"),
    ("show squat -o none/a.png", "folder does not exist"),
    ("calibrate --target-far 0", "--target-far"),
    ("calibrate --target-far 1", "--target-far"),
    ("calibrate --target-far nan", "--target-far"),
    ("calibrate --reset --per-action", "--reset"),
    ("calibrate --reset --dry-run", "--reset"),
    ("calibrate --reset --negatives x.npy", "--reset"),
    ("calibrate --minutes 3", "belong to --background"),
    ("calibrate --background 0 --reset", "counts events"),
    ("calibrate --background 0 --target-far 0.1", "counts events"),
    ("calibrate --background 0 --minutes nan", "must be above 0"),
    ("calibrate --background 0 --target-events 0", "must be above 0"),
    ("calibrate --background 0 --unit mm", "for files of joints"),
]


@pytest.mark.parametrize(("line", "named"), USAGE, ids=[line for line, _ in USAGE])
def test_wrong_usage_is_one_line_and_code_2(
    filled: SupportStore, tmp_path: Path, monkeypatch: pytest.MonkeyPatch,
    line: str, named: str,
) -> None:  # fmt: skip
    monkeypatch.chdir(tmp_path)
    before = sorted(tmp_path.rglob("*"))
    for more in ([], ["--json"]):
        result = invoke(*line.split(" "), *more)
        assert result.exit_code == 2
        error = result.stderr.splitlines()[-1]
        assert error.startswith("error: ")
        assert named in error
        assert "\x1b" not in result.output
        wanted = {"error": {"type": "UsageError", "message": error[7:], "exit_code": 2}}
        assert (json.loads(result.stdout) if more else result.stdout) == (wanted if more else "")
    assert sorted(tmp_path.rglob("*")) == before
    assert len(filled.examples()) == 5


@pytest.mark.parametrize(
    "words",
    [["classify", SQUAT, "nowhere.npy"], ["watch", "a.mp4"], ["calibrate"], ["export", "out"],
     ["batch", SQUAT, "out.csv"], ["show", "clap"], ["remove", "clap", "-y"],
     ["rename", "clap", "new"], ["show", "'; DROP TABLE examples; --"]],
    ids=lambda words: words[0],
)  # fmt: skip
def test_where_nothing_is_enrolled_it_is_code_4(
    home: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, words: list[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    result = invoke(*words, "--json")
    assert (result.exit_code, result.stderr.startswith("error: ")) == (4, True)
    assert json.loads(result.stdout)["error"]["type"] == "SupportError"
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(
    "command",
    ["list-support --store FILE", "show x --store FILE", "remove x -y --store FILE",
     "clear -y --store FILE", f"enroll squat {SQUAT} --store FILE", "doctor --repair --store FILE",
     f"enroll squat {SQUAT} --store FILE/support.db", f"enroll squat {SQUAT} --store /dev/null",
     "export FILE", "export FILE/out", "import FILE", "import FILE/none"],
)  # fmt: skip
def test_a_file_that_is_no_store_is_code_5(
    filled: SupportStore, tmp_path: Path, command: str
) -> None:
    broken = tmp_path / "broken.db"
    content = "not a database, but long enough to be taken for one" * 40
    broken.write_text(content)
    result = invoke(*command.replace("FILE", str(broken)).split(), "--json")
    assert (result.exit_code, json.loads(result.stdout)["error"]["exit_code"]) == (5, 5)
    error = result.stderr.splitlines()[-1]
    assert error.startswith("error: ")
    assert "broken.db" in error or "/dev/null" in command
    assert broken.read_text() == content
    assert sorted(path.name for path in tmp_path.iterdir()) == ["broken.db", "home"]
    assert len(filled.examples()) == 5


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["a.mp4"], "No such file"),
        (["99"], "camera 99: cannot be opened"),
        (["99999999999999999999"], "there is none; cameras are numbered from 0"),
        (["."], "is a folder; a video is needed"),
    ],
)
def test_what_cannot_be_watched(filled: SupportStore, words: list[str], message: str) -> None:
    done = invoke("watch", *words)
    assert (done.exit_code, message in done.stderr) == (3, True)
