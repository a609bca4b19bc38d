"""`batch`: the decisions of `classify`, whatever happens, on its own Ray and on two nodes.

Starting Ray takes ten seconds of processor time and more, and it gives its processes fifteen
seconds to answer, which a machine that is busy with other tests does not keep. So what starts Ray
runs with `make nightly`; what a worker does and what is kept is tested in `tests/test_batch*.py`.
"""

from __future__ import annotations

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

from actioncli import SupportStore, read_clip

from .conftest import ACTIONS, EXAMPLES, Invoke

needs_ray = pytest.mark.skipif(not find_spec("ray"), reason="needs the extra `ray`")
PATIENCE = 600
Started = Callable[..., subprocess.Popen[str]]


def test_without_the_extra_it_is_named(invoke: Invoke, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("actioncli.cli.batch.find_spec", lambda name: None)
    result = invoke("batch", EXAMPLES, "out.parquet")
    assert result.exit_code == 2
    assert "pip install 'actioncli[ray]'" in result.stderr


@needs_ray
@pytest.mark.usefixtures("filled")
@pytest.mark.parametrize(
    ("name", "told"), [("nothing", "no such file"), ("empty", "no clips or videos"), ("*", "no ")]
)
def test_inputs_without_files_are_told(
    name: str, told: str, tmp_path: Path, invoke: Invoke
) -> None:
    folder = tmp_path / "archive"
    (folder / "empty").mkdir(parents=True)
    result = invoke("batch", folder / name, tmp_path / "out.parquet")
    assert result.exit_code == 3
    assert told in result.stderr
    assert not (tmp_path / "out.parquet").exists()


@needs_ray
def test_an_empty_support_set_is_told(tmp_path: Path, invoke: Invoke) -> None:
    result = invoke("batch", EXAMPLES / "squat", tmp_path / "out.parquet")
    assert result.exit_code == 4


@needs_ray
def test_other_decisions_are_not_mixed(
    filled: SupportStore, tmp_path: Path, invoke: Invoke
) -> None:
    from actioncli.archives.results import Results

    output = tmp_path / "out.parquet"
    with Results.opened(output, {"weights": "of old"}) as results:
        results.finish()
    result = invoke("batch", EXAMPLES / "squat", output)
    assert result.exit_code == 2
    for basis in ("INPUT", "version of actioncli", "weights", "support set", "tau", "options"):
        assert basis in result.stderr
    assert "delete it" in result.stderr


@needs_ray
def test_the_columns_are_the_documented_ones(invoke: Invoke) -> None:
    from actioncli.archives.results import SCHEMA

    block = invoke("batch", "--help").stdout.partition("Parquet columns:\n")[2]
    lines = block.partition("\n\n")[0].splitlines()
    named = [re.split(r"\s{2,}", line.strip())[0].split(", ") for line in lines]
    assert [name for names in named for name in names] == SCHEMA.names


@needs_ray
@pytest.mark.usefixtures("filled")
@pytest.mark.parametrize("address", ["127.0.0.1:1", "nowhere", "no.such.host.invalid:6379"])
def test_where_no_cluster_is_it_is_told_at_once(
    address: str, tmp_path: Path, invoke: Invoke
) -> None:
    output = tmp_path / "out.parquet"
    result = invoke("batch", EXAMPLES / "squat", output, "--ray", address)
    assert result.exit_code == 2
    assert f"there is no Ray cluster at '{address}'" in result.stderr


# What starts Ray.


@pytest.fixture(scope="module")
def place() -> Iterator[Path]:
    """A folder with a support set; its path is short, as paths of sockets have to be."""
    with tempfile.TemporaryDirectory(prefix="ac-", ignore_cleanup_errors=True) as folder:
        home = Path(folder, "home")
        home.mkdir()
        clips = [(label, read_clip(EXAMPLES / f"{name}.npz")) for label, name in ACTIONS.items()]
        SupportStore(home / "support.db").enroll_all(clips)
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


def listening(pids: list[int]) -> set[str]:
    """Addresses at which processes listen, as the kernel writes them."""
    sockets = set()
    for pid in pids:
        for handle in Path(f"/proc/{pid}/fd").glob("*"):
            try:
                sockets.add(str(handle.readlink()))
            except OSError:
                continue
    lines = [
        line.split()
        for name in ("tcp", "tcp6")
        for line in Path("/proc/net", name).read_text().splitlines()[1:]
    ]
    return {
        line[1].partition(":")[0]
        for line in lines
        if line[3] == "0A" and f"socket:[{line[9]}]" in sockets
    }


def rows(output: Path) -> dict[str, dict[str, Any]]:
    from pyarrow import parquet

    return {Path(row["source"]).name: row for row in parquet.read_table(output).to_pylist()}


def told(process: subprocess.Popen[str], word: str) -> str:
    """What a program writes to standard error until the word is in it."""
    assert process.stderr is not None
    lines = ""
    while word not in lines:
        line = process.stderr.readline()
        assert line, lines
        lines += line
    return lines


@pytest.fixture(scope="module")
def one_run(start: Started, cluster: str, place: Path, archive: Path) -> Path:
    """The output of a run on two nodes, one of whose workers was killed."""
    output = place / "cluster.parquet"
    command = ("-m", "actioncli", "batch", archive, output, "--ray", cluster, "--json")
    process = start(*command)
    # Blocks are done in this order: many rows are known, and many are not.
    told(process, "040.npz")
    workers = processes(place, b"ray::MapWorker")
    os.kill(workers[0], signal.SIGKILL)
    printed, errors = process.communicate(timeout=PATIENCE)
    assert process.returncode == 3, errors
    summary = json.loads(printed)
    assert (summary["files"], summary["failed"], summary["done_before"]) == (151, 3, 0)
    return output


@needs_ray
@pytest.mark.nightly
def test_two_nodes_decide_as_classify_though_a_worker_dies(
    one_run: Path, start: Started, archive: Path, place: Path
) -> None:
    one_by_one = start("-m", "actioncli", "classify", archive, "--json")
    printed, _ = one_by_one.communicate(timeout=PATIENCE)
    classified = json.loads(printed)["clips"]
    ours = rows(one_run)
    assert len(ours) == len(classified) == 151
    for clip in classified:
        row = ours[Path(clip["source"]).name]
        if "error" in clip:
            assert row["error"] == clip["error"]["message"]
            continue
        assert (row["label"], row["nearest"]) == (clip["label"], clip["nearest"])
        assert row["confidence"] == pytest.approx(clip["confidence"], abs=1e-5)
        assert row["distance"] == pytest.approx(clip["ranking"][0]["distance"], rel=1e-4)
    assert not list(place.glob("cluster.parquet.*"))


@needs_ray
@pytest.mark.nightly
@pytest.mark.skipif(sys.platform != "linux", reason="looks into /proc")
def test_what_a_killed_and_an_interrupted_run_leave_ends_like_one_run(
    one_run: Path, start: Started, archive: Path, place: Path
) -> None:
    output = place / "own.parquet"
    others = processes(place)
    temporary = set(Path("/tmp").glob("actioncli-*"))
    command = ("-m", "actioncli", "batch", archive, output)
    done = [-1]
    for end, last in ((signal.SIGKILL, "040.npz"), (signal.SIGINT, "090.npz"), (None, "video.mp4")):
        process = start(*command)
        begun = told(process, last)
        # Nothing else is said, also not by Ray.
        assert all(line.startswith(("151 files", "error: ")) for line in begun.splitlines())
        done.append(int(begun.removeprefix("151 files, ").partition(" ")[0]))
        if end is not None:
            ours = [pid for pid in processes(place) if pid not in others]
            assert len(ours) > 5
            assert listening(ours) <= {
                "0100007F", "0000000000000000FFFF00000100007F", "00000000000000000000000001000000"
            }  # fmt: skip
            [folder] = set(Path("/tmp").glob("actioncli-*")) - temporary
            assert folder.stat().st_mode & 0o777 == 0o700
            if end == signal.SIGKILL:
                process.kill()
            else:
                # As the terminal does it: to all processes in the foreground.
                os.killpg(process.pid, end)
        _, errors = process.communicate(timeout=PATIENCE)
        assert process.returncode == {signal.SIGKILL: -9, signal.SIGINT: 130, None: 3}[end], errors
        deadline = time.monotonic() + 120
        while len(processes(place)) > len(others) and time.monotonic() < deadline:
            time.sleep(0.2)
        assert set(processes(place)) <= set(others)
        assert set(Path("/tmp").glob("actioncli-*")) <= temporary
        assert ("files are kept; the same command goes on" in errors) == (end == signal.SIGINT)
    assert 0 == done[1] < done[2] < done[3]
    assert output.read_bytes() == one_run.read_bytes()


@needs_ray
@pytest.mark.nightly
@pytest.mark.skipif(sys.platform != "linux", reason="looks into /proc")
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
