import shutil
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pytest

from actioncli import files
from actioncli.errors import WeightsError
from actioncli.pose import networks


@pytest.fixture
def copied(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    """A folder of weights that may be damaged, with the detector in it."""
    for name in (networks.DETECTOR, networks.CHECKSUMS):
        shutil.copy(files.weights_folder() / name, tmp_path / name)
    monkeypatch.setattr(files, "weights_folder", lambda: tmp_path)
    networks.shipped_checksum.cache_clear()
    yield tmp_path
    networks.shipped_checksum.cache_clear()


def test_runs(copied: Path) -> None:
    network = networks.Network(networks.DETECTOR, threads=1)
    output = network(np.zeros((224, 224, 3), np.float32))
    assert {name: array.shape for name, array in output.items()} == {
        "boxes": (1, 2254, 12),
        "scores": (1, 2254, 1),
    }


@pytest.mark.parametrize(
    ("damage", "message"),
    [
        (lambda folder: (folder / networks.DETECTOR).unlink(), "is missing"),
        (lambda folder: (folder / networks.DETECTOR).write_bytes(b"x"), "differs from"),
        (lambda folder: (folder / networks.CHECKSUMS).unlink(), "is missing"),
        (
            lambda folder: (folder / networks.CHECKSUMS).write_bytes(b"\xff"),
            "cannot read the check",
        ),
        (lambda folder: (folder / networks.CHECKSUMS).write_text(""), "does not list"),
    ],
)
def test_damage_is_told(copied: Path, damage: Callable[[Path], object], message: str) -> None:
    damage(copied)
    with pytest.raises(WeightsError, match=rf"{message}.*(Reinstall|Install it again)"):
        networks.Network(networks.DETECTOR)


def test_threads_are_as_many_as_cores_or_as_told(monkeypatch: pytest.MonkeyPatch) -> None:
    for told in ("", "0", "many", "-1", "1000"):
        monkeypatch.setenv("OMP_NUM_THREADS", told)
        there = networks.usable_cores()
        assert there >= 1
    monkeypatch.delenv("OMP_NUM_THREADS")
    assert networks.usable_cores() == there
    monkeypatch.setenv("OMP_NUM_THREADS", "1")
    assert networks.usable_cores() == 1
