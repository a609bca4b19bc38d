"""What a worker makes of a file, of this machine or of a cluster."""

import os
import signal
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from actioncli import Recognizer, SupportSet, read_clip
from actioncli.archives import batch
from actioncli.archives.batch import Task, decide
from actioncli.archives.processes import cores
from actioncli.archives.results import Results
from actioncli.errors import UsageError
from actioncli.recognition.threshold import Threshold

EXAMPLES = Path(__file__).parents[2] / "examples"
SQUAT = EXAMPLES / "squat/ada.npz"


@pytest.fixture(scope="module")
def task() -> Task:
    """To tell two actions from each other, one of them with a threshold that little reaches."""
    recognizer = Recognizer()
    clips = {"squat": [read_clip(SQUAT)], "bow": [read_clip(EXAMPLES / "bow/ben.npz")]}
    threshold = Threshold(0.5, recognizer.weights.checksum, {"squat": 0.95})
    return Task(replace(SupportSet.from_clips(clips, recognizer), threshold=threshold))


def test_a_worker_decides_as_the_recogniser(task: Task) -> None:
    for path in sorted(EXAMPLES.glob("*/*.npz")):
        found = task.row(str(path))
        decision = task.support.with_tau(0.5).classify(read_clip(path))
        assert (found["confidence"], found["nearest"]) == (decision.confidence, decision.nearest)
        assert found["tau"] == (0.95 if decision.nearest == "squat" else 0.5)
        assert found["accepted"] == (decision.confidence > found["tau"])
        assert found["label"] == (decision.nearest if found["accepted"] else None)


def test_a_worker_of_a_cluster_gives_tables_and_refuses_another_version(
    task: Task, tmp_path: Path
) -> None:
    pa = pytest.importorskip("pyarrow", reason="needs the extra `ray`")
    from actioncli.archives.cluster import Stage
    from actioncli.archives.results import schema

    (tmp_path / "bad.npy").write_bytes(b"\x93NUMPY damaged")
    sources = [tmp_path / "bad.npy", SQUAT, tmp_path / "none.npy"]
    tables = list(Stage(task)(pa.table({"source": list(map(str, sources))})))
    assert all(table.schema == schema() and len(table) == 1 for table in tables)
    bad, good, none = (table.to_pylist()[0] for table in tables)
    assert (bad["error_type"], none["error_type"]) == ("ClipError", "ClipError")
    assert "bad.npy" in bad["error"]
    assert bad["accepted"] is None
    assert (good["error"], good["nearest"]) == (None, "squat")
    with pytest.raises(UsageError, match="a machine of the cluster has actioncli"):
        Stage(replace(task, version="0.0.1"))


def test_whatever_a_file_does_is_a_row(task: Task, monkeypatch: pytest.MonkeyPatch) -> None:
    """Half a character, which no table holds as it is, must not cost the other rows."""

    def broken(*_: object) -> None:
        raise TypeError("\ud800")

    monkeypatch.setattr(batch, "read_any", broken)
    row = task.row(str(SQUAT))
    assert row["error_type"] == "TypeError"
    assert "\\ud800 (this is a bug)" in row["error"]


@pytest.mark.skipif(cores() == 1, reason="processes cannot be forked here")
def test_a_file_that_kills_its_process_is_a_row(
    task: Task, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    files = [tmp_path / f"{n}.npz" for n in range(6)]
    read = read_clip(SQUAT)

    def deadly(path: Path, *_: Any) -> object:
        if Path(path).stem in "14":
            os.kill(os.getpid(), signal.SIGKILL)
        return read

    monkeypatch.setattr(batch, "read_any", deadly)
    with Results.opened(tmp_path / "out.csv", {}) as results:
        results.set_files(files)
        for row in decide(task, results):
            results.add(row)
            assert ("was killed" in row.get("error", "")) == (Path(row["source"]).stem in "14")
        assert results.count() == {"files": 6, "done": 6, "accepted": 4, "rejected": 0, "failed": 2}
