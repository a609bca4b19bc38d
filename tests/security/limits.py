"""Running what is hostile in a process of its own, with little memory and little time."""

import subprocess
import sys
import textwrap
from pathlib import Path

# Bytes of address space; the libraries alone take half of it.
MEMORY = 1 << 30
# What a process may really have used at most, in MB.
MOST_USED = 950

_BEFORE = f"import resource; resource.setrlimit(resource.RLIMIT_AS, ({MEMORY}, {MEMORY}))\n"
# Not `getrusage`, which also counts the process that started this one. Where the system tells it
# otherwise than Linux, the address space alone is limited.
_AFTER = """
import pathlib
status = pathlib.Path("/proc/self/status")
used = status.read_text().split("VmHWM:")[1].split()[0] if status.exists() else 0
print("peak", int(used) // 1024)
"""


def run_limited(script: str, *arguments: object, seconds: float = 60) -> list[str]:
    """What a script printed; fails where it does not end well within the limits."""
    done = subprocess.run(
        [sys.executable, "-W", "error", "-c", _BEFORE + textwrap.dedent(script) + _AFTER]
        + [str(argument) for argument in arguments],
        capture_output=True,
        text=True,
        timeout=seconds,
        env={"OPENBLAS_NUM_THREADS": "1", "PYTHONPATH": str(Path(__file__).parents[2])},
        check=False,
    )
    assert done.returncode == 0, done.stderr[-3000:]
    *lines, peak = done.stdout.splitlines()
    assert int(peak.split()[1]) < MOST_USED, peak
    return lines
