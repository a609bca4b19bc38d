"""A support set that was carried to another machine decides as it did on the first."""

import json
import os
import shutil
import stat
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from actioncli import Recognizer, SupportSet, SupportStore, read_clip
from actioncli.recognition.threshold import Threshold, keep_threshold, kept_threshold

from .conftest import EXAMPLES, invoke, run, shaking

QUERIES = ["squat/ben", "wave_left/ada", "punch_right/dev", "kick_right/cleo"]


@pytest.fixture
def calibrated(filled: SupportStore) -> SupportStore:
    """Five actions, a negative, a new name, a gap in the numbers, a threshold for one action."""
    filled.enroll_all([("noise", read_clip(EXAMPLES / "punch_right/dev.npz"))], negative=True)
    filled.enroll("squat", read_clip(EXAMPLES / "squat/ben.npz"), note="zweite – 二")
    filled.remove("bow")
    filled.rename("kick", "Tritt (rechts)")
    keep_threshold(filled, Threshold(0.3, Recognizer().weights.checksum, {"squat": 0.999999}))
    return filled


def test_decisions_travel_bit_for_bit(calibrated: SupportStore, tmp_path: Path) -> None:
    """Another home, working folder and language."""
    machines = []
    for name, language in (("here", "C"), ("über – dort", "tr_TR.UTF-8")):
        folder = tmp_path / name
        folder.mkdir()
        for query in QUERIES:
            (folder / query).parent.mkdir(exist_ok=True)
            shutil.copy(EXAMPLES / f"{query}.npz", folder / f"{query}.npz")
        environment = {**os.environ, "ACTIONCLI_HOME": str(folder / "home"), "LANG": language}
        environment |= {"LC_ALL": language, "OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}
        machines.append({"cwd": folder, "env": environment})
    here, there = machines
    (here["cwd"] / "home").mkdir(mode=0o700)
    shutil.copy(calibrated.path, here["cwd"] / "home" / "support.db")

    def ask(machine: dict[str, Any], *words: str) -> dict[str, Any]:
        result = run(*words, "--json", **machine)
        assert result.returncode in {0, 1}, result.stderr
        document: dict[str, Any] = json.loads(result.stdout)
        return document

    def decide(machine: dict[str, Any]) -> list[dict[str, Any]]:
        told = ask(machine, "classify", *(f"{query}.npz" for query in QUERIES))["clips"]
        return [{key: value for key, value in clip.items() if key != "ms"} for clip in told]

    assert ask(here, "export", "set.safetensors")["examples"] == 6
    shutil.copy(here["cwd"] / "set.safetensors", there["cwd"] / "set.safetensors")
    answer = ask(there, "import", "set.safetensors")
    assert (answer["added"], answer["threshold_taken"]) == (6, True)
    first, second = decide(here), decide(there)
    assert first == second
    assert {clip["label"] for clip in first} >= {None}
    assert {clip["tau"] for clip in first} == {0.3, 0.999999}
    assert {clip["nearest_negative"] is None for clip in first} == {False}
    # JSON has six digits; these are all of them.
    stores = [SupportStore(machine["cwd"] / "home" / "support.db") for machine in machines]
    recognizer = Recognizer()
    embedded = [SupportSet.load(store, recognizer).actions for store in stores]
    assert list(embedded[0]) == list(embedded[1])
    for label in embedded[0]:
        assert np.array_equal(embedded[0][label], embedded[1][label])
    # What was carried there can be carried back, and is the same file but for the numbers.
    ask(there, "export", "again.safetensors")
    again = (there["cwd"] / "again.safetensors").read_bytes()
    assert again == (here["cwd"] / "set.safetensors").read_bytes()
    assert stat.S_IMODE((there["cwd"] / "again.safetensors").stat().st_mode) == 0o600


def test_a_threshold_of_other_examples_is_left(store: SupportStore, tmp_path: Path) -> None:
    store.enroll("wave", shaking(0))
    keep_threshold(store, Threshold(0.25, "w"))
    file = tmp_path / "actions.safetensors"
    invoke("export", file)
    other = SupportStore(tmp_path / "other.db")
    other.enroll("squat", shaking(1))
    result = invoke("import", file, "--store", other.path)
    assert result.exit_code == 0
    assert "calibrated threshold was left" in result.stderr
    assert kept_threshold(other) is None
    fresh = tmp_path / "fresh.db"
    result = invoke("import", file, "--store", fresh)
    assert result.stderr == ""
    assert kept_threshold(SupportStore(fresh)) == Threshold(0.25, "w")
