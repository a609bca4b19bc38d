"""`batch`: the decisions of `classify`, whatever happens, here and on two nodes.

Starting Ray takes ten seconds of processor time and more, and it gives its processes fifteen
seconds to answer, which a machine that is busy with other tests does not keep. So what starts Ray
runs with `make nightly`.
"""

import csv
import json
import os
import re
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from actioncli import SupportStore
from actioncli.archives.results import COLUMNS, Results

from .conftest import EXAMPLES, invoke

needs_ray = pytest.mark.skipif(not find_spec("ray"), reason="needs the extra `ray`")
PATIENCE = 600
Started = Callable[..., subprocess.Popen[str]]


@pytest.mark.usefixtures("filled")
@pytest.mark.parametrize(
    ("words", "code", "message"),
    [
        (["nothing", "out.csv"], 3, "no such file"),
        (["empty", "out.csv"], 3, "no clips or videos"),
        (["*", "out.csv"], 3, "no "),
        (["empty", "out.xlsx"], 2, "tables are written as .csv or .parquet"),
        (["empty", "no/out.csv"], 2, "there is no folder"),
        (["empty", "out.csv", "--ray", "nowhere"], 2, "there is no Ray cluster at 'nowhere'"),
        (["empty", "out.csv", "--ray", "127.0.0.1:1"], 2, "there is no Ray cluster at"),
    ],
)
def test_what_batch_refuses(
    words: list[str], code: int, message: str, tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:  # fmt: skip
    (tmp_path / "empty").mkdir()
    if "--ray" in words:
        pytest.importorskip("ray", reason="needs the extra `ray`")
        shutil.copy(EXAMPLES / "squat/ada.npz", tmp_path / "empty")
    monkeypatch.chdir(tmp_path)
    result = invoke("batch", *words)
    assert (result.exit_code, message in result.stderr) == (code, True), result.stderr
    assert not Path("out.csv").exists()


def test_without_the_extra_it_is_named_where_it_is_needed(
    filled: SupportStore, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setattr("actioncli.cli.batch.find_spec", lambda name: None)
    for words in (["out.parquet"], ["out.csv", "--ray", "auto"]):
        result = invoke("batch", EXAMPLES, *words)
        assert result.exit_code == 2
        assert "pip install 'actioncli[ray]'" in result.stderr
    # The table is none of the recordings, though it stands among them.
    shutil.copytree(EXAMPLES / "squat", tmp_path / "squat")
    for _ in range(2):
        result = invoke("batch", tmp_path / "squat", tmp_path / "squat/out.csv")
        assert (result.exit_code, "3 files, 3 accepted" in result.stdout) == (0, True)


def test_an_empty_support_set_is_told(tmp_path: Path) -> None:
    assert invoke("batch", EXAMPLES / "squat", tmp_path / "out.csv").exit_code == 4


@pytest.mark.skipif(not find_spec("pyarrow"), reason="needs the extra `ray`")
def test_other_decisions_are_not_mixed(filled: SupportStore, tmp_path: Path) -> None:
    output = tmp_path / "out.parquet"
    with Results.opened(output, {"weights": "of old"}) as results:
        results.finish()
    result = invoke("batch", EXAMPLES / "squat", output)
    assert result.exit_code == 2
    for basis in ("INPUT", "version of actioncli", "weights", "support set", "tau", "options"):
        assert basis in result.stderr
    assert "delete it" in result.stderr


def test_the_columns_are_the_documented_ones() -> None:
    block = invoke("batch", "--help").stdout.partition("Columns:\n")[2]
    lines = block.partition("\n\n")[0].splitlines()
    named = [re.split(r"\s{2,}", line.strip())[0].split(", ") for line in lines]
    assert [name for names in named for name in names] == list(COLUMNS)


@pytest.fixture(scope="module")
def place(five: Path) -> Iterator[Path]:
    """A folder with a support set; its path is short, as paths of sockets have to be."""
    with tempfile.TemporaryDirectory(prefix="ac-", ignore_cleanup_errors=True) as folder:
        shutil.copytree(five, Path(folder, "home"))
        yield Path(folder)


@pytest.fixture(scope="module")
def archive(place: Path) -> Path:
    """150 clips, two of them damaged, and a video that is empty."""
    folder = place / "archive"
    folder.mkdir()
    clips = sorted(EXAMPLES.glob("*/*.npz"))
    for number in range(150):
        shutil.copy(clips[number % len(clips)], folder / f"{number:03d}.npz")
    for name in ("040.npz", "090.npz"):
        (folder / name).write_bytes(clips[0].read_bytes()[:500])
    (folder / "video.mp4").touch()
    return folder


@pytest.fixture(scope="module")
def start(place: Path) -> Iterator[Started]:
    """Start a program under an environment by which its processes are known."""
    environment = {**os.environ, "ACTIONCLI_HOME": str(place / "home")}
    environment |= {"RAY_USAGE_STATS_ENABLED": "0", "OMP_NUM_THREADS": "1"}
    # Without this a driver looks for the cluster at the address of another interface.
    environment["RAY_ENABLE_WINDOWS_OR_OSX_CLUSTER"] = "0"
    running: list[subprocess.Popen[str]] = []

    def call(*words: object) -> subprocess.Popen[str]:
        process = subprocess.Popen(
            [sys.executable, *map(str, words)],
            env=environment,
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
            process_group=0,
        )
        running.append(process)
        return process

    yield call
    # The end of its standard input ends the cluster.
    for process in running:
        process.communicate(timeout=PATIENCE)


def processes(place: Path, title: bytes = b"") -> list[int]:
    """Those of programs that `start` began."""
    found = []
    for entry in Path("/proc").glob("[0-9]*"):
        try:
            environment = (entry / "environ").read_bytes()
            named = (entry / "cmdline").read_bytes().startswith(title)
            if named and f"={place}/home\0".encode() in environment:
                found.append(int(entry.name))
        except OSError:
            continue
    return found


def heard(process: subprocess.Popen[str], word: str) -> str:
    """What a program writes to standard error until the word is in it."""
    assert process.stderr is not None
    lines = ""
    while word not in lines:
        line = process.stderr.readline()
        assert line, lines
        lines += line
    return lines


def rows(output: Path) -> dict[str, dict[str, Any]]:
    """By the name of the file."""
    if output.suffix == ".csv":
        with output.open(encoding="utf-8", newline="") as file:
            return {Path(row["source"]).name: row for row in csv.DictReader(file)}
    from pyarrow import parquet

    return {Path(row["source"]).name: row for row in parquet.read_table(output).to_pylist()}


def agree(output: Path, classified: list[dict[str, Any]]) -> None:
    """A table and the clips that `classify` told of have the same decisions."""
    found = rows(output)
    assert len(found) == len(classified) == 151
    for clip in classified:
        row = found[Path(clip["source"]).name]
        if "error" in clip:
            assert row["error"] == clip["error"]["message"]
            continue
        assert (row["label"] or None, row["nearest"]) == (clip["label"], clip["nearest"])
        assert float(row["confidence"]) == pytest.approx(clip["confidence"], abs=1e-5)
        assert float(row["distance"]) == pytest.approx(clip["ranking"][0]["distance"], rel=1e-4)


@pytest.fixture(scope="module")
def classified(start: Started, archive: Path) -> list[dict[str, Any]]:
    printed, _ = start("-m", "actioncli", "classify", archive, "--json").communicate()
    clips: list[dict[str, Any]] = json.loads(printed)["clips"]
    return clips


@pytest.mark.usefixtures("unmeasured")
def test_what_a_killed_and_an_interrupted_run_leave_ends_like_one_run(
    start: Started, archive: Path, place: Path, classified: list[dict[str, Any]]
) -> None:
    output = place / "own.csv"
    done = [-1]
    for end, last in ((signal.SIGKILL, "040.npz"), (signal.SIGINT, "090.npz"), (None, "video.mp4")):
        process = start("-m", "actioncli", "batch", archive, output)
        begun = heard(process, last)
        assert all(line.startswith(("151 files", "error: ")) for line in begun.splitlines())
        done.append(int(begun.removeprefix("151 files, ").partition(" ")[0]))
        if end is not None:
            # As the terminal does it: to all processes in the foreground.
            os.killpg(process.pid, end) if end == signal.SIGINT else process.kill()
        _, errors = process.communicate(timeout=PATIENCE)
        assert process.returncode == {signal.SIGKILL: -9, signal.SIGINT: 130, None: 3}[end], errors
        assert ("files are kept; the same command goes on" in errors) == (end == signal.SIGINT)
        deadline = time.monotonic() + 60
        while processes(place) and time.monotonic() < deadline:
            time.sleep(0.05)
        assert not processes(place)
    assert done[1] == 0 < done[2] < done[3]
    agree(output, classified)
    assert not list(place.glob("own.csv.*"))


# What starts Ray.


@pytest.fixture(scope="module")
def cluster(place: Path, start: Started) -> str:
    """The address of two nodes with one core each."""
    (place / "ray").mkdir()
    nodes = start(
        "-c",
        "import os, sys\n"
        "os.environ['RAY_TMPDIR'] = sys.argv[1]\n"
        "from ray.cluster_utils import Cluster\n"
        "node = dict(num_cpus=1, include_dashboard=False, node_ip_address='127.0.0.1')\n"
        "cluster = Cluster(True, head_node_args=node)\n"
        "cluster.add_node(**node)\n"
        "print(cluster.address, flush=True)\n"
        "sys.stdin.read()\n"
        "cluster.shutdown()\n",
        place,
    )
    assert nodes.stdout is not None
    address = nodes.stdout.readline().strip()
    assert address, nodes.communicate()[1]
    return address


@needs_ray
@pytest.mark.nightly
def test_two_nodes_decide_as_classify_though_a_worker_dies(
    start: Started, cluster: str, archive: Path, place: Path, classified: list[dict[str, Any]]
) -> None:
    output = place / "cluster.parquet"
    process = start("-m", "actioncli", "batch", archive, output, "--ray", cluster, "--json")
    # Blocks are done in this order: many rows are known, and many are not.
    heard(process, "040.npz")
    os.kill(processes(place, b"ray::MapWorker")[0], signal.SIGKILL)
    printed, errors = process.communicate(timeout=PATIENCE)
    assert process.returncode == 3, errors
    summary = json.loads(printed)
    assert (summary["files"], summary["failed"], summary["done_before"]) == (151, 3, 0)
    agree(output, classified)
    assert not list(place.glob("cluster.parquet.*"))


@needs_ray
@pytest.mark.nightly
def test_a_file_that_kills_its_workers_becomes_a_row(
    start: Started, cluster: str, place: Path
) -> None:
    folder, output = place / "deadly", place / "deadly.parquet"
    folder.mkdir()
    # So long that its worker can be found, which is then killed as lack of memory does it.
    motion = np.random.default_rng(0).normal(size=(80_000, 24, 3)).cumsum(axis=0) / 100
    np.save(folder / "long.npy", motion)
    np.save(folder / "short.npy", motion[:60])
    more = ("--layout", "smpl_24", "--unit", "m", "--up", "y", "--fps", "30")
    process = start("-m", "actioncli", "batch", folder, output, "--ray", cluster, *more)
    seen: dict[int, float] = {}
    while process.poll() is None:
        time.sleep(0.2)
        for pid in processes(place, b"ray::MapWorker(MapBatches(Stage)).submit"):
            if time.monotonic() - seen.setdefault(pid, time.monotonic()) > 4:
                os.kill(pid, signal.SIGKILL)
    _, errors = process.communicate()
    assert process.returncode == 3, errors
    found = rows(output)
    assert "died, 3 times in a row" in found["long.npy"]["error"]
    assert found["short.npy"]["error"] is None
