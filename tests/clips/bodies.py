"""A small moving person in canonical axes, and writers of every format that readers know."""

from __future__ import annotations

import importlib
import json
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from actioncli.clips.skeleton import DEFAULT_JOINTS, LAYOUTS, default_columns

Floats = NDArray[np.float64]

# A grown person who faces the sensor (looks along -z): the left side at smaller x.
STANCE = {
    "pelv": (0, 0, 0), "lhip": (-0.1, 0, 0), "rhip": (0.1, 0, 0),
    "lkne": (-0.11, -0.43, -0.02), "rkne": (0.11, -0.43, -0.02),
    "lank": (-0.12, -0.85, 0.01), "rank": (0.12, -0.85, 0.01),
    "neck": (0, 0.5, 0), "head": (0, 0.68, -0.03),
    "lsho": (-0.18, 0.5, 0), "rsho": (0.18, 0.5, 0),
    "lelb": (-0.22, 0.22, 0), "relb": (0.22, 0.22, 0),
    "lwri": (-0.24, -0.02, -0.03), "rwri": (0.24, -0.02, -0.03),
}  # fmt: skip
CENTRE = np.array([0.3, 0.1, 2.5])


def waving(frames: int = 40, joints: Sequence[str] = DEFAULT_JOINTS) -> Floats:
    """(T, J, 3) metres: a person before a sensor who raises and waves the left arm."""
    time = np.linspace(0, 2 * np.pi, frames)
    body = np.tile(np.array([STANCE[joint] for joint in DEFAULT_JOINTS]), (frames, 1, 1))
    sway = 0.02 * np.sin(time)[:, None]
    body[:, :, 0] += sway
    swing = 0.6 * np.sin(2 * time)
    elbow = body[:, DEFAULT_JOINTS.index("lsho")] + np.stack(
        [-0.28 * np.cos(swing), 0.28 * np.sin(swing), 0 * time], axis=1
    )
    wrist = elbow + np.stack([-0.05 * np.sin(swing), 0.25 * np.cos(swing), -0.02 + 0 * time], 1)
    body[:, DEFAULT_JOINTS.index("lelb")] = elbow
    body[:, DEFAULT_JOINTS.index("lwri")] = wrist
    return in_layout(body + CENTRE, joints)


def in_layout(body: Floats, names: Sequence[str]) -> Floats:
    """The 15 default joints in the columns of a layout; other joints a little beside the neck."""
    neck = body[:, DEFAULT_JOINTS.index("neck")]
    placed = np.stack([neck + 0.01 * (column + 1) for column in range(len(names))], axis=1)
    columns = default_columns(names)
    for joint in DEFAULT_JOINTS:
        # Pelvis and neck are derived from hips and shoulders; a layout may name them too.
        for column in columns.get(joint, ()) if joint not in ("pelv", "neck") else ():
            placed[:, column] = body[:, DEFAULT_JOINTS.index(joint)]
    for joint in ("pelv", "neck"):
        if joint in names:
            placed[:, list(names).index(joint)] = body[:, DEFAULT_JOINTS.index(joint)]
    return placed


# File axes from canonical ones, for each axis that may point up; written from the meaning of the
# words, not from the code: the new axes' directions, seen in the old ones.
TO_FILE: dict[str, Callable[[Floats], Floats]] = {
    "y": lambda p: p,
    "-y": lambda p: np.stack([-p[..., 0], -p[..., 1], p[..., 2]], axis=-1),
    "z": lambda p: np.stack([p[..., 0], -p[..., 2], p[..., 1]], axis=-1),
    "-z": lambda p: np.stack([p[..., 0], p[..., 2], -p[..., 1]], axis=-1),
    "x": lambda p: np.stack([p[..., 1], -p[..., 0], p[..., 2]], axis=-1),
    "-x": lambda p: np.stack([-p[..., 1], p[..., 0], p[..., 2]], axis=-1),
}


def write_npy(file: Path, body: Floats) -> Path:
    np.save(file, body)
    return file


def write_npz(file: Path, body: Floats, **fields: object) -> Path:
    np.savez(file, poses3d=body, joint_names=np.array(DEFAULT_JOINTS), **fields)
    return file


