"""export and import."""

from pathlib import Path

import pytest

from actioncli import Recognizer, SupportStore
from actioncli.errors import WeightsError

from .conftest import ask, invoke, shaking


def test_a_support_set_travels(store: SupportStore, tmp_path: Path) -> None:
    store.enroll_all([("wave", shaking(0)), ("squat", shaking(1))])
    file = tmp_path / "actions.safetensors"
    assert invoke("export", file).stdout == f"{file}: 2 examples written\n"
    other = ["--store", tmp_path / "other.db"]
    assert invoke("import", file, *other).stdout == f"{file}: 2 examples added, 0 already there\n"
    again = ask("import", file, *other)
    assert again == {"file": str(file), "added": 0, "skipped": 2, "threshold_taken": False}
    assert invoke("list-support", *other).stdout == invoke("list-support").stdout
    assert ask("export", file) == {"file": str(file), "examples": 2}


def test_an_import_embeds_what_it_added_where_the_weights_allow_it(
    filled: SupportStore, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    file = tmp_path / "actions.safetensors"
    filled.export(file)
    stores = [SupportStore(tmp_path / name) for name in ("one.db", "two.db")]
    assert invoke("import", file, "--store", stores[0].path).exit_code == 0
    checksum = Recognizer().weights.checksum
    found = stores[0].snapshot(checksum)
    assert (len(found.embeddings), dict(found.clips)) == (5, {})

    def refuse(self: Recognizer) -> None:
        raise WeightsError("no weights")

    monkeypatch.setattr(Recognizer, "__init__", refuse)
    assert invoke("import", file, "--store", stores[1].path).exit_code == 0
    assert len(stores[1].snapshot(checksum).clips) == 5
