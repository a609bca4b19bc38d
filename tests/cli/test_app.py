"""The application: options in any place, one style of errors, exit codes, startup."""

import json
import os
import re
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
from typer.testing import CliRunner

import actioncli
from actioncli import Recognizer, SupportStore
from actioncli.cli import app as application
from actioncli.cli.app import COMMANDS
from actioncli.recognition.threshold import Threshold, keep_threshold

from .conftest import EXAMPLES, invoke, run, shaking


def test_version() -> None:
    result = invoke("--version")
    assert (result.exit_code, result.stdout) == (0, f"actioncli {actioncli.__version__}\n")


def test_without_a_command_help_is_shown_and_usage_is_wrong() -> None:
    result = invoke()
    assert (result.exit_code, result.stdout) == (2, "")
    commands = result.stderr.partition("Commands:\n")[2].partition("\n\n")[0].splitlines()
    assert [line.split()[0] for line in commands] == list(COMMANDS)
    assert not [line for line in commands if line.endswith("...")]


@pytest.mark.parametrize("name", COMMANDS)
def test_each_command_has_help_with_examples_and_its_json_keys(name: str) -> None:
    result = invoke(name, "--help")
    assert result.exit_code == 0
    assert f"Examples:\n    actioncli {name}" in result.stdout
    assert "JSON keys:\n" in result.stdout
    for option in ("--store", "--json", "--quiet", "--debug"):
        assert option in result.stdout


def test_help_has_what_is_wanted_first_first() -> None:
    shown = invoke("--help").stdout
    places = [shown.index(each) for each in ("Examples:", "Commands:", "Exit codes:")]
    assert places == sorted(places)
    assert "enroll wave wave.mp4" in shown[: places[1]]


def test_list_is_short_for_list_support(filled: SupportStore) -> None:
    assert invoke("list").stdout == invoke("list-support").stdout
    assert "squat" in invoke("list").stdout
    assert "`list` is a short name" in invoke("list", "--help").stdout


def test_own_settings_are_defaults_of_options(filled: SupportStore, home: Path) -> None:
    file = home / "config.toml"
    squat = EXAMPLES / "squat/cleo.npz"
    file.write_text("tau = 1\nquality = 'accurate'\ncamera = 7\n")
    assert invoke("classify", squat).exit_code == 1
    assert invoke("classify", squat, "--tau", "0.5").exit_code == 0
    keep_threshold(filled, Threshold(0.4, Recognizer().weights.checksum))
    assert invoke("classify", squat).exit_code == 0
    assert "camera 7" in invoke("watch").stderr
    # Without a topic it is refused before anything is sent.
    file.write_text(f"{file.read_text()}mqtt = 'mqtt://me:secret@host'\n")
    assert "the address ends in a topic" in invoke("watch").stderr
    found = invoke("doctor").stdout
    assert re.search(
        rf"settings +ok +tau 1.0, quality accurate, camera 7, mqtt mqtt://host \({file}", found
    )
    file.write_text("quality = 'best'")
    for words in (["list"], ["classify", squat]):
        result = invoke(*words)
        assert result.exit_code == 2
        assert f"error: {file}: quality cannot be 'best'" in result.stderr
    result = invoke("doctor")
    assert result.exit_code == 2
    assert re.search(rf"settings +problem +{file}", result.stdout)


def test_options_are_understood_before_and_after_the_command(tmp_path: Path) -> None:
    elsewhere = tmp_path / "elsewhere.db"
    SupportStore(elsewhere).enroll("wave", shaking(0))
    before = invoke("--store", elsewhere, "--json", "list-support")
    after = invoke("list-support", "--json", "--store", elsewhere)
    assert before.stdout == after.stdout
    assert json.loads(after.stdout)["store"] == str(elsewhere)
    # The one beside the command wins.
    both = invoke("--store", tmp_path / "other.db", "list-support", "--store", elsewhere, "--json")
    assert both.stdout == after.stdout
    # Nothing of one call reaches the next.
    assert invoke("list-support").stdout == ""


@pytest.mark.parametrize("where", [["--debug", "show", "x"], ["show", "--debug", "x"]])
def test_debug_shows_the_traceback(where: list[str]) -> None:
    result = invoke(*where)
    assert result.exit_code == 4
    assert "Traceback (most recent call last)" in result.stderr
    assert result.stderr.splitlines()[-1].startswith("error: ")
    assert "Traceback" not in invoke("show", "x").stderr


