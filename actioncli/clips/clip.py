"""The clip: one recorded performance of one person, as joint positions over time."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from html import escape
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from actioncli.clips.gaps import filled
from actioncli.clips.skeleton import FloatArray as FloatArray
from actioncli.errors import ClipError

# Positions beyond this distance (metres) are not a person near a sensor but a wrong unit.
LARGEST_COORDINATE = 1e4
# Frames a second that some device might record; what a damaged file states lies anywhere.
LEAST_FPS, MOST_FPS = 1e-3, 1e6


@dataclass(frozen=True, slots=True, eq=False, init=False)
class Clip:
    """Joints of one person over time; immutable and checked on construction.

    Coordinates are right-handed metres, y up, z away from the sensor; a person who faces
    the sensor has the left side at smaller x.

    Attributes:
        joints: (T, J, 3) float32, read-only; NaN where a joint was not seen.
        joint_names: J names, unique; see `actioncli.clips.skeleton` for the ones understood.
        fps: frames per second, from `LEAST_FPS` to `MOST_FPS`.
        confidence: (T, J) float32 in [0, 1], read-only, 0 where a joint was not seen; None where
            the source has none and every joint is there.
        source: where the clip came from, for people to read (a file name, a camera).
        notes: what reading decided on the way (person chosen, gaps filled), for people.
        start: when in its source the clip begins, seconds; 0 for a whole file.
    """

    joints: FloatArray
    joint_names: tuple[str, ...]
    fps: float
    confidence: FloatArray | None
    source: str
    notes: tuple[str, ...] = field(default=())
    start: float = 0.0

    def __init__(
        self,
        joints: ArrayLike,
        joint_names: Sequence[str],
        fps: float = 30.0,
        confidence: ArrayLike | None = None,
        source: str = "",
        notes: Sequence[str] = (),
        start: float = 0.0,
    ) -> None:
        """Check and freeze.

        Raises:
            ClipError: wrong shape, infinity, names that do not fit, fewer than two
                distinct frames, or a frame rate that no device has.
        """
        where = f"{source}: " if source else ""
        names = tuple(str(name) for name in joint_names)
        positions = _frozen(joints, f"{where}joints")
        if positions.ndim != 3 or positions.shape[2] != 3:
            raise ClipError(f"{where}joints must be (frames, joints, 3), not {positions.shape}.")
        if positions.shape[1] != len(names):
            raise ClipError(f"{where}{positions.shape[1]} joints but {len(names)} joint names.")
        if len(set(names)) != len(names):
            twice = sorted({name for name in names if names.count(name) > 1})
            raise ClipError(f"{where}joint names appear twice: {', '.join(twice)}.")
        if np.isinf(positions).any():
            raise ClipError(f"{where}joints hold infinity; a joint that was not seen is NaN.")
        unseen: NDArray[np.bool_] = np.any(np.isnan(positions), axis=2)
        if unseen.any():
            positions = _frozen(np.where(unseen[..., None], np.nan, positions), "joints")
        largest = float(np.nanmax(np.abs(positions))) if positions.size > 3 * unseen.sum() else 0.0
        if largest > LARGEST_COORDINATE:
            raise ClipError(f"{where}coordinates reach {largest:.3g} m; joints must be in metres.")
        # Equal frames throughout mean a still picture: no motion to compare.
        step = np.abs(positions[1:] - positions[:-1])
        if not np.any(step > 0):
            raise ClipError(
                f"{where}a clip needs at least 2 distinct frames, this has "
                f"{min(len(positions), 1)}; record the action as a moving sequence."
            )
        try:
            rate = float(fps)
        except (TypeError, ValueError):
            rate = 0.0
        if not LEAST_FPS <= rate <= MOST_FPS:
            raise ClipError(f"{where}fps must be {LEAST_FPS:g} to {MOST_FPS:,.0f}, not {fps!r}.")
        if confidence is None and unseen.any():
            confidence = _frozen(~unseen, "confidence")
        elif confidence is not None:
            weights = _frozen(confidence, f"{where}confidence")
            if weights.shape != positions.shape[:2]:
                raise ClipError(
                    f"{where}confidence must be (frames, joints) = {positions.shape[:2]}, "
                    f"not {weights.shape}."
                )
            if not ((weights >= 0) & (weights <= 1)).all():
                raise ClipError(f"{where}confidence must lie in [0, 1].")
            confidence = _frozen(np.where(unseen, 0, weights), "confidence")
        checked = {
            "joints": positions, "joint_names": names, "fps": rate, "confidence": confidence,
            "source": str(source), "notes": tuple(notes), "start": float(start),
        }  # fmt: skip
        for name, value in checked.items():
            object.__setattr__(self, name, value)

    @property
    def duration(self) -> float:
        """Seconds from the first frame to the last."""
        return (len(self.joints) - 1) / self.fps

    def filled(self) -> FloatArray:
        """The joints (T, J, 3) with a place for those that were not seen, for what cannot do
        without: on a line between the frames around, at the ends and for a joint that was never
        seen the nearest frame's or the mean of the others'. Nothing may be decided by it."""
        if self.confidence is None or not np.isnan(self.joints).any():
            return self.joints
        return filled(self.joints)

    def __len__(self) -> int:
        return len(self.joints)

    def __repr__(self) -> str:
        frames, joints, _ = self.joints.shape
        return f"Clip({frames} frames, {joints} joints, {self.fps:g} fps, {self.source!r})"

    def _repr_html_(self) -> str:
        """What a notebook shows: the skeleton at some moments, or the line of `repr`."""
        from actioncli.clips.drawing import strip

        source = self.source if len(self.source) <= 30 else f"…{self.source[-29:]}"
        caption = f"{len(self)} frames, {self.duration:.1f} s, {source}".rstrip(", ")
        picture = strip(self.filled(), self.joint_names, caption)
        return picture or f"<pre>{escape(repr(self))}</pre>"

    def to_pandas(self) -> Any:
        """A DataFrame: a row for each frame by its time in seconds, the columns `lwri.x` and so
        on, metres.

        Raises:
            UsageError: pandas is not installed.
        """
        times = self.start + np.arange(len(self)) / self.fps
        columns = [f"{name}.{axis}" for name in self.joint_names for axis in "xyz"]
        from actioncli.files import data_frame

        table = data_frame(self.joints.reshape(len(self), -1), index=times, columns=columns)
        table.index.name = "seconds"
        return table


def _frozen(values: ArrayLike, what: str) -> FloatArray:
    """Copy as float32 and forbid writing, so that no one can change a checked clip."""
    try:
        with np.errstate(over="ignore", invalid="ignore"):
            array = np.array(values, dtype=np.float32)
    except (TypeError, ValueError) as error:
        raise ClipError(f"{what} must be an array of numbers: {error}.") from error
    array.setflags(write=False)
    return array
