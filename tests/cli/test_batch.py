"""`batch` on a real Ray cluster of two nodes: the decisions of `classify`, whatever happens."""

from __future__ import annotations

import json
import os
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import pytest

from actioncli import SupportStore

from .conftest import EXAMPLES, Invoke, Run

pytestmark = pytest.mark.skipif(
    not (find_spec("ray") and sys.platform == "linux"), reason="needs the extra `ray` and /proc"
)
ENVIRONMENT = {**os.environ, "RAY_USAGE_STATS_ENABLED": "0", "RAY_AUTH_MODE": "disabled"}
PATIENCE = 300


@pytest.fixture(scope="module")
def cluster() -> Iterator[str]:
    """The address of two nodes, each with one core."""
    script = Path(__file__).parents[1] / "two_nodes.py"
    nodes = subprocess.Popen(
        [sys.executable, str(script)],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        env=ENVIRONMENT,
        text=True,
    )
    assert nodes.stdout is not None
    try:
        address = nodes.stdout.readline().strip()
        assert address, "the cluster did not start"
        yield address
    finally:
        nodes.communicate(timeout=PATIENCE)


@pytest.fixture
def archive(tmp_path: Path) -> Path:
    """Forty clips, one that is damaged and one that is empty."""
    folder = tmp_path / "archive"
    folder.mkdir()
    clips = sorted(EXAMPLES.glob("*/*.npz"))
    for number in range(40):
        shutil.copy(clips[number % len(clips)], folder / f"{number:02d}.npz")
    (folder / "damaged.npz").write_bytes(clips[0].read_bytes()[:500])
    (folder / "empty.npy").touch()
    return folder


def rows(output: Path) -> dict[str, dict[str, Any]]:
    from pyarrow import parquet

    table = parquet.read_table(output).to_pylist()
    return {Path(row["source"]).name: row for row in table}


def worker() -> int | None:
    """A process of the stage."""
    for entry in Path("/proc").glob("[0-9]*/cmdline"):
        try:
            if entry.read_bytes().startswith(b"ray::MapWorker"):
                return int(entry.parent.name)
        except OSError:
            continue
    return None


@pytest.mark.usefixtures("filled")
def test_two_nodes_decide_as_classify_though_a_worker_dies(
    cluster: str, archive: Path, tmp_path: Path, run: Run
) -> None:
    output = tmp_path / "decisions.parquet"
    command = ["batch", str(archive), str(output), "--ray", cluster, "--json"]
    started = subprocess.Popen(
        [sys.executable, "-m", "actioncli", *command],
        env={**ENVIRONMENT, "ACTIONCLI_HOME": os.environ["ACTIONCLI_HOME"]},
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )
    deadline = time.monotonic() + PATIENCE
    while (found := worker()) is None and started.poll() is None and time.monotonic() < deadline:
        time.sleep(0.05)
    if found is not None:
        os.kill(found, signal.SIGKILL)
    told, errors = started.communicate(timeout=PATIENCE)
    assert found is not None, errors
    assert started.returncode == 3, errors
    summary = json.loads(told)
    assert (summary["clips"], summary["failed"], summary["done_before"]) == (42, 2, 0)
    classified = json.loads(run("classify", archive, "--json").stdout)
    ours = rows(output)
    assert len(ours) == len(classified["clips"]) == 42
    for clip in classified["clips"]:
        row = ours[Path(clip["source"]).name]
        if "error" in clip:
            assert row["error_type"] == clip["error"]["type"]
            assert row["accepted"] is None
            continue
        for name in ("label", "accepted", "nearest"):
            assert row[name] == clip[name]
        assert row["confidence"] == pytest.approx(clip["confidence"], abs=1e-5)
        assert row["distance"] == pytest.approx(clip["ranking"][0]["distance"], rel=1e-4)
    assert output.stat().st_mode & 0o777 == 0o600
    assert sorted(path.name for path in tmp_path.iterdir() if path.is_file()) == [output.name]

    # Again: only what is new or changed.
    shutil.copy(archive / "01.npz", archive / "new.npz")
    os.utime(archive / "00.npz", (1, 1))
    again = run(*command, env={**ENVIRONMENT, "ACTIONCLI_HOME": os.environ["ACTIONCLI_HOME"]})
    summary = json.loads(again.stdout)
    assert (summary["clips"], summary["done_before"], summary["failed"]) == (43, 41, 2)
    assert again.returncode == 3
    assert rows(output)["new.npz"]["label"] == rows(output)["01.npz"]["label"]


def test_other_decisions_are_not_mixed(
    filled: SupportStore, tmp_path: Path, invoke: Invoke
) -> None:
    from actioncli.batch_results import Results

    output = tmp_path / "decisions.parquet"
    Results(output, {"weights": "of old", "support set": "", "tau": "", "options": ""}).finish()
    result = invoke("batch", EXAMPLES / "squat", output)
    assert result.exit_code == 2
    assert "other weights and support set and tau and options" in result.stderr
    assert "--restart" in result.stderr


@pytest.mark.usefixtures("filled")
@pytest.mark.parametrize(
    ("name", "told"), [("nothing", "no such file"), ("empty", "no clips or videos")]
)
def test_inputs_without_files_are_told(
    name: str, told: str, tmp_path: Path, invoke: Invoke
) -> None:
    (tmp_path / "empty").mkdir()
    result = invoke("batch", tmp_path / name, tmp_path / "decisions.parquet")
    assert result.exit_code == 3
    assert told in result.stderr
    assert not (tmp_path / "decisions.parquet").exists()


def test_an_empty_support_set_is_told(tmp_path: Path, invoke: Invoke) -> None:
    result = invoke("batch", EXAMPLES / "squat", tmp_path / "decisions.parquet")
    assert result.exit_code == 4


def test_a_list_names_files_beside_it(tmp_path: Path) -> None:
    from actioncli.cli.batch import _sources

    shutil.copytree(EXAMPLES / "squat", tmp_path / "clips")
    (tmp_path / "list.txt").write_text("clips\n\nclips/ada.npz\nmissing.mp4\n")
    found = _sources(tmp_path / "list.txt")
    clips = sorted((tmp_path / "clips").glob("*.npz"))
    assert found == [str(path) for path in [*clips, tmp_path / "missing.mp4"]]
