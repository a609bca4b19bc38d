"""What a user installs: everything that is needed, nothing else, and light to import."""

import importlib.metadata
import json
import os
import re
import shutil
import subprocess
import sys
import tomllib
import zipfile
from pathlib import Path

import pytest

import actioncli
from actioncli.cli.app import COMMANDS
from actioncli.errors import WeightsError
from actioncli.files import weights_file, weights_folder

ROOT = Path(__file__).parent.parent
IMAGE = (ROOT / "Dockerfile").read_text(encoding="utf-8")
CARD = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))


@pytest.fixture(scope="module")
def wheel(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The wheel, built as in the Dockerfile from a copy of what that copies."""
    source = tmp_path_factory.mktemp("source")
    skipped = shutil.ignore_patterns("__pycache__")
    for copied in re.findall(r"^COPY (.*) /source/(\S*)$", IMAGE, re.MULTILINE):
        *names, place = [*copied[0].split(), copied[1]]
        for name in names:
            if (ROOT / name).is_dir():
                shutil.copytree(ROOT / name, source / place, ignore=skipped)
            else:
                shutil.copy(ROOT / name, source / place)
    target = tmp_path_factory.mktemp("wheel")
    build = [sys.executable, "-m", "build", "--wheel", "--no-isolation", "--outdir", str(target)]
    made = subprocess.run([*build, str(source)], capture_output=True, text=True, check=False)
    assert made.returncode == 0, made.stdout + made.stderr
    return next(target.glob("*.whl"))


def test_wheel_holds_package_weights_examples_and_nothing_else(wheel: Path) -> None:
    with zipfile.ZipFile(wheel) as archive:
        held = {name for name in archive.namelist() if ".dist-info/" not in name}
    code = {
        path.relative_to(ROOT).as_posix()
        for path in (ROOT / "actioncli").rglob("*")
        if path.suffix in {".py", ".typed", ".css", ".html", ".js", ".svg"}
    }
    weights = {f"actioncli/weights/{path.name}" for path in (ROOT / "weights").iterdir()}
    examples = {
        f"actioncli/{path.relative_to(ROOT).as_posix()}" for path in ROOT.glob("examples/*/*.npz")
    }
    assert held == code | weights | examples


def test_wheel_works_from_any_folder(wheel: Path, tmp_path: Path) -> None:
    site = tmp_path / "site"
    with zipfile.ZipFile(wheel) as archive:
        archive.extractall(site)
    script = (
        "from actioncli.files import examples_folder, weights_folder\n"
        "from actioncli.recognition.recognizer import Recognizer\n"
        "print(weights_folder())\n"
        "print(Recognizer().weights.path)\n"
        "print(*sorted(examples_folder().glob('bow/*')))\n"
    )
    ran = subprocess.run(
        [sys.executable, "-c", script],
        cwd=tmp_path,
        env={**os.environ, "PYTHONPATH": str(site)},
        capture_output=True,
        text=True,
        check=True,
    )
    folder, weights, example = map(Path, ran.stdout.split())
    assert folder == site / "actioncli" / "weights"
    assert weights == folder / "trx_os.safetensors"
    assert example == site / "actioncli" / "examples" / "bow" / "ben.npz"


def test_image_copies_what_its_ignore_file_lets_through_and_runs_the_command() -> None:
    ignore = (ROOT / ".dockerignore").read_text(encoding="utf-8")
    copied = " ".join(re.findall(r"^COPY (.*) /source/\S*$", IMAGE, re.MULTILINE)).split()
    assert sorted(re.findall(r"^!(.+)$", ignore, re.MULTILINE)) == sorted(copied)
    # Its first lines are how it is used; each command there is one of the program's.
    used = re.findall(r"^# docker run .* actioncli (\S+)", IMAGE, re.MULTILINE)
    assert {"enroll", "watch"} <= set(used) <= COMMANDS.keys()
    [entry] = re.findall(r"^ENTRYPOINT (.*)$", IMAGE, re.MULTILINE)
    [words] = re.findall(r"^CMD (.*)$", IMAGE, re.MULTILINE)
    program, *first = json.loads(entry) + json.loads(words)
    assert CARD["project"]["scripts"][program] == "actioncli.__main__:main"
    assert subprocess.run([sys.executable, "-m", program, *first], check=False).returncode == 0


def test_the_wheel_is_tried_on_every_system_and_python_that_is_named(wheel: Path) -> None:
    yaml = pytest.importorskip("yaml")
    jobs = yaml.safe_load((ROOT / ".github/workflows/wheels.yml").read_text())["jobs"]
    matrix = jobs["try"]["strategy"]["matrix"]
    named = {"Linux": "ubuntu", "MacOS": "macos", "Windows": "windows"}
    classifiers = [line.split(" :: ") for line in CARD["project"]["classifiers"]]
    systems = {named[words[-1]] for words in classifiers if words[0] == "Operating System"}
    assert {system.partition("-")[0] for system in matrix["system"]} == systems
    pythons = [words[-1] for words in classifiers if words[0] == "Programming Language"]
    assert matrix["python"] == [pythons[0], pythons[-1]]
    assert CARD["project"]["requires-python"] == f">={pythons[0]}"
    # One wheel for all of them; what is run there runs here.
    assert wheel.name.endswith("-py3-none-any.whl")
    commands = [step["run"] for step in jobs["try"]["steps"] if "run" in step]
    assert commands[0] == "python -m pip install dist/*.whl"
    for command in commands[1:]:
        program, name = command.split()
        assert program == "actioncli"
        assert name in COMMANDS


def test_every_package_is_listed() -> None:
    found = {
        ".".join(path.parent.relative_to(ROOT).parts)
        for path in (ROOT / "actioncli").rglob("__init__.py")
    }
    beside = {"actioncli.weights", "actioncli.examples"}
    assert set(CARD["tool"]["setuptools"]["packages"]) == found | beside


def test_version_is_the_same_everywhere() -> None:
    changelog = (ROOT / "CHANGELOG.md").read_text(encoding="utf-8")
    newest = re.search(r"^## \[(\d[^\]]*)\]", changelog, re.MULTILINE)
    assert newest is not None
    assert newest[1] == actioncli.__version__ == importlib.metadata.version("actioncli")
    citation = (ROOT / "CITATION.cff").read_text(encoding="utf-8")
    assert f"\nversion: {newest[1]}\n" in citation


def test_only_training_needs_torch() -> None:
    assert not any("torch" in need for need in CARD["project"]["dependencies"])
    assert "torch==2.13.0" in CARD["project"]["optional-dependencies"]["train"]


def test_the_licence_of_every_requirement_is_listed() -> None:
    listed = (ROOT / "THIRD_PARTY.md").read_text(encoding="utf-8")
    user, development = listed.split("What development installs")
    wanted = {re.split(r"[^\w-]", need)[0] for need in CARD["project"]["dependencies"]}
    assert wanted <= set(re.findall(r"^\| ([\w.-]+) +\| \w", user, re.MULTILINE))
    extras = CARD["project"]["optional-dependencies"]
    wanted = {
        re.split(r"[^\w-]", need)[0]
        for name in ("report", "studio", "train")
        for need in extras[name]
    }
    assert wanted <= set(re.findall(r"^\| ([\w.-]+) +\| \w", development, re.MULTILINE))


def test_weights_stand_beside_the_package_in_a_checkout() -> None:
    assert weights_folder() == ROOT / "weights"
    assert weights_file("trx_os.safetensors").is_file()


def test_a_missing_file_names_itself_and_the_way_out() -> None:
    with pytest.raises(WeightsError, match=r"no_such_net.* is missing.*[Ii]nstall it again"):
        weights_file("no_such_net.onnx")
