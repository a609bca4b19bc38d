from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from actioncli.clips.clip import Clip
from actioncli.clips.collection import read_collection
from actioncli.clips.read import CLIP_SUFFIXES, find_clips, read_clip
from actioncli.clips.skeleton import DEFAULT_JOINTS, LAYOUTS, select_joints
from actioncli.errors import AmbiguousClipError, ClipError, UsageError

from .bodies import (
    CENTRE,
    TO_FILE,
    kinect_v2,
    waving,
    write_bvh,
    write_csv,
    write_json,
    write_npy,
    write_npz,
    write_ntu,
    write_trc,
)


def default_joints(clip: Clip) -> np.ndarray:
    return select_joints(clip.joints, clip.joint_names, DEFAULT_JOINTS)


def test_one_clip_is_the_same_in_every_format(tmp_path: Path) -> None:
    body = waving()
    smpl = waving(joints=LAYOUTS["smpl+head_30"])
    files = [
        write_npy(tmp_path / "a.npy", smpl),
        write_npy(tmp_path / "flat.npy", smpl.reshape(len(smpl), -1)),
        write_npz(tmp_path / "a.npz", 1000 * TO_FILE["-y"](body)),
        write_json(tmp_path / "a.json", body),
        write_csv(tmp_path / "a.csv", 100 * body),
        write_ntu(tmp_path / "a.skeleton", [[("7205", frame)] for frame in kinect_v2(body)]),
        write_trc(tmp_path / "a.trc", 1000 * body, unit="mm"),
        write_bvh(tmp_path / "a.bvh", body, scale=100),
    ]
    # .c3d is written by the library that reads it, see its own tests.
    assert {file.suffix for file in files} | {".c3d"} == set(CLIP_SUFFIXES)
    for file in files:
        np.testing.assert_allclose(
            default_joints(read_clip(file)), body, atol=1e-4, err_msg=file.name
        )


@pytest.mark.parametrize("up", TO_FILE)
def test_no_up_axis_mirrors_the_person(tmp_path: Path, up: str) -> None:
    body = waving()
    file = write_npz(tmp_path / "a.npz", TO_FILE[up](body))
    read = default_joints(read_clip(file, up=up))
    np.testing.assert_allclose(read, body, atol=1e-5)
    lsho, rsho, head = (read[:, DEFAULT_JOINTS.index(name)] for name in ("lsho", "rsho", "head"))
    neck = (lsho + rsho) / 2
    # Left, up and ahead of a person form a right-handed frame: ahead is left x up.
    facing = np.cross(lsho - rsho, head - neck)
    assert (facing[:, 2] < 0).all()
    assert (lsho[:, 0] < rsho[:, 0]).all()


@pytest.mark.parametrize("up", ["y", "-y", "z"])
@pytest.mark.parametrize(("unit", "scale"), [("m", 1), ("cm", 100), ("mm", 1000)])
def test_unit_and_up_are_inferred_and_noted(
    tmp_path: Path, up: str, unit: str, scale: float
) -> None:
    body = waving() - CENTRE
    clip = read_clip(write_npz(tmp_path / "a.npz", scale * TO_FILE[up](body)))
    np.testing.assert_allclose(default_joints(clip), body, atol=1e-5)
    assert f"unit inferred from the size of the body: {unit} (--unit)" in clip.notes
    assert f"up axis inferred from the posture: {up} (--up)" in clip.notes
    assert any("30 assumed" in note for note in clip.notes)


@pytest.mark.parametrize("axis", ["x", "-x", "-z"])
def test_a_body_along_another_axis_may_be_lying(tmp_path: Path, axis: str) -> None:
    file = write_npz(tmp_path / "a.npz", TO_FILE[axis](waving()))
    with pytest.raises(AmbiguousClipError, match=r"a\.npz.*--up"):
        read_clip(file)


def test_lying_before_a_camera_is_not_taken_for_standing(tmp_path: Path) -> None:
    lying = TO_FILE["z"](waving() - CENTRE) + np.array([0, 0.8, 3.0])
    with pytest.raises(AmbiguousClipError, match="--up"):
        read_clip(write_npz(tmp_path / "a.npz", lying))


def test_what_the_file_states_is_taken(tmp_path: Path) -> None:
    body = waving()
    file = write_npz(
        tmp_path / "a.npz", 1000 * TO_FILE["-y"](body), fps=25, unit="millimeters", up="camera"
    )
    clip = read_clip(file)
    assert (clip.fps, clip.notes) == (25, ())
    np.testing.assert_allclose(default_joints(clip), body, atol=1e-5)
    assert read_clip(file, fps=50).fps == 50


