"""Convert the BlazePose and hand networks from TensorFlow Lite to ONNX, and check against LiteRT.

The originals come out of two public packages, neither of which is a dependency: the wheel of
`mediapipe` 0.10.21 (detector, landmark network "full", both networks for hands) and the npm package
`@mediapipe/pose` 0.5.1675469404 (landmark network "heavy"). Needs `pip` and `npm` on the path, and
beside the project's own dependencies:

    pip install onnx ai-edge-litert
    python tools/convert_blazepose.py --images FOLDER

Written are the networks, licence, attribution and checksums, if every output agrees with
the original's to a ten-thousandth of its range. The files are the same to the byte on every run.
"""

from __future__ import annotations

import argparse
import hashlib
import os
import subprocess
import sys
import tarfile
import tempfile
import zipfile
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
from ai_edge_litert.interpreter import Interpreter, OpResolverType
from tflite_to_onnx import to_onnx

# As in `actioncli.pose.networks`: nothing of this computer is reported.
os.environ["ORT_DISABLE_TELEMETRY"] = "1"

import onnxruntime

MEDIAPIPE = "mediapipe==0.10.21"
MEDIAPIPE_POSE = "@mediapipe/pose@0.5.1675469404"


@dataclass(frozen=True)
class Network:
    """One network: where the original is, and what its tensors are called in ONNX."""

    target: str
    package: str
    member: str
    outputs: dict[str, str]  # TensorFlow Lite name to ours; outputs not named are cut off
    low: float  # the range of the input image
    high: float


_LANDMARK_OUTPUTS = {
    "Identity": "landmarks",
    "Identity_1": "presence",
    "Identity_3": "heatmap",
    "Identity_4": "world",
}
_HAND_OUTPUTS = {"Identity": "landmarks", "Identity_1": "presence", "Identity_3": "world"}
NETWORKS = (
    Network(
        "pose_detector.onnx",
        MEDIAPIPE,
        "mediapipe/modules/pose_detection/pose_detection.tflite",
        {"Identity": "boxes", "Identity_1": "scores"},
        -1.0,
        1.0,
    ),
    Network(
        "pose_landmark_full.onnx",
        MEDIAPIPE,
        "mediapipe/modules/pose_landmark/pose_landmark_full.tflite",
        _LANDMARK_OUTPUTS,
        0.0,
        1.0,
    ),
    Network(
        "hand_recrop.onnx",
        MEDIAPIPE,
        "mediapipe/modules/holistic_landmark/hand_recrop.tflite",
        {"output_crop": "crop"},
        0.0,
        1.0,
    ),
    Network(
        "hand_landmark_full.onnx",
        MEDIAPIPE,
        "mediapipe/modules/hand_landmark/hand_landmark_full.tflite",
        _HAND_OUTPUTS,
        0.0,
        1.0,
    ),
    Network(
        "pose_landmark_heavy.onnx",
        MEDIAPIPE_POSE,
        "package/pose_landmark_heavy.tflite",
        _LANDMARK_OUTPUTS,
        0.0,
        1.0,
    ),
)


def fetch(folder: Path) -> tuple[dict[str, bytes], str]:
    """Download both packages; return the originals by target name, and the licence text."""
    pip = [sys.executable, "-m", "pip", "download", "--quiet", "--no-deps", "-d", str(folder)]
    # The wheel's tag names a Python; its data files are the same in all of them.
    wheel_for = ["--python-version", "3.11", "--platform", "manylinux_2_28_x86_64"]
    subprocess.run([*pip, *wheel_for, "--only-binary=:all:", MEDIAPIPE], check=True)
    pack = ["npm", "pack", "--silent", "--pack-destination", str(folder), MEDIAPIPE_POSE]
    subprocess.run(pack, check=True, stdout=subprocess.DEVNULL)
    with (
        zipfile.ZipFile(next(folder.glob("*.whl"))) as wheel,
        tarfile.open(next(folder.glob("*.tgz"))) as tarball,
    ):
        originals = {}
        for network in NETWORKS:
            if network.package == MEDIAPIPE:
                originals[network.target] = wheel.read(network.member)
            else:
                member = tarball.extractfile(network.member)
                assert member is not None, network.member
                originals[network.target] = member.read()
        licence = wheel.read("mediapipe-0.10.21.dist-info/LICENSE").decode()
    # What follows the rule concerns a part of mediapipe that is not taken.
    return originals, licence.split("\n" + "=" * 75)[0].rstrip() + "\n"


def images(folder: Path | None, size: int) -> Iterator[np.ndarray]:
    """Test inputs in [0, 1]: noise, then every picture and some frames of every video."""
    random = np.random.default_rng(0)
    for _ in range(3):
        yield random.random((size, size, 3), np.float32)
    for path in sorted(folder.rglob("*")) if folder else ():
        capture = cv2.VideoCapture(str(path)) if path.is_file() else None
        for _ in range(3 if capture is not None else 0):
            read, frame = capture.read()
            if read:
                resized = cv2.resize(frame, (size, size), interpolation=cv2.INTER_AREA)
                yield resized[:, :, ::-1].astype(np.float32) / 255


