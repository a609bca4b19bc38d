"""Headers as programs, spreadsheets and people of other countries write them."""

from __future__ import annotations

import json
import re
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from actioncli.clips.read import read_clip
from actioncli.clips.skeleton import DEFAULT_JOINTS, select_joints

from ..bodies import waving, write_bvh, write_csv, write_json, write_ntu, write_trc

Edit = Callable[[str], str]


def comma_decimals(text: str) -> str:
    return re.sub(r"(\d)\.(\d)", r"\1,\2", text)


def semicolons(text: str) -> str:
    return comma_decimals(text.replace(",", ";"))


def in_header(edit: Edit) -> Edit:
    """Change the first line alone."""
    return lambda text: "\n".join([edit(text.split("\n")[0]), *text.split("\n")[1:]])


def in_names(edit: Edit) -> Edit:
    """Change the line of a .trc that names the markers."""
    return lambda text: "\n".join(
        edit(line) if line.startswith("Frame#") else line for line in text.split("\n")
    )


def with_empty_column(text: str) -> str:
    """A table with an empty column before and after."""
    return "\n".join(f",{line}," for line in text.split("\n") if line)


CSV: dict[str, Edit] = {
    "as it is": str,
    "byte-order mark": lambda text: f"\ufeff{text}",
    "capitals": in_header(str.upper),
    "small letters": in_header(str.lower),
    "quoted": in_header(lambda line: ",".join(f'"{cell}"' for cell in line.split(","))),
    "blanks about the cells": in_header(lambda line: line.replace(",", " , ")),
    "empty cells": with_empty_column,
    "an index without a name": lambda text: "\n".join(
        f"{at - 1 if at else ''},{line}" for at, line in enumerate(text.split("\n")) if line
    ),
    "semicolons": lambda text: text.replace(",", ";"),
    "semicolons and decimal commas": semicolons,
    "tabs": lambda text: text.replace(",", "\t"),
    "tabs and decimal commas": lambda text: comma_decimals(text.replace(",", "\t")),
    "ends of lines of Windows": lambda text: text.replace("\n", "\r\n"),
    "empty lines before and between": lambda text: "\n\n" + text.replace("\n", "\n\n"),
    "the separator stated": lambda text: f"sep=;\n{semicolons(text)}",
    "a comment first": lambda text: f"# made by a program\n{text}",
    "no line end at the end": str.rstrip,
}


@pytest.mark.parametrize("kind", CSV)
def test_csv(tmp_path: Path, kind: str) -> None:
    file = write_csv(tmp_path / "a.csv", waving())
    file.write_bytes(CSV[kind](file.read_text(encoding="utf-8")).encode())
    same(file)


TRC: dict[str, Edit] = {
    "as it is": str,
    "byte-order mark": lambda text: f"\ufeff{text}",
    "names in capitals": in_names(lambda line: line.upper()),
    "other case of the keys": lambda text: text.replace("DataRate", "DATARATE").replace(
        "Units", "UNITS"
    ),
    "frame without a hash": lambda text: text.replace("Frame#", "Frame"),
    "decimal commas": comma_decimals,
    "ends of lines of Windows": lambda text: text.replace("\n", "\r\n"),
    "empty cells behind the names": in_names(lambda line: f"{line}\t\t\t\t"),
    "empty cells behind all": lambda text: text.replace("\n", "\t\t\n"),
    "no empty line": lambda text: text.replace("\n\n", "\n"),
    "blanks about the names": in_names(lambda line: line.replace("\t", " \t ")),
    "a subject before the names": in_names(
        lambda line: re.sub(r"\t(?=[a-z])", r"\tSubject01:", line)
    ),
}


@pytest.mark.parametrize("kind", TRC)
def test_trc(tmp_path: Path, kind: str) -> None:
    file = write_trc(tmp_path / "a.trc", waving())
    file.write_bytes(TRC[kind](file.read_text(encoding="utf-8")).encode())
    same(file)
    assert read_clip(file).fps == 60


BVH: dict[str, Edit] = {
    "as it is": str,
    "byte-order mark": lambda text: f"\ufeff{text}",
    "small letters": str.lower,
    "capitals": str.upper,
    "decimal commas": comma_decimals,
    "tabs": lambda text: text.replace(" ", "\t"),
    "ends of lines of Windows": lambda text: text.replace("\n", "\r\n"),
    "brackets in the line": lambda text: text.replace("\n{", " {"),
    "empty lines": lambda text: text.replace("\n", "\n\n"),
    "blanks at the ends": lambda text: text.replace("\n", "  \n"),
    "blank before the colon": lambda text: text.replace("Frames:", "Frames :"),
}


@pytest.mark.parametrize("kind", BVH)
def test_bvh(tmp_path: Path, kind: str) -> None:
    file = write_bvh(tmp_path / "a.bvh", waving())
    file.write_bytes(BVH[kind](file.read_text(encoding="utf-8")).encode())
    same(file)


NTU: dict[str, Edit] = {
    "as it is": str,
    "byte-order mark": lambda text: f"\ufeff{text}",
    "decimal commas": comma_decimals,
    "ends of lines of Windows": lambda text: text.replace("\n", "\r\n"),
    "blanks at the ends": lambda text: text.replace("\n", " \n"),
}


@pytest.mark.parametrize("kind", NTU)
def test_ntu(tmp_path: Path, kind: str) -> None:
    from actioncli.clips.skeleton import LAYOUTS

    body = waving(40, LAYOUTS["kinect_v2_25"])
    file = write_ntu(tmp_path / "a.skeleton", [[("1", frame)] for frame in body])
    file.write_bytes(NTU[kind](file.read_text(encoding="utf-8")).encode())
    same(file)


JSON: dict[str, Edit] = {
    "as it is": str,
    "byte-order mark": lambda text: f"\ufeff{text}",
    "keys in other cases": lambda text: text.replace('"joints"', '"Joints"').replace(
        '"joint_names"', '"Joint_Names"'
    ),
    "names in capitals": lambda text: json.dumps(
        json.loads(text) | {"joint_names": [name.upper() for name in DEFAULT_JOINTS]}
    ),
    "indented": lambda text: json.dumps(json.loads(text), indent=2),
    "ends of lines of Windows": lambda text: json.dumps(json.loads(text), indent=1).replace(
        "\n", "\r\n"
    ),
}


@pytest.mark.parametrize("kind", JSON)
def test_json(tmp_path: Path, kind: str) -> None:
    file = write_json(tmp_path / "a.json", waving())
    file.write_bytes(JSON[kind](file.read_text(encoding="utf-8")).encode())
    same(file)


def same(file: Path) -> None:
    """The file is read as the body that was written."""
    clip = read_clip(file, up="y")
    found = select_joints(clip.joints, clip.joint_names, DEFAULT_JOINTS)
    wanted = select_joints(waving().astype(np.float32), DEFAULT_JOINTS, DEFAULT_JOINTS)
    assert np.abs(found - wanted).max() < 1e-3
