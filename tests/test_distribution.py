"""What is uploaded, installed where nothing else is, does the main job."""

import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parent.parent


def run(*command: str | Path, cwd: Path) -> None:
    done = subprocess.run([str(part) for part in command], cwd=cwd, capture_output=True, text=True)
    assert done.returncode == 0, done.stdout[-3000:] + done.stderr[-3000:]


@pytest.fixture(scope="module")
def archives(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    """The source archive of a clean clone, and the wheel that is built from it."""
    source, built = tmp_path_factory.mktemp("source"), tmp_path_factory.mktemp("built")
    run("git", "clone", "--quiet", "--no-local", ROOT, source, cwd=built)
    run(sys.executable, "-m", "build", "--outdir", built, source, cwd=built)
    return {"sdist": next(built.glob("*.tar.gz")), "wheel": next(built.glob("*.whl"))}


@pytest.mark.nightly
@pytest.mark.parametrize("kind", ["sdist", "wheel"])
def test_an_empty_environment_does_the_main_job(
    archives: dict[str, Path], kind: str, tmp_path: Path
) -> None:
    run(sys.executable, "-m", "venv", "empty", cwd=tmp_path)
    pip = [tmp_path / "empty" / "bin" / "python", "-m", "pip", "install", "--quiet"]
    run(*pip, archives[kind], cwd=tmp_path)
    run(tmp_path / "empty" / "bin" / "actioncli", "tour", cwd=tmp_path)
    run(tmp_path / "empty" / "bin" / "actioncli", "doctor", "--json", cwd=tmp_path)