def differences(original: bytes, converted: bytes, network: Network, folder: Path | None) -> str:
    """Largest difference of each output, beside its largest value, over all test inputs."""
    # Without the XNNPACK delegate, whose rounding differs more from LiteRT's own than ours does.
    plain = OpResolverType.BUILTIN_WITHOUT_DEFAULT_DELEGATES
    reference = Interpreter(
        model_content=original, num_threads=2, experimental_op_resolver_type=plain
    )
    reference.allocate_tensors()
    (image_input,) = reference.get_input_details()
    theirs = {d["name"]: d["index"] for d in reference.get_output_details()}
    session = onnxruntime.InferenceSession(converted, providers=["CPUExecutionProvider"])
    worst = dict.fromkeys(network.outputs.values(), 0.0)
    largest = dict.fromkeys(network.outputs.values(), 0.0)
    count = 0
    for image in images(folder, int(image_input["shape"][1])):
        count += 1
        batch = (image * (network.high - network.low) + network.low)[None]
        reference.set_tensor(image_input["index"], batch)
        reference.invoke()
        results = session.run(list(network.outputs.values()), {"image": batch})
        for (their_name, name), ours in zip(network.outputs.items(), results, strict=True):
            expected = reference.get_tensor(theirs[their_name])
            worst[name] = max(worst[name], float(np.abs(ours - expected).max()))
            largest[name] = max(largest[name], float(np.abs(expected).max()))
    for name in worst:
        if worst[name] > 1e-4 * max(largest[name], 1.0):
            raise SystemExit(f"{network.target}: {name} is off by {worst[name]:.3g}; not written.")
    report = ", ".join(f"{n} {worst[n]:.1e} of {largest[n]:.3g}" for n in worst)
    return f"{count} inputs: {report}"


NOTICE = """# The pose and hand networks

`pose_detector.onnx`, `pose_landmark_full.onnx`, `pose_landmark_heavy.onnx`, `hand_recrop.onnx` and
`hand_landmark_full.onnx` are networks of MediaPipe, copyright The MediaPipe Authors, under the
Apache License 2.0 (`BLAZEPOSE_LICENSE.txt`). The methods: V. Bazarevsky et al., "BlazePose:
On-device Real-time Body Pose tracking", arXiv 2006.10204; F. Zhang et al., "MediaPipe Hands:
On-device Real-time Hand Tracking", arXiv 2006.10214.

## What was changed

`tools/convert_blazepose.py` converted them from TensorFlow Lite to ONNX: the layout is NCHW
inside, padding is part of the convolutions, weights that the detector stores sparsely are dense,
the PReLU of `hand_recrop` is written as two convolutions, and the segmentation mask of the pose
landmark networks and the handedness of the hand's are cut off. The values of all weights are
unchanged, in half precision where the originals have them so. Inputs and outputs keep their shapes
and ranges (image (1, 224, 224, 3) in [-1, 1] for the detector, in [0, 1] for hand landmarks, and
(1, 256, 256, 3) in [0, 1] for the others) and have new names.

## Sources and checksums (SHA-256)

| file | original | package | of the original | of the file |
| --- | --- | --- | --- | --- |
"""


def write_checksums(folder: Path, changed: Sequence[str]) -> None:
    """Renew the lines of `changed` in SHA256SUMS and keep those of other files."""
    sums = folder / "SHA256SUMS"
    lines = sums.read_text().splitlines() if sums.exists() else []
    table = {name: digest for digest, name in (line.split("  ", 1) for line in lines)}
    for name in changed:
        table[name] = hashlib.sha256((folder / name).read_bytes()).hexdigest()
    sums.write_text("".join(f"{table[name]}  {name}\n" for name in sorted(table)))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    default = Path(__file__).parents[1] / "weights"
    parser.add_argument("--weights", type=Path, default=default, help="folder to write to")
    parser.add_argument("--images", type=Path, help="pictures or videos to check with")
    arguments = parser.parse_args()
    folder: Path = arguments.weights
    rows = []
    with tempfile.TemporaryDirectory() as scratch:
        originals, licence = fetch(Path(scratch))
    for network in NETWORKS:
        original = originals[network.target]
        converted = to_onnx(original, network.outputs)
        print(network.target, differences(original, converted, network, arguments.images))
        (folder / network.target).write_bytes(converted)
        sums = [hashlib.sha256(data).hexdigest() for data in (original, converted)]
        source = f"`{Path(network.member).name}` | `{network.package}`"
        rows.append(f"| `{network.target}` | {source} | `{sums[0]}` | `{sums[1]}` |\n")
    (folder / "BLAZEPOSE_LICENSE.txt").write_text(licence)
    (folder / "BLAZEPOSE_NOTICE.md").write_text(NOTICE + "".join(rows))
    texts = ["BLAZEPOSE_LICENSE.txt", "BLAZEPOSE_NOTICE.md"]
    write_checksums(folder, [network.target for network in NETWORKS] + texts)


if __name__ == "__main__":
    main()