@pytest.mark.parametrize(
    ("metres", "stated", "message"),
    [
        (1, {"unit": "mm"}, "states 'mm' as its unit, which would make the body 0.00"),
        (0.01, {"unit": "parsec"}, "states 'parsec' as its unit, which is none of m, cm"),
        # As in the collection of CMU: inches, divided by 0.45.
        (0.0254 / 0.45, {}, "so that the body has a grown person's size"),
        (0.0254 * 4, {}, "so that the body has a grown person's size"),
        (1e-6, {"unit": "m"}, "so that the body has a grown person's size"),
    ],
)
def test_an_unlikely_unit_is_told_and_never_asked_for(
    tmp_path: Path, metres: float, stated: dict[str, str], message: str
) -> None:
    file = write_npz(tmp_path / "a.npz", (waving() - CENTRE) / metres, **stated)
    clip = read_clip(file)
    assert message in "; ".join(clip.notes)
    np.testing.assert_allclose(default_joints(clip), waving() - CENTRE, atol=0.05)
    file = write_npz(tmp_path / "a.npz", waving() / metres, **stated)
    clip = read_clip(file, unit=metres)
    np.testing.assert_allclose(default_joints(clip), waving(), atol=1e-4)


@pytest.mark.parametrize("layout", LAYOUTS)
def test_a_bare_array_has_the_one_layout_of_its_count(tmp_path: Path, layout: str) -> None:
    names = LAYOUTS[layout]
    file = write_npy(tmp_path / "a.npy", waving(joints=names))
    alike = [name for name in LAYOUTS if len(LAYOUTS[name]) == len(names)]
    if alike == [layout]:
        clip = read_clip(file)
        assert f"layout inferred from {len(names)} joints: {layout}" in clip.notes
    else:
        with pytest.raises(AmbiguousClipError, match="--layout") as caught:
            read_clip(file)
        assert all(name in str(caught.value) for name in alike)
        clip = read_clip(file, layout=layout)
    assert clip.joint_names == names
    np.testing.assert_allclose(default_joints(clip), waving(), atol=1e-5)


def test_a_count_of_no_layout_lists_the_layouts(tmp_path: Path) -> None:
    file = write_npy(tmp_path / "a.npy", np.ones((5, 7, 3)))
    with pytest.raises(ClipError, match=r"7 joints.*smpl_24 \(24\)"):
        read_clip(file)
    with pytest.raises(ClipError, match="smpl_24 has 24"):
        read_clip(file, layout="smpl_24")


def test_layout_option_wins_over_names(tmp_path: Path) -> None:
    file = tmp_path / "a.npz"
    np.savez(file, joints=waving(), joint_names=np.array([f"marker {j}" for j in range(15)]))
    with pytest.raises(AmbiguousClipError, match="--layout"):
        read_clip(file)
    assert read_clip(file, layout="default_15").joint_names == DEFAULT_JOINTS


@pytest.mark.parametrize(
    "options",
    [{"layout": "kinekt"}, {"fps": 0}, {"fps": float("nan")}, {"unit": "parsec"}, {"up": "w"}],
)
def test_impossible_options_are_usage_errors(tmp_path: Path, options: dict[str, object]) -> None:
    with pytest.raises(UsageError, match=f"--{next(iter(options))}"):
        read_clip(write_npz(tmp_path / "a.npz", waving()), **options)  # type: ignore[arg-type]


@pytest.mark.parametrize(
    "field",
    [{"up": "w"}, {"fps": -3.0}, {"fps": 1e-300}, {"fps": 1e300}, {"layout": "kinekt"}],
)  # fmt: skip
def test_stated_nonsense_names_the_option(tmp_path: Path, field: dict[str, Any]) -> None:
    np.savez(tmp_path / "a.npz", joints=waving(joints=LAYOUTS["smpl_24"]), **field)
    with pytest.raises(ClipError, match=f"--{next(iter(field))}"):
        read_clip(tmp_path / "a.npz")


def test_content_settles_what_the_suffix_gets_wrong(tmp_path: Path) -> None:
    write_npz(tmp_path / "a.npz", waving())
    file = (tmp_path / "a.npz").rename(tmp_path / "a.npy")
    clip = read_clip(file)
    assert "read as .npz by its content, in spite of its suffix" in clip.notes


def test_files_that_are_no_clips(tmp_path: Path) -> None:
    (tmp_path / "empty.npy").touch()
    (tmp_path / "clip.mp3").write_bytes(b"ID3")
    (tmp_path / "folder.npy").mkdir()
    for name, message in [
        ("empty.npy", "is empty"),
        ("clip.mp3", r"\.npy, \.npz, \.json, \.csv, \.skeleton, \.trc, \.bvh"),
        ("folder.npy", "is a folder"),
        ("missing.npy", "no such file"),
        ("nul\0.npy", "is not a file name"),
        ("x" * 300 + ".npy", "cannot be read"),
    ]:
        with pytest.raises(ClipError, match=message):
            read_clip(tmp_path / name)