def test_a_bug_is_told_in_one_line_with_the_way_to_its_place(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    def broken(self: SupportStore) -> None:
        raise ZeroDivisionError("by\nzero\x1b[31m")

    monkeypatch.setattr(SupportStore, "actions", broken)
    result = invoke("list-support")
    assert result.exit_code == 70
    assert result.stderr == (
        "error: unexpected ZeroDivisionError: by zero\\x1b[31m "
        "(this is a bug; --debug shows where)\n"
    )
    shown = invoke("list-support", "--debug").stderr
    assert "in broken" in shown
    assert "\x1b" not in shown


def test_closed_output_is_no_error_to_talk_about(filled: SupportStore) -> None:
    reading, writing = os.pipe()
    os.close(reading)
    with os.fdopen(writing, "w") as closed:
        done = run("list-support", stdout=closed, stderr=subprocess.PIPE)
    assert (done.returncode, done.stderr) == (application.EXIT_BROKEN_PIPE, "")


@pytest.mark.parametrize("closed", [">&-", "2>&-", "<&- >&- 2>&-"])
@pytest.mark.parametrize(
    ("words", "code"),
    [
        (["enroll", "wave", EXAMPLES / "wave_right/ada.npz"], 0),
        (["classify", EXAMPLES / "squat/ben.npz"], None),
        (["doctor", "--bogus"], 2),
        (["show", "squat"], None),
        (["remove", "squat"], 2),
    ],
)
def test_streams_may_be_closed(
    filled: SupportStore, closed: str, words: list[object], code: int | None
) -> None:
    """Where nothing but the answer was asked for, and it would be lost, that is an error."""
    lost = ">&-" in closed.split()
    code = (74 if lost else 0) if code is None else code

    command = [sys.executable, "-m", "actioncli", *map(str, words)]
    shell = ["sh", "-c", f'exec "$@" {closed}', "sh", *command]
    done = subprocess.run(shell, capture_output=True, text=True, check=False, timeout=120)
    assert done.returncode == code, done.stderr
    assert bool(done.stdout) == (code == 0 and not lost)


@pytest.mark.parametrize(
    ("words", "code"),
    [
        (["list-support", "--json"], 74),
        (["--help"], 74),
        (["--version"], 74),
        (["classify", "--help"], 74),
        (["show", "nobody"], 4),
    ],
)
def test_where_output_cannot_be_written_it_is_told_and_the_exit_code_tells(
    filled: SupportStore, words: list[str], code: int
) -> None:
    with Path("/dev/full").open("w") as full:
        done = run(*words, stdout=full, stderr=subprocess.PIPE)
        assert run(*words, stdout=full, stderr=full).returncode == done.returncode == code
    if code == 74:
        assert done.stderr == "error: the output cannot be written: No space left on device.\n"


def test_labels_that_the_terminal_cannot_show_are_escaped(store: SupportStore) -> None:
    store.enroll("手を振る", shaking(0))
    plain = {**os.environ, "PYTHONIOENCODING": "latin-1", "PYTHONUTF8": "0"}
    done = run("list-support", env=plain)
    assert done.returncode == 0
    assert r"\u624b\u3092\u632f\u308b" in done.stdout


@pytest.mark.usefixtures("unmeasured")
@pytest.mark.parametrize("command", ["classify", "enroll"])
def test_ctrl_c_ends_with_130_and_leaves_nothing_half_done(
    filled: SupportStore, tmp_path: Path, command: str
) -> None:
    clips = tmp_path / "many"
    clips.mkdir()
    # On the test's own disk, where hard links can be made.
    first = shutil.copy(EXAMPLES / "squat/cleo.npz", tmp_path / "clip.npz")
    for number in range(3000):
        os.link(first, clips / f"{number:04}.npz")
    label = ["new"] if command == "enroll" else []
    words = [sys.executable, "-u", "-m", "actioncli", "-q", command, *label, str(clips)]
    process = subprocess.Popen(
        words, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, start_new_session=True
    )
    assert process.stdout is not None
    if command == "classify":
        assert process.stdout.readline()
    else:
        # It says nothing before it is done: numpy is loaded when the command has begun.
        maps = Path(f"/proc/{process.pid}/maps")
        while maps.exists() and "_multiarray_umath" not in maps.read_text():
            time.sleep(0.05)
        time.sleep(0.5 if maps.exists() else 2)
    process.send_signal(signal.SIGINT)
    output, errors = process.communicate(timeout=60)
    assert process.returncode == 130
    assert errors == "error: interrupted\n"
    assert len(output.splitlines()) < 2999
    assert "new" not in [action.label for action in filled.actions()]


def test_what_was_ignored_stays_ignored() -> None:
    """As nohup has it; and a program that calls the application keeps its handlers."""
    during = []
    number = signal.SIGHUP
    before = signal.getsignal(number)
    try:
        for handler in (signal.SIG_IGN, signal.SIG_DFL):
            signal.signal(number, handler)
            with application._ended_like_ctrl_c():
                during.append(signal.getsignal(number))
            assert signal.getsignal(number) is handler
    finally:
        signal.signal(number, before)
    assert during == [signal.SIG_IGN, signal.default_int_handler]


# What must not be imported, because it alone takes longer than the whole command may.
_HEAVY = "torch onnxruntime cv2 scipy pydantic rich"


@pytest.mark.usefixtures("unmeasured")
@pytest.mark.parametrize(
    ("words", "heavy"),
    [
        (["-c", "import actioncli"], f"numpy sqlite3 typer {_HEAVY}"),
        (["-m", "actioncli", "--version"], f"numpy sqlite3 {_HEAVY}"),
        (["-m", "actioncli", "--help"], f"numpy sqlite3 {_HEAVY}"),
        (["-m", "actioncli", "list-support"],
         f"numpy platformdirs hashlib safetensors array_api_compat {_HEAVY}"),
        (["-m", "actioncli", "show", "wave", "--json"], f"numpy {_HEAVY}"),
        (["-m", "actioncli", "show", "wave"], _HEAVY),
        (["-m", "actioncli", "classify", str(EXAMPLES / "squat/cleo.npz")],
         f"numpy.f2py numpy.testing {_HEAVY}"),
    ],
)  # fmt: skip
def test_commands_import_nothing_heavy(filled: SupportStore, words: list[str], heavy: str) -> None:
    words = [sys.executable, "-X", "importtime", *words]
    done = subprocess.run(words, capture_output=True, text=True, check=False)
    assert done.returncode in (0, 1), done.stderr
    imported = set(re.findall(r"^import time:.*\| +([\w.]+)$", done.stderr, re.MULTILINE))
    assert "actioncli" in imported
    assert not imported & set(heavy.split())


def test_public_names_are_there_and_others_are_not() -> None:
    for name in actioncli.__all__:
        assert getattr(actioncli, name) is not None
        assert name in dir(actioncli)
    with pytest.raises(AttributeError, match="no attribute 'nothing'"):
        actioncli.nothing  # noqa: B018
    errors = [getattr(actioncli, name) for name in actioncli.__all__ if name.endswith("Error")]
    assert len(errors) == 7
    assert all(issubclass(error, actioncli.ActionCliError) for error in errors)


def _complete(line: str) -> list[str]:
    """What the shell is offered; `test_completion_works_in_a_shell` asks one."""
    asked = {"_ACTIONCLI_COMPLETE": "complete_bash", "COMP_WORDS": line}
    asked["COMP_CWORD"] = str(line.count(" "))
    done = CliRunner().invoke(application.app, [], prog_name="actioncli", env=asked)
    assert done.stderr == ""
    return [line for line in done.stdout.splitlines() if line]


def test_completion_knows_commands_labels_and_layouts(filled: SupportStore, tmp_path: Path) -> None:
    assert _complete("actioncli cl") == ["classify", "clear"]
    assert _complete("actioncli show s") == ["squat"]
    labels = [action.label.replace(" ", r"\ ") for action in filled.actions()]
    assert _complete("actioncli remove ") == labels
    assert _complete("actioncli rename b") == ["bow"]
    assert _complete("actioncli enroll w") == ["wave"]
    assert _complete("actioncli classify --layout smpl") == ["smpl_24", "smpl+head_30"]
    assert _complete(f"actioncli show --store {filled.path} s") == ["squat"]
    assert _complete(f"actioncli --store {filled.path} show s") == ["squat"]
    # Where there is nothing to offer it is silent, and makes nothing.
    broken, none = tmp_path / "broken.db", tmp_path / "none.db"
    broken.write_text("not a database")
    assert _complete(f"actioncli show --store {broken} ") == []
    assert _complete(f"actioncli show --store {none} ") == []
    assert not none.exists()


@pytest.mark.skipif(shutil.which("bash") is None, reason="needs bash")
def test_completion_works_in_a_shell(filled: SupportStore, tmp_path: Path) -> None:
    command = tmp_path / "actioncli"
    command.write_text(f'#!/bin/sh\nexec {sys.executable} -m actioncli "$@"\n')
    command.chmod(0o755)
    script = f"""
        export PATH={tmp_path}:$PATH
        eval "$(actioncli --show-completion)"
        COMP_WORDS=(actioncli show j) COMP_CWORD=2
        _actioncli_completion actioncli
        printf '%s\\n' "${{COMPREPLY[@]}}"
    """
    done = subprocess.run(
        ["bash", "--norc", "-c", script], capture_output=True, text=True, check=True
    )
    assert (done.stdout, done.stderr) == ("jumping\\ jack\n", "")
