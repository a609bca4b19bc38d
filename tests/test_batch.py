"""Results that grow by parts, and what a worker makes of a file."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("pyarrow", reason="needs the extra `ray`")

from actioncli import Recognizer, read_clip
from actioncli.batch import Stage, Task
from actioncli.batch_results import SCHEMA, WORKER_DIED, Results, State, as_table
from actioncli.errors import ClipError, UsageError
from actioncli.threshold import Threshold

EXAMPLES = Path(__file__).parents[1] / "examples"
BASIS = {"weights": "w", "tau": "0.5"}
NOW = State(1, 2)


def row(source: str, state: State = NOW, **more: object) -> dict[str, object]:
    return {"source": source, "size": state.size, "mtime_ns": state.mtime_ns, **more}


def test_parts_are_kept_and_merged(tmp_path: Path) -> None:
    output = tmp_path / "out.parquet"
    first = Results.open(output, BASIS)
    first.add(as_table([row("b"), row("a", label="old")]))
    first.save()
    # The process ends here: another one goes on.
    second = Results.open(output, BASIS)
    states = {"a": State(1, 3), "b": NOW, "c": NOW}
    assert second.missing(states) == ["a", "c"]
    second.add(as_table([row("a", State(1, 3), label="new")]))
    second.save()
    second.finish()
    assert [path.name for path in tmp_path.iterdir()] == ["out.parquet"]
    assert output.stat().st_mode & 0o777 == 0o600
    third = Results.open(output, BASIS)
    assert third.missing(states) == ["c"]
    assert third.rows(["a", "b", "c"])["label"].to_pylist() == ["new", None]


def test_a_file_whose_workers_died_is_tried_again(tmp_path: Path) -> None:
    results = Results.open(tmp_path / "out.parquet", BASIS)
    results.add(as_table([row("a", error_type=WORKER_DIED), row("b", error_type="ClipError")]))
    results.finish()
    assert results.missing({"a": NOW, "b": NOW}) == ["a"]


def test_another_basis_is_refused_until_a_restart(tmp_path: Path) -> None:
    output = tmp_path / "out.parquet"
    Results.open(output, BASIS).finish()
    with pytest.raises(UsageError, match=r"made with other tau; .*--restart"):
        Results.open(output, {**BASIS, "tau": "0.7"})
    assert Results.open(output, {**BASIS, "tau": "0.7"}, restart=True).missing({"a": NOW}) == ["a"]
    assert not output.exists()


def test_foreign_files_are_not_overwritten(tmp_path: Path) -> None:
    output = tmp_path / "out.parquet"
    output.write_bytes(b"something else")
    with pytest.raises(ClipError, match="is no output of `actioncli batch`"):
        Results.open(output, BASIS)
    assert output.read_bytes() == b"something else"


def test_a_worker_decides_as_the_recogniser(tmp_path: Path) -> None:
    recognizer = Recognizer()
    names = {"squat": "squat/ada.npz", "bow": "bow/ben.npz"}
    support = {
        label: recognizer.embed([read_clip(EXAMPLES / name)]) for label, name in names.items()
    }
    task = Task(
        recognizer.weights, support, recognizer.embed([]), Threshold(0.5, "w", {"squat": 0.99999})
    )
    stage = Stage(task)
    path = EXAMPLES / "squat" / "ben.npz"
    path = path if path.exists() else sorted((EXAMPLES / "squat").glob("*.npz"))[-1]
    found = stage.row(str(path))
    decision = recognizer.classify(read_clip(path), support, 0.5)
    assert found["confidence"] == decision.confidence
    assert found["tau"] == (0.99999 if decision.nearest == "squat" else 0.5)
    assert (found["size"], found["mtime_ns"]) == (path.stat().st_size, path.stat().st_mtime_ns)
    (tmp_path / "bad.npy").write_bytes(b"\x93NUMPY damaged")
    bad = stage.row(str(tmp_path / "bad.npy"))
    assert bad["error_type"] == "ClipError"
    assert "bad.npy" in str(bad["error"])
    assert stage.row(str(tmp_path / "nothing.npy"))["size"] is None
    table = as_table([found, bad])
    assert table.schema == SCHEMA
    assert np.array_equal(table["error_type"].is_null().to_pylist(), [True, False])
