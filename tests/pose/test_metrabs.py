import sys
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pytest

from actioncli.clips.clip import Clip
from actioncli.clips.skeleton import LAYOUTS, default_columns
from actioncli.errors import ClipError, WeightsError
from actioncli.pose import ReadOptions, metrabs
from actioncli.pose.metrabs import TERMS, PoseModel, load_model
from actioncli.pose.read import read_any

from .videos import number, numbered, write_video

SMPL = LAYOUTS["smpl_24"]

# The authors' packages, as far as loading uses them: the same names, signatures and steps, with
# a network of a few weights.
POSEPILE = """
class JointInfo:
    def __init__(self, names, edges):
        self.names, self.stick_figure_edges = list(names), [tuple(edge) for edge in edges]
"""
UTIL = """
import pathlib, types
def get_config(path=None):
    keys = dict(line.split(': ') for line in pathlib.Path(path).read_text().splitlines())
    return types.SimpleNamespace(efficientnet_size=keys['efficientnet_size'],
                                 proc_side=int(keys['proc_side']))
"""
EFFICIENTNET = """
import torch
class PreprocLayer(torch.nn.Module):
    def forward(self, image):
        return image * 2 - 1
class Small(torch.nn.Module):
    def __init__(self):
        super().__init__()
        self.features = torch.nn.Conv2d(3, 4, 3)
def efficientnet_v2_s():
    return Small()
"""
METRABS = """
import torch
class Metrabs(torch.nn.Module):
    def __init__(self, backbone, joint_info):
        super().__init__()
        self.backbone, self.joint_names = backbone, joint_info.names
        self.head = torch.nn.LazyLinear(len(joint_info.names) * 3)
    def forward(self, inputs):
        image, intrinsics = inputs
        return self.head(self.backbone(image).mean(dim=(2, 3))).reshape(len(image), -1, 3)
"""
MULTIPERSON = """
import torch
class Pose3dEstimator(torch.nn.Module):
    def __init__(self, crop_model, skeleton_infos, joint_transform_matrix):
        super().__init__()
        self.crop_model = crop_model
        self.transform = torch.tensor(joint_transform_matrix, dtype=torch.float32)
        self.indices = {k: torch.tensor(v['indices']) for k, v in skeleton_infos.items()}
        self.per_skeleton_joint_names = {k: v['names'] for k, v in skeleton_infos.items()}
    def detect_poses(self, image, default_fov_degrees=55, skeleton='', num_aug=5):
        assert image.dtype == torch.uint8 and image.shape[0] == 3
        poses = self.crop_model((image[None].float() / 255, torch.eye(3)[None]))
        poses = torch.einsum('bnk,nN->bNk', poses, self.transform)
        return {'poses3d': poses[:, self.indices[skeleton]]}
"""


