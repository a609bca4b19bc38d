"""One studio for all tests here, with an empty support set for each."""

from collections.abc import Iterator
from pathlib import Path

import pytest
from playwright.sync_api import Browser, Page

import actioncli
from actioncli.recognition.threshold import keep_threshold
from actioncli.studio.app import Studio
from actioncli.studio.upload_folder import UploadFolder
from tests.browsing import opened

from .serving import Client, serving


@pytest.fixture(scope="package", autouse=True)
def home(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Path]:
    """The folder of the support set, the cache and the uploads."""
    folder = tmp_path_factory.mktemp("home")
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("ACTIONCLI_HOME", str(folder))
        yield folder


@pytest.fixture(scope="package")
def served(home: Path) -> Iterator[tuple[Studio, str]]:
    """The studio, and its address."""
    uploads = UploadFolder()
    studio = Studio(actioncli.open(), uploads)
    with serving(studio.app()) as address:
        yield studio, address
    studio.close()
    uploads.close()
    assert [file.name for file in (home / "uploads").iterdir()] == [".actioncli-uploads"]


@pytest.fixture
def studio(served: tuple[Studio, str]) -> Studio:
    """The same, with nothing enrolled."""
    studio, _ = served
    studio.actions.store.clear()
    keep_threshold(studio.actions.store, None)
    return studio


@pytest.fixture
def client(studio: Studio, served: tuple[Studio, str]) -> Client:
    """Somebody with the studio's address."""
    return Client(served[1])


@pytest.fixture
def tab(browser: Browser, client: Client) -> Iterator[Page]:
    """The studio in a tab of its own; see `opened`."""
    with opened(browser, client.address) as page:
        yield page