def write_json(file: Path, body: Floats, **fields: object) -> Path:
    content = {"joints": body.tolist(), "joint_names": DEFAULT_JOINTS, **fields}
    file.write_text(json.dumps(content), encoding="utf-8")
    return file


def write_csv(
    file: Path, body: Floats, title: Callable[[str, str], str] = "{}_{}".format, sep: str = ","
) -> Path:
    header = [title(joint, axis) for joint in DEFAULT_JOINTS for axis in "xyz"]
    rows = [sep.join(f"{value:.6f}" for value in frame.ravel()) for frame in body]
    file.write_text("\n".join([sep.join(header), *rows]) + "\n", encoding="utf-8")
    return file


def write_trc(file: Path, body: Floats, unit: str = "m", rate: float = 60) -> Path:
    frames, joints = body.shape[:2]
    lines = [
        f"PathFileType\t4\t(X/Y/Z)\t{file.name}",
        "DataRate\tCameraRate\tNumFrames\tNumMarkers\tUnits\tOrigDataRate\t"
        "OrigDataStartFrame\tOrigNumFrames",
        f"{rate}\t{rate}\t{frames}\t{joints}\t{unit}\t{rate}\t1\t{frames}",
        "Frame#\tTime\t" + "\t\t\t".join(DEFAULT_JOINTS) + "\t\t",
        "\t\t" + "\t".join(f"{axis}{j + 1}" for j in range(joints) for axis in "XYZ"),
        "",
    ]
    for at, frame in enumerate(body):
        cells = ["" if np.isnan(value) else f"{value:.6f}" for value in frame.ravel()]
        lines.append("\t".join([str(at + 1), f"{at / rate:.6f}", *cells]))
    file.write_text("\n".join(lines) + "\n", encoding="utf-8")
    return file


def write_ntu(file: Path, bodies: Sequence[Sequence[tuple[str, Floats]]]) -> Path:
    """Frames of (tracking number, (25, 3) joints)."""
    lines = [str(len(bodies))]
    for frame in bodies:
        lines.append(str(len(frame)))
        for number, joints in frame:
            lines += [f"{number} 0 1 1 1 1 0 0.01 -0.02 2", str(len(joints))]
            lines += [f"{x:.6f} {y:.6f} {z:.6f} 1 2 3 4 0 0 0 1 2" for x, y, z in joints]
    file.write_text("\n".join(lines) + "\n", encoding="utf-8")
    return file


def write_bvh(file: Path, body: Floats, scale: float = 1.0) -> Path:
    """Every joint a child of the root with position channels: any pose without any angle."""
    names = list(DEFAULT_JOINTS)
    lines = ["HIERARCHY", "ROOT pelv", "{", "OFFSET 0 0 0"]
    lines.append("CHANNELS 6 Xposition Yposition Zposition Zrotation Xrotation Yrotation")
    for joint in names[1:]:
        x, y, z = (scale * value for value in STANCE[joint])
        lines += [f"JOINT {joint}", "{", f"OFFSET {x} {y} {z}"]
        lines += ["CHANNELS 3 Xposition Yposition Zposition"]
        lines += ["End Site", "{", "OFFSET 0 0.1 0", "}", "}"]
    lines += ["}", "MOTION", f"Frames: {len(body)}", "Frame Time: 0.0333333"]
    for frame in scale * body:
        values = [*frame[0], 0, 0, 0, *(frame[1:] - frame[0]).ravel()]
        lines.append(" ".join(f"{value:.6f}" for value in values))
    file.write_text("\n".join(lines) + "\n", encoding="utf-8")
    return file


def write_c3d(file: Path, body: Floats) -> Path:
    """With the library that reads them, in millimetres, z up."""
    ezc3d = importlib.import_module("ezc3d")
    content = ezc3d.c3d()
    point = content["parameters"]["POINT"]
    point["RATE"]["value"], point["UNITS"]["value"] = [100.0], ["mm"]
    point["LABELS"]["value"] = list(DEFAULT_JOINTS)
    points = np.ones((4, len(DEFAULT_JOINTS), len(body)))
    points[:3] = 1000 * TO_FILE["z"](body).transpose(2, 1, 0)
    content["data"]["points"] = points
    content.write(str(file))
    return file


def kinect_v2(body: Floats) -> Floats:
    """Default joints to the 25 of a Kinect v2."""
    return in_layout(body, LAYOUTS["kinect_v2_25"])