@pytest.fixture
def packages(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    modules = {
        "posepile/joint_info.py": POSEPILE,
        "metrabs_pytorch/util.py": UTIL,
        "metrabs_pytorch/backbones/efficientnet.py": EFFICIENTNET,
        "metrabs_pytorch/models/metrabs.py": METRABS,
        "metrabs_pytorch/multiperson/multiperson_model.py": MULTIPERSON,
    }
    for name, code in modules.items():
        file = tmp_path / "packages" / name
        file.parent.mkdir(parents=True, exist_ok=True)
        file.write_text(code)
    monkeypatch.syspath_prepend(str(tmp_path / "packages"))
    yield
    for name in [name for name in sys.modules if name.startswith(("metrabs_pytorch", "posepile"))]:
        del sys.modules[name]


@pytest.fixture
def release(tmp_path: Path, packages: None) -> Path:
    """A folder with the files of the PyTorch release, made by the packages above."""
    torch = pytest.importorskip("torch")
    from metrabs_pytorch.backbones import efficientnet
    from metrabs_pytorch.models import metrabs
    from posepile.joint_info import JointInfo

    folder = tmp_path / "release"
    folder.mkdir()
    # Joints of another skeleton lie between those of SMPL, which are in another order.
    names = [f"{joint}_smpl" for joint in reversed(SMPL)] + ["nose_coco", "neck_coco"]
    np.savez(folder / "joint_info.npz", joint_names=names, joint_edges=[[0, 1], [1, 2]])
    np.save(folder / "joint_transform_matrix.npy", np.eye(len(names), dtype=np.float32))
    (folder / "config.yaml").write_text("efficientnet_size: s\nproc_side: 16\n")
    torch.manual_seed(0)
    network = torch.nn.Sequential(
        efficientnet.PreprocLayer(), efficientnet.efficientnet_v2_s().features
    )
    model = metrabs.Metrabs(network, JointInfo(names, [[0, 1]]))
    model((torch.zeros(1, 3, 16, 16), None))
    with torch.no_grad():
        model.head.weight *= 300
        # A standing body in camera axes: y down, millimetres.
        model.head.bias.copy_(torch.tensor(standing()[::-1].copy()).reshape(-1).float())
    from safetensors.torch import save_file

    save_file(model.state_dict(), folder / "ckpt.safetensors")
    return folder


def standing() -> np.ndarray:
    """(26, 3) so that, reversed, SMPL's joints come first; knees below hips, and so on."""
    body = np.zeros((26, 3))
    body[2:, 1] = np.linspace(900, -900, 24)
    body[2:, 0] = [{"l": 150, "r": -150}.get(joint[0], 0) for joint in SMPL]
    body[:, 2] = 3000
    return body


def moving(tmp_path: Path) -> Path:
    images = [np.full((32, 32, 3), 8 * n, np.uint8) for n in range(20)]
    return write_video(tmp_path / "a.mp4", images, 10)


def test_pytorch_release(release: Path, tmp_path: Path) -> None:
    model = load_model(release)
    assert set(model.joint_names) == set(SMPL)
    assert model.joint_names != SMPL  # in the order of the file
    clip = read_any(moving(tmp_path), ReadOptions(start=0, metrabs=release))
    assert clip.joints.shape == (20, 24, 3)
    assert clip.fps == pytest.approx(10, rel=1e-3)
    assert TERMS in clip.notes
    assert set(default_columns(clip.joint_names)) >= {"pelv", "lwri", "rank", "head"}
    poses = model.detect(np.zeros((32, 32, 3), np.uint8))
    # Half a turn about z, and millimetres to metres.
    np.testing.assert_allclose(
        clip.joints[0], poses[0] * [-1e-3, -1e-3, 1e-3], atol=0.02 * np.abs(poses).max() / 1000
    )


def joint_info(names: object) -> Callable[[Path], object]:
    """Replaces the names of a release."""
    return lambda folder: np.savez(
        folder / "joint_info.npz", joint_names=names, joint_edges=[[0, 0]]
    )


@pytest.mark.parametrize(
    ("damage", "message"),
    [
        (joint_info(["a_coco"]), "lacks pelv_smpl"),
        (joint_info(np.array([object()])), "cannot be loaded"),
        (lambda folder: (folder / "ckpt.safetensors").write_bytes(b"damaged"), "cannot be loaded"),
        (lambda folder: (folder / "ckpt.safetensors").rename(folder / "ckpt.pt"),
         r"is a pickle.*save_file"),
    ],
)  # fmt: skip
def test_another_or_a_damaged_release_is_told(
    release: Path, damage: Callable[[Path], object], message: str
) -> None:
    damage(release)
    with pytest.raises(WeightsError, match=message):
        load_model(release)


def test_without_the_packages(release: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    for name in [name for name in sys.modules if name.startswith(("metrabs_pytorch", "posepile"))]:
        monkeypatch.delitem(sys.modules, name)
    monkeypatch.setattr(sys, "path", [p for p in sys.path if not p.endswith("packages")])
    with pytest.raises(WeightsError, match=r"metrabs_pytorch.* is not installed"):
        load_model(release)


def test_saved_model(tmp_path: Path) -> None:
    tensorflow = pytest.importorskip("tensorflow", reason="TensorFlow is optional")
    names = LAYOUTS["smpl+head_30"]

    class Model(tensorflow.Module):
        def __init__(self) -> None:
            super().__init__()
            self.per_skeleton_joint_names = {"smpl+head_30": tensorflow.Variable(list(names))}

        @tensorflow.function(
            input_signature=[
                tensorflow.TensorSpec((None, None, 3), tensorflow.uint8),
                tensorflow.TensorSpec((), tensorflow.string),
                tensorflow.TensorSpec((), tensorflow.float32),
            ]
        )
        def detect_poses(self, image, skeleton, default_fov_degrees):
            tensorflow.debugging.assert_equal(skeleton, "smpl+head_30")
            light = tensorflow.reduce_mean(tensorflow.cast(image, tensorflow.float32))
            column = tensorflow.range(30.0)[:, None] * tensorflow.constant([[10.0, 30.0, 0.0]])
            return {"poses3d": (column * (1 + light / 255))[None]}

    tensorflow.saved_model.save(Model(), str(tmp_path / "model"))
    model = load_model(tmp_path / "model")
    assert model.joint_names == names
    clip = read_any(moving(tmp_path), ReadOptions(start=0, metrabs=tmp_path / "model"))
    assert clip.joints.shape == (20, 30, 3)
    np.testing.assert_allclose(clip.joints[0, 29, :2], [-0.29, -0.87], rtol=0.05)


def test_no_model_and_one_without_tensorflow(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    with pytest.raises(WeightsError, match="is no MeTRAbs model"):
        load_model(tmp_path)
    monkeypatch.setitem(sys.modules, "tensorflow", None)
    (tmp_path / "saved_model.pb").touch()
    with pytest.raises(WeightsError, match="needs TensorFlow"):
        load_model(tmp_path)


def people(image: np.ndarray) -> np.ndarray:
    """Two people: one who stays, and to the right of the picture one who goes up and down."""
    at = np.tile(np.linspace(-800, 800, 24)[:, None] * [0, 1, 0], (2, 1, 1)).astype(np.float32)
    at[0, :, 0], at[1, :, 0] = -1000, 1000
    at[1, :, 1] += 100 * np.sin(number(image))
    return at if number(image) % 2 else at[::-1]


def seen_by(
    monkeypatch: pytest.MonkeyPatch, detect: Callable[[np.ndarray], np.ndarray]
) -> Callable[..., Clip]:
    """What reads a video with a model that sees this."""
    monkeypatch.setattr(metrabs, "load_model", lambda folder: PoseModel(SMPL, detect))
    return lambda path, **more: read_any(path, ReadOptions(metrabs=Path("model"), **more))


def test_who_moves_most_is_followed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    read = seen_by(monkeypatch, people)
    path = write_video(tmp_path / "a.mp4", numbered(30), 10)
    clip = read(path, start=0)
    assert (clip.joints[..., 0] < 0).all()  # right in the picture is smaller x
    assert clip.confidence is None
    assert "followed person 2 of 2 from the left, who moves most; --person chooses" in clip.notes
    with pytest.raises(ClipError, match="distinct frames"):
        read(path, start=0, person=1)
    with pytest.raises(ClipError, match="no person 3"):
        read(path, person=3)


def test_who_was_gone_for_long_was_not_seen(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def seen(image: np.ndarray) -> np.ndarray:
        mover = people(image)[number(image) % 2 :][:1]
        return mover[:0] if 9 <= number(image) <= 15 else mover

    clip = seen_by(monkeypatch, seen)(write_video(tmp_path / "a.mp4", numbered(30), 10), start=0)
    assert clip.confidence is not None
    np.testing.assert_array_equal(np.flatnonzero(clip.confidence[:, 0] == 0), range(9, 16))
    assert any("nobody was seen from 0.8 s to 1.6 s" in note for note in clip.notes)


def test_nobody(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    read = seen_by(monkeypatch, lambda image: np.zeros((0, 24, 3), np.float32))
    with pytest.raises(ClipError, match="no person was found"):
        read(write_video(tmp_path / "a.mp4", numbered(5)))
