"""C3D files, written by the library that reads them."""

from __future__ import annotations

import re
import sys
from pathlib import Path

import numpy as np
import pytest

from actioncli.clips.read import read_clip
from actioncli.clips.skeleton import DEFAULT_JOINTS, select_joints
from actioncli.errors import ClipError

from ..bodies import TO_FILE, waving

BODY = dict(zip(DEFAULT_JOINTS, waving().swapaxes(0, 1) - waving().mean(axis=(0, 1)), strict=True))
# The markers of each joint, and how far they lie from it.
PLUG_IN_GAIT = {
    "hip": ["{S}ASI"], "kne": ["{S}KNE"], "ank": ["{S}ANK"], "sho": ["{S}SHO"], "elb": ["{S}ELB"],
    "wri": ["{S}WRA", "{S}WRB"],
}  # fmt: skip
HELEN_HAYES = {
    "hip": ["{S}.ASIS"], "kne": ["{S}.Knee.Lat", "{S}.Knee.Med"],
    "ank": ["{S}.Ankle.Lat", "{S}.Ankle.Med"], "sho": ["{S}.Acromium"], "elb": ["{S}.Elbow.Lat"],
    "wri": ["{S}.Wrist.Lat", "{S}.Wrist.Med"],
}  # fmt: skip
QUALISYS = {
    "hip": ["{S}_IAS"], "kne": ["{S}_FLE", "{S}_FME"], "ank": ["{S}_FAL", "{S}_TAM"],
    "sho": ["{S}_SAE"], "elb": ["{S}_HLE", "{S}_HME"], "wri": ["{S}_RSP", "{S}_USP"],
}  # fmt: skip
HEADS = {"LFHD RFHD LBHD RBHD": PLUG_IN_GAIT, "Top.Head": HELEN_HAYES, "SGL": QUALISYS}


def markers(head: str) -> dict[str, np.ndarray]:
    """Markers (T, 3) by name, z up; those of one joint stand on both sides of it."""
    found = {}
    for joint, names in HEADS[head].items():
        for side in "lr":
            for name, beside in zip(names, (1, -1) if len(names) == 2 else (0,), strict=True):
                place = BODY[side + joint] + 0.04 * beside * np.array([1, 0, 0])
                found[name.format(S=side.upper())] = place
    found |= dict.fromkeys(head.split(), BODY["head"])
    return {name: TO_FILE["z"](place) for name, place in found.items()}


def write(file: Path, places: dict[str, np.ndarray], prefix: str = "") -> Path:
    ezc3d = pytest.importorskip("ezc3d", reason="needs the extra c3d")
    content = ezc3d.c3d()
    point = content["parameters"]["POINT"]
    point["RATE"]["value"], point["UNITS"]["value"] = [100.0], ["mm"]
    point["LABELS"]["value"] = [prefix + name for name in places]
    points = np.ones((4, len(places), 40))
    points[:3] = 1000 * np.stack(list(places.values())).transpose(2, 0, 1)
    content["data"]["points"] = points
    content.write(str(file))
    return file


@pytest.mark.parametrize("prefix", ["", "Subject01:"])
@pytest.mark.parametrize("head", HEADS)
def test_markers_of_the_common_sets(tmp_path: Path, head: str, prefix: str) -> None:
    places = markers(head) | {"*12": np.zeros((40, 3)) + 0.5, "LHipAngles": np.full((40, 3), 70.0)}
    clip = read_clip(write(tmp_path / "a.c3d", places, prefix))
    assert clip.fps == 100
    assert "up axis inferred from the posture: z (--up)" in clip.notes
    assert not any("Angles" in name or "*" in name for name in clip.joint_names)
    found = select_joints(clip.joints, clip.joint_names, DEFAULT_JOINTS)
    wanted = np.stack([BODY[name] for name in DEFAULT_JOINTS], axis=1)
    centre = DEFAULT_JOINTS.index("pelv")
    np.testing.assert_allclose(found - found[:, [centre]], wanted - wanted[:, [centre]], atol=2e-3)


def test_a_marker_that_was_lost_is_a_gap(tmp_path: Path) -> None:
    places = markers("SGL")
    places["L_SAE"] = places["L_SAE"].copy()
    places["L_SAE"][10:13] = np.nan
    clip = read_clip(write(tmp_path / "a.c3d", places))
    assert any("gaps filled" in note for note in clip.notes)


def test_damage(tmp_path: Path) -> None:
    file = write(tmp_path / "a.c3d", markers("SGL"))
    whole = file.read_bytes()
    for content in (whole[:700], b"no c3d at all" * 100, whole[:2] + bytes(1000)):
        file.write_bytes(content)
        with pytest.raises(ClipError, match=r"a\.c3d: "):
            read_clip(file)


def test_one_that_is_cut_off_is_told(tmp_path: Path) -> None:
    file = write(tmp_path / "a.c3d", markers("SGL"))
    assert not any("cut off" in note for note in read_clip(file).notes)
    file.write_bytes(file.read_bytes()[:7000])
    assert any(
        re.fullmatch(r"is cut off: \d+ of 40 .* are there", n) for n in read_clip(file).notes
    )


def test_without_the_library(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "ezc3d", None)
    (tmp_path / "a.c3d").write_bytes(b"\x02P" + bytes(510))
    with pytest.raises(ClipError, match=r"pip install 'actioncli\[c3d\]'"):
        read_clip(tmp_path / "a.c3d")


def test_what_lies_where_the_user_is_does_not_take_the_reader_s_place(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    file = write(tmp_path / "a.c3d", markers("LFHD RFHD LBHD RBHD"))
    (tmp_path / "numpy.py").write_text("raise SystemExit('not the real one')")
    monkeypatch.chdir(tmp_path)
    assert len(read_clip(file, up="z").joints) == 40


def test_a_header_that_sends_the_reader_astray_is_given_up(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    content = bytearray((Path(__file__).parents[2] / "fuzz/corpus/c3d/seed").read_bytes())
    content[550], content[936], content[978] = 72, 254, 247  # how large parameters are
    file = tmp_path / "a.c3d"
    file.write_bytes(content)
    monkeypatch.setattr("actioncli.clips.formats.c3d._PATIENCE", 2.0)
    with pytest.raises(ClipError, match="reading it does not end"):
        read_clip(file)
