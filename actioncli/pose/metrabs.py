"""MeTRAbs as pose estimator: a model that the user has downloaded, far larger than BlazePose.

I. Sarandi et al., "MeTRAbs: Metric-Scale Truncation-Robust Heatmaps for Absolute 3D Human Pose
Estimation", arXiv 2007.07227. Its weights are for non-commercial use only, so none come along.
Two releases are understood: the TensorFlow SavedModel, which needs TensorFlow, and the PyTorch
folder, which needs PyTorch and the authors' package `metrabs_pytorch`.
"""

from __future__ import annotations

import importlib
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from safetensors import SafetensorError

from actioncli.clips.clip import FloatArray
from actioncli.clips.skeleton import LAYOUTS
from actioncli.errors import WeightsError
from actioncli.pose.detector import Detection
from actioncli.pose.landmarks import Body
from actioncli.pose.region import Image, Region
from actioncli.pose.tracker import SAME_PERSON, Tracker

TERMS = "the weights of MeTRAbs are for non-commercial use only"
SKELETON = "smpl+head_30"
# The PyTorch release names the joints of all skeletons in one list, SMPL's with this ending.
_SMPL_ENDING = "_smpl"
_FIELD_OF_VIEW = 55  # degrees; of an ordinary camera, as the file tells none


@dataclass(frozen=True, slots=True)
class PoseModel:
    """A loaded model.

    Attributes:
        joint_names: J names in column order, as the model states them.
        detect: RGB image (H, W, 3) uint8 to poses (N, J, 3), millimetres in camera axes.
    """

    joint_names: tuple[str, ...]
    detect: Callable[[NDArray[np.uint8]], FloatArray]

    def tracker(self) -> Tracker:
        """What follows people through a video by this model."""
        seen = _Seen(self.detect)
        return Tracker(seen.people, seen.body, names=self.joint_names, notes=(TERMS,))


class _Seen:
    """All bodies in a picture at once, for a `Tracker`, which asks who is there and then for the
    body in a region: squares of the plane before the camera, millimetres, stand for regions."""

    def __init__(self, detect: Callable[[NDArray[np.uint8]], FloatArray]) -> None:
        self._detect = detect
        self._image: Image | None = None
        self._bodies: list[Body] = []

    def people(self, image: Image) -> list[Detection]:
        """Everybody."""
        return [Detection(1.0, Region.around(*body.ends)) for body in self._look(image)]

    def body(self, image: Image, region: Region) -> Body:
        """The body nearest to a region; if that is another one, it has no presence."""
        bodies = self._look(image) or [_body(np.zeros((1, 3), np.float32))]
        away = [Region.around(*body.ends).distance(region) for body in bodies]
        nearest = int(np.argmin(away))
        near = self._bodies and away[nearest] < SAME_PERSON
        return replace(bodies[nearest], presence=float(bool(near)))

    def _look(self, image: Image) -> list[Body]:
        if image is not self._image:
            self._image = image
            poses = self._detect(np.ascontiguousarray(image[:, :, ::-1]))
            self._bodies = [_body(np.asarray(pose, np.float32)) for pose in poses]
        return self._bodies


def _body(pose: FloatArray) -> Body:
    """A pose (J, 3), millimetres in camera axes."""
    points = pose[:, :2]
    middle = (points.min(axis=0) + points.max(axis=0)) / 2
    above = middle - (0, max(float(np.ptp(points, axis=0).max()), 1.0) / 2)
    ends = np.stack([middle, above]).astype(np.float32)
    return Body(1.0, points, np.ones(len(pose), np.float32), pose / np.float32(1000), ends)


@lru_cache(1)
def load_model(path: Path) -> PoseModel:
    """Load either release.

    Raises:
        WeightsError: the folder holds neither, or what loading needs is not installed.
    """
    if (path / "saved_model.pb").is_file():
        return _load_tensorflow(path)
    if (path / "joint_info.npz").is_file():
        if (path / "ckpt.safetensors").is_file():
            return _load_pytorch(path)
        if (path / "ckpt.pt").is_file():
            raise WeightsError(
                f"{path / 'ckpt.pt'}: is a pickle, which actioncli never reads. Make "
                'ckpt.safetensors of it once, in its folder: python -c "import torch, '
                "safetensors.torch as s; s.save_file(torch.load('ckpt.pt', map_location='cpu', "
                "weights_only=True), 'ckpt.safetensors')\""
            )
    raise WeightsError(
        f"{path}: is no MeTRAbs model. --pose-model names the folder of a release: the one with "
        "saved_model.pb (TensorFlow), or the one with joint_info.npz and the network made "
        "into ckpt.safetensors (PyTorch)."
    )


