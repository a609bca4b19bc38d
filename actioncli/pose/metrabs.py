"""MeTRAbs as pose estimator: a model that the user has downloaded, far larger than BlazePose.

I. Sarandi et al., "MeTRAbs: Metric-Scale Truncation-Robust Heatmaps for Absolute 3D Human Pose
Estimation", arXiv 2007.07227. Its weights are for non-commercial use only, so none come along.
Two releases are understood: the TensorFlow SavedModel, which needs TensorFlow, and the PyTorch
folder, which needs PyTorch and the authors' package `metrabs_pytorch`.
"""

from __future__ import annotations

import importlib
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from safetensors import SafetensorError

from actioncli.clips.active import action_in
from actioncli.clips.clip import Clip, FloatArray
from actioncli.clips.edit import cut, resample
from actioncli.clips.skeleton import LAYOUTS
from actioncli.errors import ClipError, WeightsError
from actioncli.pose.frames import VideoFile
from actioncli.pose.poses import LONGEST_GAP
from actioncli.pose.video import LEAST_PRESENT, SAMPLING_RATE, Progress

TERMS = "the weights of MeTRAbs are for non-commercial use only"
SKELETON = "smpl+head_30"
# The PyTorch release names the joints of all skeletons in one list, SMPL's with this ending.
_SMPL_ENDING = "_smpl"
_FIELD_OF_VIEW = 55  # degrees; of an ordinary camera, as the file tells none
# A pose nearer than this (metres, mean of the joints) to a person's last one is that person's.
_SAME_PERSON = 0.6
_TO_CLIP = np.array([-1, -1, 1]) / 1000  # camera axes in millimetres to a clip's in metres


@dataclass(frozen=True, slots=True)
class PoseModel:
    """A loaded model.

    Attributes:
        joint_names: J names in column order, as the model states them.
        detect: RGB image (H, W, 3) uint8 to poses (N, J, 3), millimetres in camera axes.
    """

    joint_names: tuple[str, ...]
    detect: Callable[[NDArray[np.uint8]], FloatArray]


@dataclass(eq=False)
class _Person:
    times: list[float] = field(default_factory=list)
    poses: list[FloatArray] = field(default_factory=list)

    def motion(self) -> float:
        steps = np.diff(np.stack(self.poses), axis=0) if len(self.poses) > 1 else np.zeros(1)
        return float(np.abs(steps).sum())


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


def read_metrabs_clip(
    path: str | Path,
    model: PoseModel,
    start: float | None = None,
    end: float | None = None,
    person: int | None = None,
    progress: Callable[[Progress], None] | None = None,
) -> Clip:
    """Read the skeleton of one person from a video; arguments as in `read_video_clip`.

    Returns:
        A clip in the model's own layout, without confidence.

    Raises:
        ClipError: not a video, or no person in most of its frames.
    """
    file = Path(path)
    video = VideoFile(file)
    begin, stop = start or 0.0, np.inf if end is None else end
    people: list[_Person] = []
    looked: list[float] = []
    for frame in video.frames(begin, stop, SAMPLING_RATE):
        looked.append(frame.time)
        _assign(people, model.detect(np.ascontiguousarray(frame.image[:, :, ::-1])), frame.time)
        if progress is not None:
            seconds = frame.time - begin
            total = max(min(stop, video.duration) - begin, seconds)
            progress(Progress(len(looked), seconds, total))
    chosen, notes = _choose(people, person, file)
    if len(looked) < 2 or len(chosen.times) < max(2, LEAST_PRESENT * len(looked)):
        raise ClipError(
            f"{file}: a person was found in {len(chosen.times)} of {len(looked)} frames; most "
            "must show one. Narrow the time down with --start and --end."
        )
    if shortfall := video.shortfall():
        notes.append(shortfall)
    clip = _clip(chosen, model.joint_names, looked, file, notes)
    if start is not None or end is not None:
        return clip
    first, last, repetitions = action_in(clip)
    part = cut(clip, first, last)
    if len(part) == len(clip):
        return clip
    offset = chosen.times[0]
    used = f"used {first + offset:.1f} s to {last + offset:.1f} s"
    if repetitions > 1:
        used += f", one of about {repetitions} repetitions"
    told = [*part.notes, used]
    return Clip(part.joints, part.joint_names, part.fps, None, part.source, told, part.start)


def _assign(people: list[_Person], poses: FloatArray, time: float) -> None:
    """Give each pose of a frame to the person whose last pose is nearest, or to a new one."""
    free = list(people)
    for pose in poses * _TO_CLIP:
        away = [float(np.linalg.norm(pose - p.poses[-1], axis=1).mean()) for p in free]
        nearest = int(np.argmin(away)) if away else -1
        alone = len(poses) == 1 and len(people) == 1
        if nearest >= 0 and (away[nearest] < _SAME_PERSON or alone):
            person = free.pop(nearest)
        else:
            person = _Person()
            people.append(person)
        person.times.append(time)
        person.poses.append(np.asarray(pose, np.float32))


def _choose(people: list[_Person], person: int | None, file: Path) -> tuple[_Person, list[str]]:
    longest = max((len(p.times) for p in people), default=0)
    if not longest:
        raise ClipError(f"{file}: no person was found in any frame.")
    # From the left of the picture, where clips have the larger x.
    known = sorted(
        (p for p in people if len(p.times) >= 0.3 * longest), key=lambda p: -p.poses[0][:, 0].mean()
    )
    if person is not None and not 1 <= person <= len(known):
        raise ClipError(f"{file}: there is no person {person}; {len(known)} can be followed.")
    chosen = max(known, key=_Person.motion) if person is None else known[person - 1]
    number = known.index(chosen) + 1
    told = f"followed person {number} of {len(known)} from the left"
    return chosen, [told] if len(known) > 1 else []


def _clip(
    person: _Person, names: tuple[str, ...], looked: list[float], file: Path, notes: list[str]
) -> Clip:
    times = np.array(person.times)
    step = (looked[-1] - looked[0]) / (len(looked) - 1)
    even = np.arange(times[0], times[-1] + step / 2, step).clip(max=times[-1])
    gaps = np.flatnonzero(np.diff(times) > LONGEST_GAP)
    lost = [f"nobody was seen from {times[g]:.1f} s to {times[g + 1]:.1f} s" for g in gaps]
    joints = resample(np.stack(person.poses), times, even)
    told = [*notes, *lost, TERMS]
    return Clip(joints, names, 1 / step, None, str(file), told, float(times[0]))


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
