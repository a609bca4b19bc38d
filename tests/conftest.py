"""What all tests share."""

import signal
from collections.abc import Iterator
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import pytest
from cases import TIMES, cases
from hypothesis import Phase, settings

from actioncli import Recognizer, SupportStore

# Training needs the extra `train`; all else is tested without it too.
collect_ignore = [] if find_spec("torch") else ["training"]

# Who starts the tests in the background of a script, or under nohup, has them ignore these signals,
# and all that they start would.
signal.signal(signal.SIGINT, signal.default_int_handler)
signal.signal(signal.SIGHUP, signal.SIG_DFL)

# How long an example takes says how busy the machine is; time is measured by the benchmarks.
# Two runs of one revision try the same examples; more and other ones belong to `make nightly`.
settings.register_profile(
    "untimed", deadline=None, max_examples=cases(), derandomize=TIMES == 1, database=None
)
# Mutants die or survive alike in every run, and what kills one need not be made simpler.
settings.register_profile(
    "mutants", deadline=None, derandomize=True, phases=[Phase.explicit, Phase.generate]
)
settings.load_profile("untimed")


@pytest.fixture(scope="session")
def shared() -> Path:
    """The folder of recorded collections beside the repository; tests of it skip without."""
    folder = Path(__file__).resolve().parents[1].parent / "shared"
    if not (folder / "data").is_dir():
        pytest.skip(f"needs the recorded collections in {folder}")
    return folder


@pytest.fixture(scope="session")
def recognizer() -> Recognizer:
    """With the shipped weights."""
    return Recognizer()


@pytest.fixture
def store(tmp_path: Path) -> SupportStore:
    """A store that does not exist yet, in a folder that does not either."""
    return SupportStore(tmp_path / "home" / "support.db")


@pytest.fixture(scope="session")
def browser(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Any]:
    """One browser for all tests of this process that open a page; they skip without."""
    from tests.browsing import launched

    with launched(tmp_path_factory.mktemp("film")) as found:
        yield found


@pytest.fixture
def unmeasured(monkeypatch: pytest.MonkeyPatch) -> None:
    """Programs that are started here import nothing to measure their coverage with.

    Where they are interrupted it must be so: Ctrl-C can come while the tracer holds its lock, and
    then it waits for itself for ever.
    """
    for name in ("COVERAGE_PROCESS_START", "COVERAGE_PROCESS_CONFIG"):
        monkeypatch.delenv(name, raising=False)
