"""Write a clip to a file that `read_clip` reads back."""

from __future__ import annotations

import codecs
import csv
import io
import json
import os
from collections.abc import Callable, Mapping
from pathlib import Path
from types import MappingProxyType
from typing import IO, Any

import numpy as np

from actioncli.clips.clip import Clip
from actioncli.errors import ClipError, UsageError
from actioncli.files import replacing


def write_clip(
    path: str | os.PathLike[str], clip: Clip, format: str | None = None, private: bool = False
) -> None:
    """Write a clip; a file of that name is replaced, whole or not at all.

    `npz` and `json` keep everything but source and notes; `csv` keeps the confidence; `trc`, which
    other programs for motion analysis read, has no place for it. Neither of the two says which
    axis points up: reading them may need `--up y`.

    Args:
        format: one of `WRITERS`; None: what the suffix says.
        private: readable by its owner only, whatever the umask allows.

    Raises:
        UsageError: no such format.
        ClipError: the file cannot be written.
    """
    file = Path(path)
    kind = format or file.suffix.lower().removeprefix(".")
    if kind not in WRITERS:
        raise UsageError(f"{file}: clips are written as {', '.join(WRITERS)}, not as {kind!r}.")
    with replacing(file, private, failure=ClipError) as part, part.open("wb") as stream:
        WRITERS[kind](stream, clip)


def _write_npz(stream: IO[bytes], clip: Clip) -> None:
    seen: dict[str, Any] = {} if clip.confidence is None else {"confidence": clip.confidence}
    # Not into the file: where the disk is full, a zip file that is half written complains later.
    whole = io.BytesIO()
    np.savez_compressed(
        whole,
        joints=clip.joints,
        joint_names=np.array(clip.joint_names),
        fps=np.float64(clip.fps),
        unit=np.array("m"),
        up=np.array("y"),
        **seen,
    )
    stream.write(whole.getbuffer())


def _write_json(stream: IO[bytes], clip: Clip) -> None:
    content: dict[str, object] = {
        "joint_names": clip.joint_names,
        "fps": clip.fps,
        "unit": "m",
        "up": "y",
        "joints": [
            [[None] * 3 if np.isnan(joint[0]) else joint.tolist() for joint in frame]
            for frame in np.round(clip.joints.astype(float), 5)
        ],
    }
    if clip.confidence is not None:
        content["confidence"] = np.round(clip.confidence.astype(float), 4).tolist()
    stream.write(json.dumps(content).encode("ascii"))


def _write_csv(stream: IO[bytes], clip: Clip) -> None:
    lines = _text(stream)
    table = csv.writer(lines, lineterminator="\n")
    header = [f"{name}_{axis} (m)" for name in clip.joint_names for axis in "xyz"]
    if clip.confidence is not None:
        header += [f"{name}_visibility" for name in clip.joint_names]
    table.writerow(["time (s)", *header])
    for at, frame in enumerate(clip.joints):
        seen = [] if clip.confidence is None else [f"{c:.4f}" for c in clip.confidence[at]]
        table.writerow([f"{at / clip.fps:.6f}", *map(_cell, frame.ravel()), *seen])


def _write_trc(stream: IO[bytes], clip: Clip) -> None:
    frames, joints, _ = clip.joints.shape
    rate = f"{clip.fps:g}"
    lines = _text(stream)
    lines.write(f"PathFileType\t4\t(X/Y/Z)\t{Path(clip.source).stem}.trc\n")
    lines.write(
        "DataRate\tCameraRate\tNumFrames\tNumMarkers\tUnits\tOrigDataRate\tOrigDataStartFrame\t"
        "OrigNumFrames\n"
    )
    lines.write(f"{rate}\t{rate}\t{frames}\t{joints}\tm\t{rate}\t1\t{frames}\n")
    lines.write("Frame#\tTime\t" + "\t\t\t".join(clip.joint_names) + "\t\t\n")
    lines.write("\t\t" + "\t".join(f"{a}{j + 1}" for j in range(joints) for a in "XYZ") + "\n\n")
    for at, frame in enumerate(clip.joints):
        cells = [str(at + 1), f"{at / clip.fps:.6f}", *map(_cell, frame.ravel())]
        lines.write("\t".join(cells) + "\n")


def _cell(number: float) -> str:
    """Empty where a joint was not seen."""
    return "" if np.isnan(number) else f"{number:.5f}"


def _text(stream: IO[bytes]) -> codecs.StreamWriter:
    # Half a character stands for a byte of a file's name that is no UTF-8.
    return codecs.getwriter("utf-8")(stream, "backslashreplace")


WRITERS: Mapping[str, Callable[[IO[bytes], Clip], None]] = MappingProxyType(
    {"npz": _write_npz, "json": _write_json, "trc": _write_trc, "csv": _write_csv}
)
