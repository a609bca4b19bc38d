"""Make the corpus's seeds from generated data: python tests/fuzz/seeds.py

What fuzzing found since lies beside them under names that say what it was, and is kept.
"""

import json
import sqlite3
import sys
import tempfile
from collections.abc import Callable
from contextlib import closing
from math import prod
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1]))

from clips.bodies import (
    kinect_v2,
    waving,
    write_bvh,
    write_c3d,
    write_csv,
    write_json,
    write_npy,
    write_npz,
    write_ntu,
    write_trc,
)

from actioncli.clips.clip import Clip
from actioncli.clips.prepare import Preparation
from actioncli.clips.skeleton import DEFAULT_JOINTS, LAYOUTS
from actioncli.model.config import ModelConfig, config_to_json
from actioncli.model.trx_os import parameter_shapes
from actioncli.recognition.threshold import Threshold, keep_threshold
from actioncli.store.store import SupportStore
from fuzz.readers import CORPUS, READERS, _pack_weights

BODY = waving(9)[1:4].round(2)


def main() -> None:
    """Write every seed."""
    for name in READERS:
        (CORPUS / name).mkdir(parents=True, exist_ok=True)
    two = np.stack([BODY, BODY + 1], axis=1)
    array = waving(9, LAYOUTS["smpl_24"])[1:4].astype(np.float16)
    _renamed("npy/seed.npy", lambda file: write_npy(file, array))
    _renamed("npz/seed.npz", lambda file: write_npz(file, two.astype("f2"), fps=30.0, unit="m"))
    write_json(CORPUS / "json/seed", BODY, fps=30, unit="m", up="y")
    frames = [{"lsho": [0, at, 2], "rsho": {"x": 1, "y": 1, "z": 2}} for at in (0, 1)]
    (CORPUS / "json/seed-frames").write_text(json.dumps({"frames": frames, "unit": "m"}))
    people = [[[[0, 0, 1]] * 24], [[[0, 1, 1]] * 24, [[1, 0, None]] * 24]]
    (CORPUS / "json/seed-people").write_text(json.dumps(people))
    write_csv(CORPUS / "csv/seed", BODY)
    table = "time (ms);id;a.X (mm);a.Y (mm);a.Z (mm);a_visibility\n"
    rows = "".join(f'{33 * row};{who};1,5;"2";{row};0.5\n' for row in range(3) for who in "12")
    (CORPUS / "csv/seed-people").write_text(table + rows)
    write_ntu(CORPUS / "ntu/seed", [[("1", frame), ("2", frame + 1)] for frame in kinect_v2(BODY)])
    write_trc(CORPUS / "trc/seed", BODY)
    write_bvh(CORPUS / "bvh/seed", BODY)
    _renamed("c3d/seed.c3d", lambda file: write_c3d(file, BODY))
    _renamed("collection/seed.npz", lambda file: np.savez(
        file, joints_mm=(1000 * np.concatenate([BODY, BODY])).astype(np.int16),
        lengths=np.array([3, 3]), labels=np.array(["a", "b"]), subjects=np.array(["s", "s"]),
        joint_names=np.array(DEFAULT_JOINTS), fps=np.float32(30),
        visibility=np.full((6, 15), 90, np.uint8),
    ))  # fmt: skip
    with tempfile.TemporaryDirectory() as folder:
        store = SupportStore(Path(folder, "support.db"))
        names = ["lsho", "rsho"]
        seen = np.full((3, 2), 0.5)
        store.enroll("wave", Clip(BODY[:, :2], names, 25.0, seen, "a.npz"), note="left")
        store.enroll("noise", Clip(BODY[:, 3:4], ["joint"], source="b.csv"), negative=True)
        store.export(Path(folder, "export"))
        (CORPUS / "archive/seed").write_bytes(Path(folder, "export").read_bytes())
        keep_threshold(store, Threshold(0.4, "a" * 64, {"wave": 0.3}))
        store.export(Path(folder, "export"))
        (CORPUS / "archive/seed-threshold").write_bytes(Path(folder, "export").read_bytes())
        store.keep_embeddings("a" * 64, {1: np.ones((1, 2), np.float32)})
        with closing(sqlite3.connect(store.path)) as database:
            # Small pages make a small file.
            database.execute("PRAGMA page_size = 512")
            database.execute("VACUUM")
        (CORPUS / "store/seed").write_bytes(store.path.read_bytes())
    (CORPUS / "weights/seed").write_bytes(_weights())
    splits = {"a": {"train": ["x"], "benchmark": ["y"]}, "b": {"excluded": ["z", "w"]}}
    (CORPUS / "splits/seed").write_text(json.dumps(splits))


def _weights() -> bytes:
    """The header of the smallest weights; `readers` adds tensors of zeros."""
    preparation = Preparation(joints=("pelv", "neck"), frames=2)
    config = ModelConfig(preparation, width=1, key_width=1, tuple_width=1)
    header, at = {}, 0
    for name, shape in parameter_shapes(config).items():
        size = 2 * prod(shape)
        header[name] = {"dtype": "F16", "shape": shape, "data_offsets": [at, at + size]}
        at += size
    return _pack_weights(
        [config_to_json(config).encode(), b'{"seed": 1}', json.dumps(header).encode()]
    )


def _renamed(name: str, write: Callable[[Path], object]) -> None:
    """numpy adds a suffix to names that lack it; the corpus has none."""
    file = CORPUS / name
    write(file)
    file.rename(file.with_suffix(""))


if __name__ == "__main__":
    main()
