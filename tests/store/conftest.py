"""Fixtures of the store's tests."""

import shutil
import tempfile
from collections.abc import Iterator
from pathlib import Path

import pytest
from storing import give_away


@pytest.fixture
def shared_folder() -> Iterator[Path]:
    """An empty folder that an ordinary user can reach and owns."""
    folder = Path(tempfile.mkdtemp())
    give_away(folder)
    yield folder
    folder.chmod(0o700)
    shutil.rmtree(folder)
