"""Hostile clips, collections, weights, exports and splits: an error that names the file, in
bounded time and memory. Damage by chance is in `tests/clips/test_damage.py`, what nobody thought
of in `tests/fuzz`."""

import io
import json
import os
import pickle
import zipfile
from collections.abc import Callable
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from fuzz.readers import READERS, _pack_weights, _with_zeros

from actioncli import Clip, ClipError, Recognizer, WeightsError, read_clip, read_collection
from actioncli.clips.prepare import Preparation
from actioncli.errors import ActionCliError
from actioncli.model.config import ModelConfig, config_to_json
from actioncli.model.trx_os import parameter_shapes
from actioncli.model.weights import read_weights, write_weights

from .limits import run_limited

BOMBS = """
import json, sys, zipfile
from pathlib import Path
import numpy as np
from fuzz.readers import READERS
from actioncli.errors import ActionCliError

here = Path(sys.argv[1])
deep = "[" * 1_900_000 + "]" * 1_900_000
(here / "deep.json").write_text(deep)
(here / "deep_names.json").write_text('{"joints": [[[1, 2, 3]]], "joint_names": %s}' % deep)
(here / "number.json").write_text('{"joints": [[[1, 2, %s]]]}' % ("9" * 3_000_000))
(here / "field.csv").write_text('a_x,a_y,a_z\\n1,"' + "9" * 500_000 + '",3\\n1,2,3\\n')
(here / "line.csv").write_text("a_x," + "b" * 100_000_000)
(here / "columns.csv").write_text(",".join(f"j{n}_x,j{n}_y,j{n}_z" for n in range(40_000)))
(here / "joints.bvh").write_text("HIERARCHY\\nROOT a\\n{\\n" + "JOINT b\\n{\\n" * 500_000)
(here / "markers.trc").write_text("DataRate\\tUnits\\n30\\tm\\nFrame#\\tTime\\t" + "m\\t" * 300_000)
(here / "bodies.skeleton").write_text("262144\\n" + "6\\n" * 1_000_000)
with zipfile.ZipFile(here / "members.npz", "w") as file:
    for number in range(60_000):
        file.writestr(f"{number}.npy", b"")
start = b"\\x93NUMPY\\x01\\x00"
for name, shape in {"text": "'<U9999999', 'fortran_order': False, 'shape': (9,)",
                    "labels": "'<i8', 'fortran_order': False, 'shape': (33000000, 1)"}.items():
    header = ("{'descr': " + shape + ", }\\n").encode()
    with zipfile.ZipFile(here / f"{name}.npz", "w", zipfile.ZIP_DEFLATED, compresslevel=1) as file:
        with file.open("lengths.npy", "w") as member:
            member.write(start + len(header).to_bytes(2, "little") + header)
            for _ in range(300):
                member.write(bytes(10**6))
lengths = [2**63 + 8, 2**40, 100_000_000]
for number, length in enumerate(lengths):
    with open(here / f"length{number}.safetensors", "wb") as file:
        file.write(length.to_bytes(8, "little") + b"{}")
        file.truncate(200_000_000)
nested = deep[:4_000_000].encode()
(here / "nested.safetensors").write_bytes(len(nested).to_bytes(8, "little") + nested)
huge = {"a": {"dtype": "F32", "shape": [2**40, 2**30], "data_offsets": [0, 2**63]}}
text = json.dumps(huge).encode()
(here / "shape.safetensors").write_bytes(len(text).to_bytes(8, "little") + text + bytes(100))
overlapping = {f"t{n}": {"dtype": "F32", "shape": [25], "data_offsets": [0, 100]}
               for n in range(50_000)}
text = json.dumps(overlapping).encode()
(here / "overlap.safetensors").write_bytes(len(text).to_bytes(8, "little") + text + bytes(100))
(here / "classes.json").write_text(json.dumps({"a": {"train": [str(n) for n in range(200_000)]}}))
with open(here / "sparse.json", "wb") as file:
    file.write(b"[")
    file.truncate(3_000_000_000)

np.savez_compressed(here / "zeros.npz", joints=np.zeros((2**18, 21, 3), np.float32))
header = b"{'descr': '<f8', 'fortran_order': False, 'shape': (31000000, 1), }\\n"
array = start + len(header).to_bytes(2, "little") + header
with zipfile.ZipFile(here / "bomb.npz", "w", zipfile.ZIP_DEFLATED, compresslevel=1) as file:
    with file.open("joints.npy", "w") as member:
        member.write(array)
        for _ in range(248):
            member.write(bytes(10**6))
(here / "announced.npy").write_bytes(array.replace(b"31000000, 1", b"31000000000"))
np.save(here / "longest.npy", np.random.default_rng(0).normal(size=(2**18, 20, 3)))
(here / "lists.json").write_text("[" + "[[],[]]," * 600_000 + "[]]")
(here / "numbers.json").write_text("[" + "1," * 3_900_000 + "1]")
name = "a" * 50_000_000
(here / "names.json").write_text('{"joints": [[1,2,3]], "joint_names": ["%s", "b"]}' % name)
(here / "rows.csv").write_text("a_x,a_y,a_z\\n" + "1,2,3\\n" * 1_000_000)
(here / "frames.skeleton").write_text("16000000\\n" + "0\\n" * 16_000_000)
for name, size in (("huge.trc", 300_000_000), ("sparse.npy", 5_000_000_000)):
    with open(here / name, "wb") as file:
        file.truncate(size)

for file in sorted(here.iterdir()):
    for name, reader in READERS.items():
        if reader.suffix == file.suffix:
            try:
                reader.read(file)
                print(file.name, name, "read")
            except ActionCliError as error:
                assert "memory" not in str(error), error
                print(file.name, name, "refused")
"""


