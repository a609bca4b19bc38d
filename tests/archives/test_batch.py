"""What a worker makes of a file."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest

pytest.importorskip("pyarrow", reason="needs the extra `ray`")

import pyarrow as pa

from actioncli import Recognizer, SupportSet, read_clip
from actioncli.archives.batch import Stage, Task
from actioncli.archives.results import SCHEMA
from actioncli.errors import UsageError
from actioncli.recognition.threshold import Threshold

EXAMPLES = Path(__file__).parents[2] / "examples"


@pytest.fixture(scope="module")
def task() -> Task:
    """To tell two actions from each other, one of them with a threshold that little reaches."""
    recognizer = Recognizer()
    names = {"squat": "squat/ada.npz", "bow": "bow/ben.npz"}
    clips = {label: [read_clip(EXAMPLES / name)] for label, name in names.items()}
    threshold = Threshold(0.5, recognizer.weights.checksum, {"squat": 0.99999})
    return Task(replace(SupportSet.from_clips(clips, recognizer), threshold=threshold))


def test_a_worker_decides_as_the_recogniser(task: Task) -> None:
    stage = Stage(task)
    for path in sorted(EXAMPLES.glob("*/*.npz")):
        found = stage.row(str(path))
        decision = task.support.with_tau(0.5).classify(read_clip(path))
        assert found["confidence"] == decision.confidence
        assert found["nearest"] == decision.nearest
        assert found["tau"] == (0.99999 if decision.nearest == "squat" else 0.5)
        assert found["accepted"] == (decision.confidence > found["tau"])
        assert found["label"] == (decision.nearest if found["accepted"] else None)


def test_a_bad_file_is_a_row_among_the_others(task: Task, tmp_path: Path) -> None:
    (tmp_path / "bad.npy").write_bytes(b"\x93NUMPY damaged")
    sources = [tmp_path / "bad.npy", EXAMPLES / "squat/ada.npz", tmp_path / "none.npy"]
    batch = pa.table({"source": list(map(str, sources))})
    tables = list(Stage(task)(batch))
    assert all(table.schema == SCHEMA and len(table) == 1 for table in tables)
    bad, good, none = (table.to_pylist()[0] for table in tables)
    assert (bad["error_type"], none["error_type"]) == ("ClipError", "ClipError")
    assert "bad.npy" in bad["error"]
    assert bad["accepted"] is None
    assert good["error"] is None
    assert good["nearest"] == "squat"


def test_whatever_a_file_does_is_a_row(task: Task, monkeypatch: pytest.MonkeyPatch) -> None:
    """Half a character, which no table holds as it is, must not cost the other rows."""

    def broken(*_: object) -> None:
        raise TypeError("\ud800")

    monkeypatch.setattr("actioncli.archives.batch.read_any", broken)
    batch = pa.table({"source": [str(EXAMPLES / "squat/ada.npz")]})
    [table] = Stage(task)(batch)
    [row] = table.to_pylist()
    assert row["error_type"] == "TypeError"
    assert "\\ud800 (this is a bug)" in row["error"]


def test_a_worker_of_another_version_refuses(task: Task) -> None:
    with pytest.raises(UsageError, match="a machine of the cluster has actioncli"):
        Stage(replace(task, version="0.0.1"))
