"""Nothing of this computer is told to anybody: libraries that would are kept from it."""

import os
import subprocess
import sys
from pathlib import Path

# Runs a network as a user does: `CI` alone would keep ONNX Runtime from telling.
PROGRAM = """
import numpy as np
from actioncli.pose.networks import LANDMARKS, Network
Network(LANDMARKS["fast"])(np.zeros((256, 256, 3), np.float32))
"""


def test_onnx_runtime_keeps_no_identifier_of_the_user(tmp_path: Path) -> None:
    """It is the first thing that it does before it sends anything."""
    unset = {"CI", "GITHUB_ACTIONS", "TF_BUILD", "ORT_DISABLE_TELEMETRY", "XDG_CACHE_HOME"}
    environment = {name: value for name, value in os.environ.items() if name not in unset}
    environment |= {"HOME": str(tmp_path), "LOCALAPPDATA": str(tmp_path)}
    root = Path(__file__).parents[2]
    done = subprocess.run(
        [sys.executable, "-c", PROGRAM],
        cwd=root,
        env=environment,
        capture_output=True,
        text=True,
        check=False,
        timeout=120,
    )
    assert (done.returncode, done.stderr) == (0, "")
    assert list(tmp_path.rglob("*")) == []