def _load_tensorflow(path: Path) -> PoseModel:
    try:
        tensorflow = importlib.import_module("tensorflow")
    except ImportError as error:
        raise WeightsError(
            f"{path}: a SavedModel needs TensorFlow, which is not installed: pip install "
            "'actioncli[metrabs]'."
        ) from error
    try:
        model = tensorflow.saved_model.load(str(path))
        names = model.per_skeleton_joint_names[SKELETON].numpy()
    except (OSError, ValueError, AttributeError, KeyError) as error:
        raise WeightsError(
            f"{path}: is no MeTRAbs model with the skeleton {SKELETON}: {error}"
        ) from error

    def detect(image: NDArray[np.uint8]) -> FloatArray:
        found = model.detect_poses(
            tensorflow.convert_to_tensor(image),
            skeleton=SKELETON,
            default_fov_degrees=_FIELD_OF_VIEW,
        )
        return np.asarray(found["poses3d"].numpy(), np.float32)

    return PoseModel(tuple(name.decode() for name in names), detect)


def _load_pytorch(path: Path) -> PoseModel:
    """Build the model as its authors' package does, but without unpickling anything.

    Their folder keeps the network and the skeletons in pickles, which could run code: the
    network is read from `ckpt.safetensors`, which users make of it, and the joints of SMPL are
    told by the names in `joint_info.npz` as well.
    """
    try:
        torch = importlib.import_module("torch")
        safetensors = importlib.import_module("safetensors.torch")
        efficientnet = importlib.import_module("metrabs_pytorch.backbones.efficientnet")
        metrabs = importlib.import_module("metrabs_pytorch.models.metrabs")
        multiperson = importlib.import_module("metrabs_pytorch.multiperson.multiperson_model")
        util = importlib.import_module("metrabs_pytorch.util")
        joint_info = importlib.import_module("posepile.joint_info")
    except ImportError as error:
        raise WeightsError(
            f"{path}: this model needs PyTorch and its authors' packages metrabs_pytorch and "
            f"posepile, and {error.name} is not installed. The SavedModel release needs "
            "TensorFlow only."
        ) from error
    try:
        with np.load(path / "joint_info.npz", allow_pickle=False) as stored:
            info = joint_info.JointInfo(stored["joint_names"], stored["joint_edges"])
            skeleton = _smpl_skeleton([str(name) for name in stored["joint_names"]], path)
        transform = np.load(path / "joint_transform_matrix.npy", allow_pickle=False)
        config = util.get_config(str((path / "config.yaml").resolve()))
        network = getattr(efficientnet, f"efficientnet_v2_{config.efficientnet_size}")()
        backbone = torch.nn.Sequential(efficientnet.PreprocLayer(), network.features)
        crop_model = metrabs.Metrabs(backbone, info).eval()
        with torch.inference_mode():  # the first call makes the layers that are sized by use
            size = int(config.proc_side)
            crop_model((torch.zeros((1, 3, size, size)), torch.eye(3)[None]))
        state = safetensors.load_file(path / "ckpt.safetensors")
        crop_model.load_state_dict(state)
        model = multiperson.Pose3dEstimator(crop_model, {"smpl_24": skeleton}, transform)
    except (
        OSError, ValueError, KeyError, AttributeError, RuntimeError, SafetensorError
    ) as error:  # fmt: skip
        raise WeightsError(f"{path}: the MeTRAbs model cannot be loaded: {error}") from error

    def detect(image: NDArray[np.uint8]) -> FloatArray:
        with torch.inference_mode():
            found = model.detect_poses(
                torch.from_numpy(image).permute(2, 0, 1),
                skeleton="smpl_24",
                default_fov_degrees=_FIELD_OF_VIEW,
            )
        return np.asarray(found["poses3d"].cpu().numpy(), np.float32)

    return PoseModel(tuple(model.per_skeleton_joint_names["smpl_24"]), detect)


def _smpl_skeleton(names: list[str], path: Path) -> Mapping[str, Any]:
    """Columns, names and (unused) edges of SMPL's joints, in the order of the model."""
    wanted = {joint + _SMPL_ENDING: joint for joint in LAYOUTS["smpl_24"]}
    found = {wanted[name]: column for column, name in enumerate(names) if name in wanted}
    missing = [joint for joint in wanted.values() if joint not in found]
    if missing:
        raise WeightsError(
            f"{path}: joint_info.npz lacks {missing[0]}{_SMPL_ENDING}; it names "
            f"{', '.join(names[:6])} and so on. Is it another release?"
        )
    return {"indices": list(found.values()), "names": list(found), "edges": [[0, 1]]}
