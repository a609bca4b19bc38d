"""Fixtures of the pose tests."""

from pathlib import Path

import pytest


@pytest.fixture(autouse=True)
def own_cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("ACTIONCLI_HOME", str(tmp_path / "home"))


@pytest.fixture(scope="session")
def real_videos(shared: Path) -> Path:
    """Recordings of people, which are not part of the project: folders by action."""
    return shared / "video"
