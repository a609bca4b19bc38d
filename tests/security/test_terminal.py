"""Nothing that comes from a file, or is a file's name, steers a terminal."""

import json
import shutil
import unicodedata
from pathlib import Path

import numpy as np
import pytest

from actioncli import SupportStore, read_clip
from actioncli.clips.skeleton import DEFAULT_JOINTS

from .conftest import EXAMPLES, invoke

# Titles, clearing, colours, links, the bell, direction, invisible letters, line breaks.
EVIL = "\x1b]0;pwned\x07\x1b[2J\x1b[31m\x9b31m\u202egpj\u200b\u2028\r"
CLIP = EXAMPLES / "wave_right" / "ada.npz"


def harmless(text: str) -> bool:
    return all(c == "\n" or unicodedata.category(c)[0] not in "CZ" or c == " " for c in text)


@pytest.fixture
def evil(tmp_path: Path) -> Path:
    """A folder of that name, with clips of that name."""
    folder = tmp_path / f"folder{EVIL}"
    folder.mkdir()
    shutil.copy(CLIP, folder / f"good{EVIL}.npz")
    (folder / f"bad{EVIL}.npy").write_bytes(b"nothing")
    (folder / "undecodable\udcff.npy").write_bytes(b"nothing")
    (folder / f"bad{EVIL}.json").write_text(json.dumps({EVIL: 1}))
    np.savez(folder / f"joints{EVIL}.npz", **{EVIL: np.zeros(3), "b": np.zeros(3)})
    body = read_clip(CLIP).joints[:, :15]
    np.savez(
        folder / f"names{EVIL}.npz",
        joints=body,
        joint_names=[f"{name}{EVIL}" for name in DEFAULT_JOINTS],
        unit=EVIL,
        up=EVIL,
        layout=EVIL,
    )
    (folder / f"table{EVIL}.csv").write_text(f"{EVIL}_x,{EVIL}_y\n1,2\n", encoding="utf-8")
    return folder


@pytest.mark.parametrize("form", [[], ["--json"], ["--quiet"], ["--debug"]])
def test_names_of_files_and_fields(filled: SupportStore, evil: Path, form: list[str]) -> None:
    commands = [
        ["classify", evil],
        ["enroll", "twist", evil],
        ["list-support"],
        ["show", "twist"],
        ["classify", evil / "none.npz"],
        ["enroll", f"label{EVIL}", CLIP],
        ["rename", f"label{EVIL}", "other"],
        ["remove", EVIL],
        ["show", EVIL],
        ["export", evil / f"x{EVIL}.safetensors"],
        ["import", evil / f"x{EVIL}.safetensors"],
        ["import", evil / f"good{EVIL}.npz"],
        ["evaluate", evil],
        ["classify", CLIP, "--weights", evil / f"bad{EVIL}.npy"],
        ["--store", evil / f"good{EVIL}.npz", "list-support"],
        ["doctor"],
    ]
    for command in commands:
        # Options of all commands stand at either end; the subcommand's own take them here.
        result = invoke(*command, *form)
        assert harmless(result.stdout), command
        assert harmless(result.stderr), command
        if command in (["classify", evil], ["enroll", "twist", evil]):
            assert r"\x1b" in result.stderr
            assert r"\udcff" in result.stderr
    assert filled.examples("twist")
    assert all(example.source.isprintable() for example in filled.examples("twist"))
