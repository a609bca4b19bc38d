"""doctor."""

import json
import os
import re
import shutil
from pathlib import Path

import numpy as np
import pytest

from actioncli import SupportStore, __version__, files
from actioncli.cli import doctor

from .conftest import ACTIONS, EXAMPLES, invoke, run


def test_a_whole_installation(filled: SupportStore) -> None:
    result = invoke("doctor", "--json")
    told = json.loads(result.stdout)
    assert (result.exit_code, told["ok"], result.stderr) == (0, True, "")
    found = {check["name"]: check for check in told["checks"]}
    assert found["actioncli"]["detail"] == __version__
    assert found["enrolled"]["detail"] == "5 actions, 5 examples"
    assert str(filled.path) in found["support set"]["detail"]
    for part in ("weights", "recognition", "poses", "hands"):
        assert found[part]["status"] == "ok"
    assert found["pose_detector.onnx"]["detail"].endswith("intact")
    assert found["numpy"]["detail"] == f"numpy {np.__version__}"
    assert "numpy" in invoke("doctor").stdout
    assert invoke("doctor", "-q").output == ""


def test_a_library_of_the_system_that_is_missing_is_told(
    filled: SupportStore, tmp_path: Path
) -> None:
    """What `opencv-python` says on a server, where it replaced the package that is asked for."""
    told = "libGL.so.1: cannot open shared object file"
    (tmp_path / "cv2.py").write_text(f"raise ImportError({told!r})")
    paths = os.pathsep.join([str(tmp_path), *filter(None, [os.environ.get("PYTHONPATH")])])
    environment = {**os.environ, "PYTHONPATH": paths}
    done = run("classify", "--tau", "0.5", tmp_path / "a.mp4", env=environment)
    assert done.returncode == 70
    way_out = "`actioncli doctor` tries them all."
    assert done.stderr == f"error: a package cannot be loaded: {told}; {way_out}\n"
    done = run("doctor", env=environment)
    assert done.returncode == 70
    assert re.search(rf"^poses +problem +no video can be read: {told}$", done.stdout, re.M)
    assert done.stderr == "error: 1 problem: poses\n"


@pytest.mark.parametrize("name", ["trx_os.safetensors", "pose_detector.onnx"])
def test_an_altered_file_is_named_and_the_others_are_still_checked(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, name: str
) -> None:
    """Also weights that another program sealed again, whose own checksum fits."""
    shipped = files.weights_folder()
    shutil.copy(shipped / "SHA256SUMS", tmp_path)
    listed = [line.split()[1] for line in (tmp_path / "SHA256SUMS").read_text().splitlines()]
    suffixes = {".onnx", ".safetensors"}
    assert {file.name for file in shipped.iterdir() if file.suffix in suffixes} <= {*listed}
    for file in listed[1:]:
        (tmp_path / file).symlink_to(shipped / file)
    (tmp_path / name).unlink()
    (tmp_path / name).write_bytes((shipped / name).read_bytes() + b" ")
    monkeypatch.setattr(files, "weights_folder", lambda: tmp_path)
    checks = {check.name: check for check in doctor._shipped_files()}
    assert list(checks) == listed
    assert [each for each in listed if checks[each].status != "ok"] == sorted([listed[0], name])
    assert checks[name].detail.startswith("altered or damaged")
    assert "No such file" in checks[listed[0]].detail


def test_no_support_set_yet_is_no_problem(home: Path) -> None:
    assert invoke("doctor").exit_code == 0
    assert not home.exists()


def test_problems_have_the_codes_of_their_errors(store: SupportStore, tmp_path: Path) -> None:
    broken = tmp_path / "broken.db"
    broken.write_text("no database" * 100)
    weights = tmp_path / "damaged.safetensors"
    weights.write_bytes(b"no weights")
    for words, code, part in (
        (["--store", broken], 5, "support set"),
        (["--weights", weights], 6, "weights"),
        (["--store", broken, "--weights", weights], 6, "weights"),
    ):
        result = invoke("doctor", "--json", *words)
        assert result.exit_code == code
        told = json.loads(result.stdout)
        assert not told["ok"]
        assert part in [c["name"] for c in told["checks"] if c["status"] == "problem"]
        assert result.stderr.startswith("error: ")
        # Everything else is still looked at.
        assert len(told["checks"]) > 10


def damage(store: SupportStore, example: int) -> None:
    """Flip a bit of an example's recording."""
    joints = store.clip(example).joints.astype("<f4").tobytes()
    content = bytearray(store.path.read_bytes())
    content[content.index(joints[-64:])] ^= 1
    store.path.write_bytes(content)


def test_damage_is_told_with_the_way_out(filled: SupportStore, tmp_path: Path) -> None:
    damage(filled, 3)
    told = json.loads(invoke("doctor", "--json").stdout)
    assert [
        check["detail"].endswith("`actioncli doctor --repair` sets it aside; then enrol it again.")
        for check in told["checks"]
        if check["status"] == "problem"
    ] == [True]
    assert "repair" not in told
    for words in (["classify", EXAMPLES / "bow"], ["export", tmp_path / "out"], ["show", "bow"]):
        result = invoke(*words)
        assert result.exit_code == 5
        assert "example 3 of 'bow' is damaged" in result.stderr
        assert "doctor --repair" in result.stderr
    # Where no page can be read, likewise.
    filled.path.write_bytes(filled.path.read_bytes()[:5000])
    for words in (["list-support"], ["enroll", "bow", EXAMPLES / "bow"], ["remove", "bow", "-y"]):
        result = invoke(*words)
        assert result.exit_code == 5
        assert "doctor --repair" in result.stderr


def test_repair_tells_what_is_gone(filled: SupportStore) -> None:
    clips = {label: filled.support()[label][0] for label in ACTIONS}
    copy = filled.path.with_name("support.db.backup")
    checks = json.loads(invoke("doctor", "--json").stdout)["checks"]
    assert [check["status"] for check in checks if check["name"] == "copy of it"] == ["ok"]
    copy.unlink()
    damage(filled, 3)
    result = invoke("doctor", "--repair")
    kept = filled.path.with_name("support.db.damaged")
    assert result.exit_code == 0
    assert result.stdout.splitlines()[:2] == [
        f"support set: 4 examples salvaged; the damaged file is kept as {kept}",
        "gone: example 3 of bow: its recording is damaged",
    ]
    assert sorted(filled.support()) == sorted(clips.keys() - {"bow"})
    assert [action.label for action in filled.actions()] == sorted(clips.keys() - {"bow"})
    again = json.loads(invoke("doctor", "--repair", "--json").stdout)
    assert again["repair"] is None
    assert again["ok"]
    assert "not damaged" in invoke("doctor", "--repair").stderr
    filled.enroll("bow", clips["bow"])
    assert filled.check() == []
