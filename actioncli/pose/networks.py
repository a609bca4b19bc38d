"""The BlazePose networks as ONNX Runtime sessions."""

from __future__ import annotations

import hashlib
import os
from functools import cache

import numpy as np

from actioncli.clips.clip import FloatArray
from actioncli.errors import WeightsError
from actioncli.files import CHECKSUMS, listed_checksums, own_cores, weights_file

# From 1.29 on, ONNX Runtime sends Microsoft what computer this is and which networks run on it, and
# keeps an identifier for that. It reads this once, when it is loaded.
os.environ["ORT_DISABLE_TELEMETRY"] = "1"

import onnxruntime

# On Windows, and where somebody loaded it before.
onnxruntime.disable_telemetry_events()

DETECTOR = "pose_detector.onnx"
LANDMARKS = {"fast": "pose_landmark_full.onnx", "accurate": "pose_landmark_heavy.onnx"}
HAND_CROP, HAND_LANDMARKS = "hand_recrop.onnx", "hand_landmark_full.onnx"

# More threads than this gain nothing on networks of this size.
MOST_THREADS = 4


class Network:
    """One network, ready to run."""

    def __init__(self, name: str, threads: int | None = None) -> None:
        """Check the file against the shipped checksum and load it.

        Args:
            name: a file in the weights folder.
            threads: at most this many; None: see `usable_cores`.

        Raises:
            WeightsError: the file is missing or damaged.
        """
        path, shipped = weights_file(name), shipped_checksum(name)
        try:
            data = path.read_bytes()
        except OSError as error:
            raise WeightsError(
                f"{path}: cannot read the pose network: {error.strerror}. Reinstall actioncli."
            ) from error
        if hashlib.sha256(data).hexdigest() != shipped:
            raise WeightsError(
                f"{path}: the file differs from what {CHECKSUMS} lists. Reinstall actioncli."
            )
        options = onnxruntime.SessionOptions()
        options.intra_op_num_threads = threads or min(usable_cores(), MOST_THREADS)
        options.inter_op_num_threads = 1
        # Threads wait for one another without sleeping while the network runs, and sleep when it
        # has run: decoding beside it must have their cores then.
        options.add_session_config_entry("session.intra_op.allow_spinning", "1")
        options.add_session_config_entry("session.force_spinning_stop", "1")
        self._session = onnxruntime.InferenceSession(
            data, options, providers=["CPUExecutionProvider"]
        )
        self._outputs = [output.name for output in self._session.get_outputs()]

    def __call__(self, image: FloatArray) -> dict[str, FloatArray]:
        """Run on an image (H, W, 3), RGB in the network's range; outputs by name."""
        results = self._session.run(self._outputs, {"image": image[np.newaxis]})
        return dict(zip(self._outputs, results, strict=True))


@cache
def shipped_checksum(name: str) -> str:
    """SHA-256 that the weights folder lists for a file, hexadecimal.

    Raises:
        WeightsError: the list is missing or lacks the file.
    """
    sums = weights_file(CHECKSUMS)
    try:
        return listed_checksums(sums)[name]
    except (OSError, ValueError) as error:
        raise WeightsError(
            f"{sums}: cannot read the checksums of the pose networks: "
            f"{getattr(error, 'strerror', error)}. Reinstall actioncli."
        ) from error
    except KeyError as error:
        raise WeightsError(f"{sums} does not list {name}. Reinstall actioncli.") from error


def usable_cores() -> int:
    """Processor cores this process may run on, and is to use: `OMP_NUM_THREADS` says so to all that
    computes, and Ray sets it for its workers."""
    cores = len(own_cores())
    told = os.environ.get("OMP_NUM_THREADS", "")
    return min(cores, int(told)) if told.isdecimal() and int(told) else cores


def sigmoid(logits: FloatArray) -> FloatArray:
    """Logistic function; beyond +-80 float32 shows no difference."""
    return np.asarray(1 / (1 + np.exp(-logits.clip(-80, 80))), np.float32)
