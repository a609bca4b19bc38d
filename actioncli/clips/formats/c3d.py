"""C3D: markers of optical motion capture, read by ezc3d (the extra `c3d`) in a process of its own,
which a damaged file may crash or keep busy.

The markers of the common sets (Plug-in Gait, Helen Hayes and others of OpenSim, Qualisys) stand for
the joints that they lie on; where a joint has one on each side, it is between them.
"""

from __future__ import annotations

import io
import math
import os
import signal
import subprocess
import sys
from importlib.util import find_spec
from pathlib import Path

import numpy as np

from actioncli.clips.axes import parse_up
from actioncli.clips.formats.files import check_range
from actioncli.clips.recording import LARGEST_CLIP, LONGEST_CLIP, Recording
from actioncli.clips.skeleton import default_columns
from actioncli.errors import ClipError

# What the format itself can count to.
_MOST_MARKERS = 2**16
# What a reader may take that a damaged header sends astray: seconds at work, and seconds and bytes
# for each byte (an hour of fifty markers is 300 MB, and is read in a few seconds).
_PATIENCE, _SLOWEST, _ROOM = 5.0, 1e-6, 64
# On a busy machine these last longer, which is no fault of the file.
_BUSY = 40
_READ = """
import sys
for name, limit in zip(("CPU", "AS", "CORE"), sys.argv[2:]):
    try:
        import resource
        resource.setrlimit(getattr(resource, "RLIMIT_" + name), (int(limit), int(limit) + 1))
    except (ImportError, ValueError, OSError):
        pass
import numpy as np, ezc3d
content = ezc3d.c3d(sys.argv[1])
stated, data = content["parameters"]["POINT"], content["data"]
def value(*keys):
    return [str(one) for key in keys if key in stated for one in stated[key]["value"]]
np.savez(
    sys.stdout.buffer,
    points=np.asarray(data["points"][:3], np.float64),
    residuals=np.asarray(data["meta_points"]["residuals"][0], np.float64),
    labels=np.array(value("LABELS", "LABELS2"), str),
    stated=np.array([(value(key) or [""])[0] for key in ("RATE", "UNITS", "Y_SCREEN")], str),
)
"""


def read(file: Path) -> Recording:
    """Marker positions (T, 1, J, 3): of the markers that stand for joints, or all where none does.

    Raises:
        ClipError: ezc3d is not installed, or the file is damaged.
    """
    if find_spec("ezc3d") is None:
        raise ClipError(
            f"{file}: .c3d needs ezc3d: pip install 'actioncli[c3d]'; or save its markers as .trc."
        )
    # -P: modules of that name in the folder where the user is are not imported.
    size = file.stat().st_size
    patience = math.ceil(_PATIENCE + _SLOWEST * size)
    limits = (patience, 2**31 + _ROOM * size, 0)
    words = [sys.executable, "-P", "-c", _READ, str(file.absolute()), *map(str, limits)]
    # A numpy of many threads reserves memory for each of them.
    alone = os.environ | {"OPENBLAS_NUM_THREADS": "1"}
    try:
        done = subprocess.run(
            words, capture_output=True, timeout=_BUSY * patience, check=False, env=alone
        )
        if done.returncode == -getattr(signal, "SIGXCPU", 0) < 0:
            raise ClipError(f"{file}: is a damaged .c3d file: reading it does not end.")
        if done.returncode:
            said = done.stderr.decode(errors="replace").strip().rpartition("\n")[2][:200]
            raise ClipError(f"{file}: is a damaged .c3d file: {said or 'its reader crashed'}.")
        with np.load(io.BytesIO(done.stdout), allow_pickle=False) as read_there:
            points, residuals = read_there["points"], read_there["residuals"]
            labels = read_there["labels"].tolist()
            rate, unit, up = read_there["stated"].tolist()
    except subprocess.TimeoutExpired as error:
        raise ClipError(f"{file}: reading it does not end: is it damaged?") from error
    count, frames = points.shape[1:]
    if not 0 < count < _MOST_MARKERS or frames > LONGEST_CLIP or count * frames > LARGEST_CLIP:
        raise ClipError(f"{file}: {frames} frames of {count} markers are no clip.")
    announced = _announced(file)
    notes = (f"is cut off: {frames} of {announced} announced frames are there",)
    names = [*labels, *(f"marker {at}" for at in range(count))][:count] if labels else None
    positions = points.transpose(2, 1, 0)
    positions[residuals.T < 0] = np.nan
    if names is not None:
        first = {name: at for at, name in reversed(list(enumerate(names)))}
        columns = default_columns(tuple(first))
        numbers = list(first.values())
        used = sorted({numbers[at] for group in columns.values() for at in group})
        kept = used or sorted(numbers)
        positions, names = positions[:, kept], [names[at] for at in kept]
    with np.errstate(over="ignore", invalid="ignore"):
        places = np.ascontiguousarray(positions, np.float32)[:, None]
    check_range(places, str(file))
    return Recording(
        places,
        joint_names=None if names is None else tuple(names),
        fps=float(rate) if rate and float(rate) else None,
        unit=unit or None,
        rest_up=parse_up(up),
        notes=notes if frames < announced else (),
    )


def _announced(file: Path) -> int:
    """How many frames the header counts, which the library makes as many as are there; 0 where
    words are in another order."""
    with file.open("rb") as stream:
        header = stream.read(10)
        stream.seek(512 * (header[0] - 1) + 3)
        if stream.read(1) == b"\x56":
            return 0
    first, last = (int.from_bytes(header[at : at + 2], "little") for at in (6, 8))
    # Longer recordings cannot be counted there.
    return last - first + 1 if last < _MOST_MARKERS - 1 else 0