def test_bombs_are_refused_in_little_memory_and_time(tmp_path: Path) -> None:
    tests = str(Path(__file__).parents[1])
    lines = run_limited(
        f"import sys; sys.path.insert(0, {tests!r})\n" + BOMBS, tmp_path, seconds=180
    )
    read = {line for line in lines if line.endswith("read")}
    # The longest clip that there may be is read.
    assert read <= {"classes.json splits read", "longest.npy npy read"}
    assert len(lines) > 45


HOURS = """
import sys
import numpy as np
from actioncli import Clip, ClipError, Recognizer, read_clip

example = read_clip(sys.argv[1])
recognizer = Recognizer()
for frames, fps in ((40_000, 30), (20_000, 0.5), (20_000, 1e-3), (20_000, 1e-300)):
    joints = np.resize(example.joints, (frames, *example.joints.shape[1:]))
    try:
        clip = Clip(joints, example.joint_names, fps)
    except ClipError as error:
        print(error)
        continue
    print(recognizer.classify(clip, {"bow": [example]}).part)
"""


def test_neither_hours_nor_rare_frames_fill_the_memory() -> None:
    """Each window of a long clip is embedded, and of one with rare frames there are as many as
    its time has room for."""
    example = Path(__file__).parents[2] / "examples" / "bow" / "ben.npz"
    *parts, refused = run_limited(HOURS, example, seconds=120)
    assert len(parts) == 3
    assert refused.startswith("fps must be")


@pytest.mark.parametrize("suffix", [".npy", ".npz", ".safetensors", ".json"])
def test_a_pickle_is_never_run(tmp_path: Path, suffix: str) -> None:
    class Evil:
        def __reduce__(self) -> tuple[Callable[..., Any], tuple[str]]:
            return os.mkdir, (str(tmp_path / "pwned"),)

    objects = np.array([Evil()], dtype=object)
    file = tmp_path / f"a{suffix}"
    buffer = io.BytesIO()
    np.save(buffer, objects, allow_pickle=True)
    if suffix == ".npz":
        with zipfile.ZipFile(file, "w") as archive:
            archive.writestr("joints.npy", buffer.getvalue())
            archive.writestr("joints_mm.npy", buffer.getvalue())
    else:
        file.write_bytes(buffer.getvalue() if suffix == ".npy" else pickle.dumps(Evil()))
    for reader in READERS.values():
        if reader.suffix == suffix:
            with pytest.raises(ActionCliError):
                reader.read(file)
    assert not (tmp_path / "pwned").exists()


@pytest.mark.parametrize("name", ["../../evil.npy", "/tmp/evil.npy", "..\\evil.npy", "C:evil.npy"])
def test_names_in_an_archive_are_never_files(tmp_path: Path, name: str) -> None:
    inner = tmp_path / "a" / "b"
    inner.mkdir(parents=True)
    file = inner / "a.npz"
    buffer = io.BytesIO()
    np.save(buffer, np.arange(90.0).reshape(2, 15, 3))
    with zipfile.ZipFile(file, "w") as archive:
        archive.writestr(name, buffer.getvalue())
    before = sorted(tmp_path.rglob("*"))
    read_clip(file, layout="default_15", unit="m", up="y")
    with pytest.raises(ClipError):
        read_collection(file)
    assert sorted(tmp_path.rglob("*")) == before


