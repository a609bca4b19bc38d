"""A support set of its own for each test, and ways to run a command: in this process, in one of
its own, or at a terminal."""

import contextlib
import json
import os
import shutil
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from typer.testing import CliRunner, Result

from actioncli import Clip, SupportStore, read_clip
from actioncli.cli.app import app
from actioncli.clips.skeleton import DEFAULT_JOINTS, LAYOUTS

EXAMPLES = Path(__file__).parents[2] / "examples"
ACTIONS = {
    "wave": "wave_right/cleo",
    "squat": "squat/ada",
    "bow": "bow/ben",
    "jumping jack": "jumping_jack/ada",
    "kick": "kick_right/ada",
}


def invoke(*arguments: object, typed: str | None = None) -> Result:
    """Run a command in this process."""
    result = CliRunner().invoke(app, [str(word) for word in arguments], input=typed)
    assert result.exception is None or isinstance(result.exception, SystemExit)
    return result


def ask(*arguments: object) -> dict[str, Any]:
    """The JSON document of a command."""
    document: dict[str, Any] = json.loads(invoke(*arguments, "--json").stdout)
    return document


def run(*arguments: object, **more: Any) -> subprocess.CompletedProcess[str]:
    """Run a command in a process of its own."""
    words = [sys.executable, "-m", "actioncli", *map(str, arguments)]
    options: dict[str, Any] = {"stdin": subprocess.DEVNULL, "timeout": 120, **more}
    if not options.keys() & {"stdout", "stderr"}:
        options["capture_output"] = True
    return subprocess.run(words, text=True, check=False, **options)


def shaking(seed: int) -> Clip:
    """Clips that differ by their seed, for what needs no recognition."""
    joints = np.random.default_rng(seed).normal(size=(12, 15, 3))
    return Clip(joints, LAYOUTS["default_15"], source=f"clip{seed}.npy")


def write_collection(
    file: Path, classes: int, people: int, repeats: int, rng: np.random.Generator
) -> None:
    """A made-up collection: everybody swings as the class says."""
    rows = [(c, p) for c in range(classes) for p in range(people) for _ in range(repeats)]
    standing = rng.normal(0, 400, (1, len(DEFAULT_JOINTS), 3))
    swings = rng.normal(0, 200, (classes, len(DEFAULT_JOINTS), 3))
    wave = np.sin(np.linspace(0, 6, 20))[:, None, None]
    clips = [standing + swings[c] * wave + rng.normal(0, 20, standing.shape) for c, _ in rows]
    np.savez(
        file,
        joints_mm=np.concatenate(clips).astype(np.int16),
        lengths=np.full(len(rows), 20, np.int32),
        labels=np.array([f"action {c}" for c, _ in rows]),
        subjects=np.array([f"p{p}" for _, p in rows]),
        joint_names=np.array(DEFAULT_JOINTS),
        fps=np.float32(20),
    )


def at_terminal(
    words: Sequence[str], *streams: str, typed: bytes = b"", **options: Any
) -> tuple[subprocess.CompletedProcess[str], bytes]:
    """Run a program some of whose streams are a terminal: how it ended, and what was shown."""
    terminal, side = os.openpty()
    os.write(terminal, typed)
    pipes = dict.fromkeys(("stdin", "stdout", "stderr"), subprocess.PIPE)
    pipes |= dict.fromkeys(streams, side)
    shown = b""
    with subprocess.Popen(words, text=True, **pipes, **options) as process:
        os.close(side)
        with contextlib.suppress(OSError):  # how Linux tells that the other side is closed
            while part := os.read(terminal, 65536):
                shown += part
        os.close(terminal)
        stdout, stderr = process.communicate()
    return subprocess.CompletedProcess(words, process.returncode, stdout, stderr), shown


@pytest.fixture(autouse=True)
def home(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder of its own for the support set."""
    folder = tmp_path / "home"
    monkeypatch.setenv("ACTIONCLI_HOME", str(folder))
    return folder


@pytest.fixture
def store(home: Path) -> SupportStore:
    """The support set that commands use."""
    return SupportStore(home / "support.db")


@pytest.fixture(scope="session")
def five(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder of a support set with five actions of the examples."""
    folder = tmp_path_factory.mktemp("five") / "home"
    clips = [(label, read_clip(EXAMPLES / f"{name}.npz")) for label, name in ACTIONS.items()]
    SupportStore(folder / "support.db").enroll_all(clips)
    return folder


@pytest.fixture
def filled(store: SupportStore, five: Path) -> SupportStore:
    """The support set that commands use, with five actions of the examples."""
    shutil.copytree(five, store.path.parent)
    return store
