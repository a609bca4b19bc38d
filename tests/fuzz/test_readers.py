"""Fuzzing: four seconds for each reader with the tests, `FUZZ_SECONDS` with `make fuzz`."""

import os
import subprocess
import sys
from importlib.util import find_spec
from pathlib import Path

import pytest

from actioncli.errors import ActionCliError

from .readers import CORPUS, READERS

SECONDS = int(os.environ.get("FUZZ_SECONDS", "4"))
# What longer runs find is kept between them.
KEPT = Path(__file__).parents[2] / ".fuzz"


@pytest.mark.parametrize("name", READERS)
def test_the_corpus_is_read_or_refused(name: str, tmp_path: Path) -> None:
    if name == "c3d":
        pytest.importorskip("ezc3d", reason="needs the extra c3d")
    reader = READERS[name]
    files = sorted((CORPUS / name).iterdir())
    assert files
    read = 0
    for number, file in enumerate(files):
        copy = tmp_path / f"{number}{reader.suffix}"
        copy.write_bytes(reader.whole(file.read_bytes()))
        try:
            reader.read(copy)
            read += 1
        except ActionCliError as error:
            if str(copy) not in str(error):
                pytest.fail(f"{file.name}: an error that does not name the file: {error}")
    # A corpus of which nothing can be read would test little.
    assert read


@pytest.mark.parametrize("name", [name for name in READERS if READERS[name].pack])
def test_a_packed_file_is_read_as_the_one_that_it_was_made_of(name: str, tmp_path: Path) -> None:
    reader = READERS[name]
    assert reader.unpack is not None
    assert reader.pack is not None
    file = tmp_path / f"a{reader.suffix}"
    file.write_bytes(
        reader.whole(reader.pack(reader.unpack((CORPUS / name / "seed").read_bytes())))
    )
    reader.read(file)


@pytest.mark.parametrize("name", READERS)
@pytest.mark.skipif(
    find_spec("atheris") is None, reason="atheris is not installed: it has no wheel for this system"
)
def test_fuzzing_finds_nothing(name: str, tmp_path: Path) -> None:
    folder = KEPT if "FUZZ_SECONDS" in os.environ else tmp_path
    found = folder / name
    found.mkdir(parents=True, exist_ok=True)
    harness = str(Path(__file__).parent / "harness.py")
    options = [f"-max_total_time={SECONDS}", f"-artifact_prefix={folder}/{name}-"]
    # With the tests always the same inputs, on every machine: a failure comes from a change.
    options += [] if "FUZZ_SECONDS" in os.environ else ["-seed=1", "-runs=1000"]
    run = subprocess.run(
        [sys.executable, harness, name, str(found), *options],
        capture_output=True,
        text=True,
        errors="replace",
        timeout=SECONDS + 120,
        check=False,
    )
    said = run.stdout + run.stderr
    assert run.returncode == 0, said[-4000:]
    executed = said.partition("stat::number_of_executed_units:")[2].split()
    assert executed, said[-2000:]
    # A .c3d is read in a process of its own, and a damaged one may take all of its time.
    assert int(executed[0]) > (1 if name == "c3d" else 100), said[-2000:]
    print(f"{name}: {executed[0]} executions in {SECONDS} s")