def weights_with(tmp_path: Path, config: str, metadata: str = "{}", tensors: str = "{}") -> Path:
    file = tmp_path / "w.safetensors"
    file.write_bytes(
        _with_zeros(_pack_weights([config.encode(), metadata.encode(), tensors.encode()]))
    )
    return file


SMALL = ModelConfig(
    Preparation(joints=("pelv", "neck"), frames=2), width=1, key_width=1, tuple_width=1
)


@pytest.mark.parametrize(
    "change",
    [
        {"width": 10**9}, {"width": -1}, {"width": "256"}, {"width": True}, {"width": 1.5},
        {"key_width": [1]}, {"tuple_width": None}, {"warp_width": 4}, {"method": "none"},
        {"surprise": 1}, {"preparation": []}, {"preparation": {}},
        {"frames": 10**9}, {"frames": 1}, {"joints": []}, {"joints": "pelv"},
        {"joints": ["neck", "head"]}, {"joints": ["pelv", "pelv"]}, {"joints": [1, "pelv"]},
        {"joints": ["pelv"] + [f"j{n}" for n in range(2000)]}, {"size": "large"},
        {"size": "standard"}, {"heading": True}, {"heading": 0}, {"motion": 2},
        {"motion": float("nan")},
    ],
    ids=lambda change: str(change)[:40],
)  # fmt: skip
def test_configurations_that_make_no_model_are_refused(
    tmp_path: Path, change: dict[str, Any]
) -> None:
    config = asdict(SMALL)
    # What belongs to the preparation is changed there.
    (config["preparation"] if change.keys() <= config["preparation"].keys() else config).update(
        change
    )
    with pytest.raises(WeightsError, match="configuration that this version cannot read"):
        read_weights(weights_with(tmp_path, json.dumps(config)))


def test_json_in_weights_that_nests_for_ever_is_refused(tmp_path: Path) -> None:
    deep = "[" * 100_000 + "]" * 100_000
    for config, metadata in ((deep, "{}"), (config_to_json(SMALL), deep)):
        with pytest.raises(WeightsError):
            read_weights(weights_with(tmp_path, config, metadata))


@pytest.mark.parametrize("value", [np.nan, np.inf])
def test_weights_are_finite_numbers(tmp_path: Path, value: float) -> None:
    tensors = {name: np.zeros(shape, "f4") for name, shape in parameter_shapes(SMALL).items()}
    file = tmp_path / "w.safetensors"
    write_weights(file, SMALL, tensors, {})
    read_weights(file)
    tensors["disc.2.bias"][:] = value
    write_weights(file, SMALL, tensors, {})
    with pytest.raises(WeightsError, match="no finite numbers"):
        read_weights(file)
    whole = {name: tensor.astype("i8") for name, tensor in tensors.items() if name != "disc.2.bias"}
    write_weights(file, SMALL, whole | {"disc.2.bias": np.zeros(1, "i8")}, {})
    with pytest.raises(WeightsError, match="no weights"):
        read_weights(file)


@pytest.mark.parametrize("name", READERS)
def test_a_pipe_keeps_nobody_waiting(tmp_path: Path, name: str) -> None:
    pipe = tmp_path / f"a{READERS[name].suffix}"
    os.mkfifo(pipe)
    with pytest.raises(ActionCliError, match=r"a regular file|ordinary file"):
        READERS[name].read(pipe)


@pytest.mark.filterwarnings("ignore:(overflow|invalid value) encountered:RuntimeWarning")
def test_weights_beyond_all_measure_give_an_error_and_no_score(tmp_path: Path) -> None:
    tensors = {name: np.full(s, 3e38, "f4") for name, s in parameter_shapes(SMALL).items()}
    write_weights(tmp_path / "w.safetensors", SMALL, tensors, {})
    joints = np.arange(90.0).reshape(6, 5, 3)
    clip = Clip(joints, ["lhip", "rhip", "lsho", "rsho", "head"])
    with pytest.raises(WeightsError, match="no numbers"):
        Recognizer(tmp_path / "w.safetensors").classify(clip, {"a": [clip]})
