"""Results that are kept while a run lasts, and go on from wherever it ended."""

import sqlite3
import stat
import tracemalloc
from collections.abc import Mapping
from csv import DictReader
from pathlib import Path
from typing import Any

import pytest

from actioncli.archives import results as batch_results
from actioncli.archives.results import COLUMNS, Results, schema
from actioncli.errors import ClipError, UsageError

parquet = pytest.importorskip("pyarrow.parquet", reason="needs the extra `ray`")
BASIS = {"weights": "w", "tau": "0.5"}


@pytest.fixture
def files(tmp_path: Path) -> list[Path]:
    """Ten files to be decided about."""
    made = [tmp_path / f"{n}.npy" for n in range(10)]
    for path in made:
        path.write_bytes(b"before")
    return made


@pytest.fixture
def output(tmp_path: Path) -> Path:
    (tmp_path / "results").mkdir()
    return tmp_path / "results" / "out.parquet"


def row(path: Path | str, **more: object) -> dict[str, Any]:
    told = {"label": None, "accepted": False, "confidence": 0.1, "notes": ["a", "b"]}
    return {"source": str(path), **told, **more}


def run(
    output: Path, files: list[Path], most: int = 100, basis: Mapping[str, str] = BASIS
) -> list[str]:
    """A run that ends early after so many files; returns the names of those it did."""
    with Results.opened(output, basis) as results:
        results.set_files(iter(files))
        todo = results.missing(most)
        for source in todo:
            results.add(row(source))
        if not results.missing(1):
            results.finish()
    return [Path(source).name for source in todo]


def test_what_is_left_of_runs_that_end_early_is_what_one_run_gives(
    files: list[Path], output: Path
) -> None:
    once = output.with_name("once.parquet")
    assert len(run(once, files)) == 10
    assert [run(output, files[::-1], 4) for _ in range(4)] == [
        ["0.npy", "1.npy", "2.npy", "3.npy"],
        ["4.npy", "5.npy", "6.npy", "7.npy"],
        ["8.npy", "9.npy"],
        [],
    ]
    assert output.read_bytes() == once.read_bytes()
    assert sorted(path.name for path in output.parent.iterdir()) == ["once.parquet", "out.parquet"]
    table = parquet.read_table(output)
    assert table.schema.equals(schema())
    assert table["source"].to_pylist() == [str(path) for path in files]
    assert table["notes"].to_pylist() == [["a", "b"]] * 10


def test_while_a_run_lasts_others_can_neither_read_it_nor_write_it(
    files: list[Path], output: Path
) -> None:
    with Results.opened(output, BASIS) as results:
        results.set_files(files)
        results.add(row(files[0]))
        kept = output.with_name("out.parquet.partial")
        assert stat.S_IMODE(kept.stat().st_mode) == 0o600
        with pytest.raises(UsageError, match="another run"), Results.opened(output, BASIS):
            pass
        with sqlite3.connect(kept, timeout=0) as other, pytest.raises(sqlite3.OperationalError):
            other.execute("DELETE FROM files")
        other.close()
        assert len(results.missing(100)) == 9


def test_new_changed_and_failed_files_are_done_again_and_gone_ones_go(
    files: list[Path], output: Path, tmp_path: Path
) -> None:
    with Results.opened(output, BASIS) as results:
        results.set_files(files)
        for path in files:
            results.add(row(path, label="wave", accepted=True))
        results.add({"source": str(files[2]), "error_type": "ClipError", "error": "damaged"})
        assert results.count() == {
            "files": 10, "done": 10, "accepted": 9, "rejected": 0, "failed": 1
        }  # fmt: skip
        results.finish()
    files[5].write_bytes(b"changed")
    new = tmp_path / "new.npy"
    new.touch()
    assert run(output, [*files[1:], new]) == ["2.npy", "5.npy", "new.npy"]
    table = parquet.read_table(output)
    assert [Path(name).name for name in table["source"].to_pylist()] == [
        *(path.name for path in files[1:]), "new.npy"
    ]  # fmt: skip
    assert table["label"].to_pylist().count("wave") == 7
    assert table["error"].null_count == 10


@pytest.mark.parametrize("ended", [True, False])
def test_another_basis_is_refused(files: list[Path], output: Path, ended: bool) -> None:
    run(output, files, 100 if ended else 3)
    with pytest.raises(UsageError, match=r"another tau; .* name another OUTPUT, or delete it"):
        run(output, files, basis={**BASIS, "tau": "0.7"})
    assert len(run(output, files)) == (0 if ended else 7)


@pytest.mark.parametrize("name", ["out.parquet", "out.parquet.partial", "out.csv"])
def test_foreign_files_are_not_written_over(output: Path, files: list[Path], name: str) -> None:
    foreign = output.with_name(name)
    foreign.write_bytes(b"something else" * 100)
    with pytest.raises(ClipError, match=f"{name}: .*delete it"):
        run(output.with_name(name.removesuffix(".partial")), files)
    assert foreign.read_bytes() == b"something else" * 100
    assert [path.name for path in output.parent.iterdir()] == [name]


def test_files_that_are_not_there_or_have_odd_names_are_listed(
    output: Path, tmp_path: Path
) -> None:
    odd = [tmp_path / "gone.npy", tmp_path / "\udcff.npy", tmp_path / "a\nb'\".npy"]
    assert run(output, odd) == ["\\udcff.npy", "a\nb'\".npy", "gone.npy"]
    assert parquet.read_table(output)["size"].to_pylist() == [None] * 3


def test_a_csv_is_one_and_its_next_run_begins_anew(files: list[Path], output: Path) -> None:
    table = output.with_name("out.CSV")
    assert [len(run(table, files, most)) for most in (4, 100, 100)] == [4, 6, 10]
    with table.open(encoding="utf-8", newline="") as file:
        rows = list(DictReader(file))
    assert list(rows[0]) == list(COLUMNS)
    assert [row["source"] for row in rows] == list(map(str, files))
    assert (rows[0]["accepted"], rows[0]["confidence"]) == ("False", "0.1")
    assert (rows[0]["label"], rows[0]["notes"]) == ("", "a; b")


def test_neither_the_list_nor_the_rows_are_held_in_memory(
    output: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(batch_results, "_CHUNK", 50)
    names = (Path(f"/nowhere/{n:06d}.npy") for n in range(1_500))
    tracemalloc.start()
    try:
        with Results.opened(output, BASIS) as results:
            results.set_files(names)
            while window := results.missing(50):
                for source in window:
                    results.add(row(source, notes=["x" * 400]))
            results.finish()
        _, most = tracemalloc.get_traced_memory()
    finally:
        tracemalloc.stop()
    assert parquet.read_metadata(output).num_rows == 1_500
    # The notes alone are 600 kB.
    assert most < 300_000
