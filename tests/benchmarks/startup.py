"""Time to answer, whole process, against `python -c "import torch"`, medians of ten.

    python tests/benchmarks/startup.py

Rounds are interleaved, so that a busy machine slows all commands alike; the ratios are what
carries over to other machines. Needs the extra `dev`.
"""

import os
import statistics
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np

import actioncli

ROUNDS = 10
EXAMPLES = Path(__file__).parent.parent.parent / "examples"
ACTIONS = ("wave_right/ada", "wave_left/ada", "squat/ada", "jumping_jack/ada", "kick_right/ada")
LIMITS = {"classify clip.npy, five actions": 0.25, "list-support": 0.12}


def fill(store: Path) -> None:
    """Enrol five actions."""
    clips = [
        (name.split("/")[0], actioncli.read_clip(EXAMPLES / f"{name}.npz")) for name in ACTIONS
    ]
    actioncli.SupportStore(store).enroll_all(clips)


def main() -> None:
    with tempfile.TemporaryDirectory() as folder:
        environment = {**os.environ, "ACTIONCLI_HOME": folder, "OMP_NUM_THREADS": "1"}
        fill(Path(folder) / "support.db")
        query = Path(folder) / "clip.npy"
        np.save(query, actioncli.read_clip(EXAMPLES / "wave_right/ben.npz").joints)
        run = [sys.executable, "-m", "actioncli"]
        commands = {
            "import torch": [sys.executable, "-c", "import torch"],
            "classify clip.npy, five actions": [*run, "classify", str(query), "--fps", "25"],
            "list-support": [*run, "list-support"],
        }
        seconds: dict[str, list[float]] = {name: [] for name in commands}
        # The first round fills the disk cache and the store's embeddings and is not counted.
        for turn in range(ROUNDS + 1):
            for name, command in commands.items():
                start = time.perf_counter()
                done = subprocess.run(command, env=environment, capture_output=True, check=False)
                if done.returncode not in (0, 1):
                    sys.exit(done.stderr.decode())
                if turn:
                    seconds[name].append(time.perf_counter() - start)
    median = {name: statistics.median(times) for name, times in seconds.items()}
    for name, value in median.items():
        limit = f"  (at most {LIMITS[name]})" if name in LIMITS else ""
        ratio = value / median["import torch"]
        print(f"{name:34}{1e3 * value:8.0f} ms   ratio {ratio:.3f}{limit}")


if __name__ == "__main__":
    main()
