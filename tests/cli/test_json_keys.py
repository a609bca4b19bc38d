"""The keys of every JSON document are those that the command's help names, no more and no less."""

import json
import re
from pathlib import Path

import numpy as np
import pytest
from pose.videos import numbered, write_video

from actioncli import Clip, SupportStore, read_clip
from actioncli.clips.write import write_clip

from .conftest import EXAMPLES, invoke

SQUAT = str(EXAMPLES / "squat/ada.npz")
# For each command, calls that together show every key.
CALLS: dict[str, list[list[str]]] = {
    "enroll": [["squat", SQUAT, "none.npy"]],
    "classify": [[SQUAT, "none.npy", "FILE"]],
    "list-support": [[]],
    "show": [["squat"]],
    "rename": [["squat", "sit"]],
    "export": [["FILE"]],
    "import": [["FILE"]],
    "remove": [["bow", "--yes"]],
    "clear": [["--yes"]],
    "cameras": [["FILE", "none.mp4"]],
    "doctor": [[], ["--repair"]],
}


def documented(help_text: str) -> dict[str, set[str]]:
    """From the path of an object to its keys, as the help has them."""
    block = help_text.partition("JSON keys:\n")[2].partition("\n\n")[0]
    keys: dict[str, set[str]] = {}
    for line in block.splitlines():
        path, colon, names = line.strip().rpartition(": ")
        keys.setdefault(path if colon else "", set()).update(re.split(r", ", names))
    return keys


def found(value: object, path: str, keys: dict[str, set[str]]) -> dict[str, set[str]]:
    """The same of a document, whose numbers are numbers."""
    if isinstance(value, dict):
        keys.setdefault(path, set()).update(value)
        for key, member in value.items():
            found(member, f"{path}.{key}" if path else key, keys)
    elif isinstance(value, list):
        for member in value:
            found(member, f"{path}[]", keys)
    elif isinstance(value, str):
        assert not re.fullmatch(r"[-+]?\d+(\.\d*)?(e[-+]?\d+)?", value)
    return keys


@pytest.mark.parametrize("command", CALLS)
def test_keys_are_the_documented_ones(filled: SupportStore, tmp_path: Path, command: str) -> None:
    file = tmp_path / "actions.safetensors"
    if command == "import":
        filled.export(file)
    if command == "classify":  # of a long clip, all that is done in it
        squat = read_clip(SQUAT)
        file = tmp_path / "long.npz"
        write_clip(file, Clip(np.tile(squat.joints, (3, 1, 1)), squat.joint_names, squat.fps))
    if command == "cameras":
        file = write_video(tmp_path / "a.mp4", numbered(3))
    if command == "doctor":
        content = bytearray(filled.path.read_bytes())
        content[len(content) // 2] ^= 1
        filled.path.write_bytes(content)
        # Without its copy, what the byte belonged to is gone.
        filled.path.with_name(filled.path.name + ".backup").unlink(missing_ok=True)
    keys: dict[str, set[str]] = {}
    for call in CALLS[command]:
        words = [str(file) if word == "FILE" else word for word in call]
        output = invoke(command, *words, "--json").stdout
        document, end = json.JSONDecoder().raw_decode(output)
        assert output[end:] == "\n"
        found(document, "", keys)
    assert keys == documented(invoke(command, "--help").stdout)


def test_keys_of_an_error_are_the_documented_ones() -> None:
    error = json.loads(invoke("show", "x", "--json").stdout)
    assert list(error) == ["error"]
    inside = ", ".join(f'"{key}"' for key in error["error"])
    assert f'{{"error": {{{inside}}}}}' in re.sub(r"\s+", " ", invoke("--help").stdout)
