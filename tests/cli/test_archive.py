"""export and import."""

import json
from pathlib import Path

import pytest

from actioncli import Recognizer, SupportStore
from actioncli.errors import WeightsError

from .conftest import Ask, Invoke, MakeClip


def test_a_support_set_travels(
    invoke: Invoke, ask: Ask, store: SupportStore, clip: MakeClip, tmp_path: Path
) -> None:
    store.enroll_all([("wave", clip(0)), ("squat", clip(1))])
    file = tmp_path / "actions.safetensors"
    assert invoke("export", file).stdout == f"{file}: 2 examples written\n"
    other = ["--store", tmp_path / "other.db"]
    assert invoke("import", file, *other).stdout == f"{file}: 2 examples added, 0 already there\n"
    again = ask("import", file, *other)
    assert again == {"file": str(file), "added": 0, "skipped": 2, "threshold_taken": False}
    assert invoke("list-support", *other).stdout == invoke("list-support").stdout
    assert ask("export", file) == {"file": str(file), "examples": 2}


def test_an_import_embeds_what_it_added_where_the_weights_allow_it(
    invoke: Invoke, filled: SupportStore, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
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


def test_export_to_an_impossible_place_is_code_5(
    invoke: Invoke, store: SupportStore, clip: MakeClip, tmp_path: Path
) -> None:
    store.enroll("wave", clip(0))
    for target in (tmp_path, tmp_path / "no" / "folder" / "out", "/dev/null/out"):
        assert invoke("export", target).exit_code == 5


def test_import_of_damaged_files_is_code_5_and_adds_nothing(
    invoke: Invoke, store: SupportStore, clip: MakeClip, tmp_path: Path
) -> None:
    store.enroll_all([("wave", clip(0)), ("squat", clip(1))])
    file = tmp_path / "actions.safetensors"
    store.export(file)
    whole = file.read_bytes()
    store.clear()
    for damaged in (b"", whole[:-1], whole[:60], whole[:-9] + b"x" * 9, b"\x80\x04N."):
        file.write_bytes(damaged)
        result = invoke("import", file, "--json")
        assert result.exit_code == 5
        assert json.loads(result.stdout)["error"]["exit_code"] == 5
        assert store.examples() == []
    assert invoke("import", tmp_path / "none").exit_code == 5