@pytest.mark.skipif(os.geteuid() == 0, reason="root may read everything")
def test_unreadable_file(tmp_path: Path) -> None:
    file = write_npy(tmp_path / "a.npy", waving())
    file.chmod(0)
    with pytest.raises(ClipError, match="cannot be read"):
        read_clip(file)


@pytest.mark.parametrize(
    ("shape", "message"),
    [((5, 15, 3), "2 distinct frames"), ((1, 15, 3), "at least 2 frames"),
     ((2**18 + 1, 15, 3), "cut out the action"), ((2, 2000, 3), "cut out the action")],
)  # fmt: skip
def test_still_short_and_long_clips(
    tmp_path: Path, shape: tuple[int, int, int], message: str
) -> None:
    body = np.broadcast_to(np.resize(waving()[0], shape[1:]), shape).astype(np.float32)
    file = write_npy(tmp_path / "a.npy", body)
    with pytest.raises(ClipError, match=message):
        read_clip(file, layout="default_15", unit="m", up="y")


def test_find_clips(tmp_path: Path) -> None:
    for name in ("b.npy", "a.json", "notes.txt", ".hidden.npy", "sub/c.CSV", ".git/d.npy"):
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).touch()
    assert find_clips([tmp_path]) == [tmp_path / name for name in ("a.json", "b.npy", "sub/c.CSV")]
    assert find_clips([f"{tmp_path}/*.npy", tmp_path / "b.npy"]) == [tmp_path / "b.npy"]
    assert find_clips([f"{tmp_path}/.*.npy"]) == [tmp_path / ".hidden.npy"]
    assert find_clips([tmp_path / "s*"]) == [tmp_path / "sub/c.CSV"]
    assert find_clips([tmp_path], suffixes=(".txt",)) == [tmp_path / "notes.txt"]
    for nothing in ("none.npy", "none*.npy", "a**b", "nul\0"):
        assert find_clips([tmp_path / nothing]) == [tmp_path / nothing]
    (tmp_path / "wave[1].npz").touch()
    assert find_clips([tmp_path / "wave[1].npz"]) == [tmp_path / "wave[1].npz"]


@pytest.mark.usefixtures("unmeasured")
def test_reading_an_array_imports_no_other_reader(tmp_path: Path) -> None:
    file = write_npy(tmp_path / "a.npy", waving(joints=LAYOUTS["smpl_24"]))
    program = (
        "import sys; from actioncli.clips.read import read_clip; "
        f"read_clip({str(file)!r}); print(*sorted(sys.modules))"
    )
    run = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True)
    assert run.returncode == 0, run.stderr
    loaded = set(run.stdout.split())
    assert not loaded & {"json", "csv", "scipy", "torch", "cv2", "onnxruntime"}
    assert "actioncli.clips.formats.npy" in loaded
    assert "actioncli.clips.formats.npz" not in loaded


@pytest.mark.parametrize(
    ("up", "unit", "scale"), [("y", "m", 1), ("-y", "mm", 1000), ("z", "cm", 100)]
)
def test_inference_is_never_wrong_on_recordings(
    shared: Path, tmp_path: Path, up: str, unit: str, scale: float
) -> None:
    """People, sensors and studios of ten collections: right, or a question."""
    asked = clips = 0
    for source in sorted((shared / "data").glob("*.npz")):
        for clip in read_collection(source).clips[::97]:
            clips += 1
            names = np.array(clip.joint_names)
            positions = scale * TO_FILE[up](clip.joints)
            np.savez(tmp_path / "a.npz", joints=positions, joint_names=names)
            try:
                read = read_clip(tmp_path / "a.npz")
            except AmbiguousClipError:
                asked += 1
                read = read_clip(tmp_path / "a.npz", unit=unit, up=up)
            np.testing.assert_allclose(default_joints(read), default_joints(clip), atol=2e-3)
    # Who stands before a sensor with z up, or lies, is asked for; others are not.
    assert asked <= (0.03 if up != "z" else 0.5) * clips, (asked, clips)


@given(text=st.text(max_size=8))
def test_units_and_axes_of_any_spelling(text: str) -> None:
    from actioncli.clips.axes import UPS, parse_unit, parse_up

    unit, up = parse_unit(text), parse_up(text)
    assert unit is None or 0 < unit < 1e9
    assert up is None or up in UPS
