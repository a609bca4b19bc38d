"""What was seen of one person in a video, and how it becomes a clip."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from actioncli.clips.clip import Clip, FloatArray
from actioncli.clips.edit import resample
from actioncli.errors import ClipError
from actioncli.pose.hands import SIDES
from actioncli.pose.landmarks import LANDMARK_COUNT, Body
from actioncli.pose.one_euro import OneEuro
from actioncli.pose.sides import ALL_NAMES, settle_sides

# A longer time without the person is told, and never lies inside an active part.
LONGEST_GAP = 0.5
# From the camera's axes (x right, y down) to those of clips: half a turn about z.
_TO_CLIP = np.array([-1, -1, 1], np.float32)


@dataclass(frozen=True, slots=True, eq=False)
class Poses:
    """One person in a video.

    Attributes:
        times: (T,) seconds from the beginning of the video, increasing.
        world: (T, J, 3) metres from the midpoint of the hips; x right in the image, y down,
            z away from the camera. As the network gives them: neither smoothed nor sides settled.
            J is 33, or 75 where hands were looked for.
        visibility: (T, J) probabilities; 0 throughout a hand that was not seen, whose places mean
            nothing.
        points: (T, J, 2) pixels in the image.
        frames: (N,) times of all frames that were looked at.
        size: width and height of the image.
        notes: what happened on the way, for people.
        names: of the joints; those of another estimator than BlazePose are taken as they are.
    """

    times: NDArray[np.float64]
    world: FloatArray
    visibility: FloatArray
    points: FloatArray
    frames: NDArray[np.float64]
    size: tuple[int, int]
    notes: tuple[str, ...] = ()
    names: tuple[str, ...] = ALL_NAMES

    @classmethod
    def of(
        cls,
        times: Sequence[float],
        bodies: Sequence[Body],
        frames: Sequence[float],
        size: tuple[int, int],
    ) -> Poses:
        """What was seen of a person at these times, of all `frames`."""
        return cls(
            times=np.array(times),
            world=np.stack([body.world for body in bodies]),
            visibility=np.stack([body.visibility for body in bodies]),
            points=np.stack([body.points for body in bodies]),
            frames=np.array(frames),
            size=size,
        )

    def between(self, start: float, end: float) -> Poses:
        """The part from `start` to `end`, seconds."""
        kept = (self.times >= start) & (self.times <= end)
        looked = self.frames[(self.frames >= start) & (self.frames <= end)]
        return replace(
            self,
            times=self.times[kept],
            world=self.world[kept],
            visibility=self.visibility[kept],
            points=self.points[kept],
            frames=looked,
        )

    def gaps(self) -> list[tuple[float, float]]:
        """Times from when to when the person was lost for longer than `LONGEST_GAP`."""
        steps = np.flatnonzero(np.diff(self.times) > LONGEST_GAP)
        return [(float(self.times[i]), float(self.times[i + 1])) for i in steps]

    def to_clip(self, source: str, notes: Sequence[str] = ()) -> Clip:
        """The skeleton as a clip at a constant frame rate; of BlazePose in layout `blazepose_33`,
        or `holistic_75` where a hand was seen.

        Sides are settled, positions smoothed as the reference does, and brought from the frames'
        own times to even ones; in between frames that lack the person, confidence is 0.

        Raises:
            ClipError: fewer than two frames with the person.
        """
        if len(self.times) < 2:
            raise ClipError(
                f"{source}: a person is in {len(self.times)} of {len(self.frames)} frames; "
                "an action needs a sequence of them."
            )
        notes = [*self.notes, *notes]
        step = float(self.frames[-1] - self.frames[0]) / (len(self.frames) - 1)
        # Half a step of tolerance: the last frame counts even if its time is rounded.
        even = np.arange(self.times[0], self.times[-1] + step / 2, step)
        even = even.clip(max=self.times[-1])
        if self.names == ALL_NAMES:
            joints, confidence, changed = self._settled(even)
            if changed.any():
                frames = f"{changed.sum()} of {len(changed)} frames"
                notes.append(f"left and right were mixed up in {frames}, and put right")
        else:
            joints = resample(self.world, self.times, even)
            confidence = resample(self.visibility, self.times, even)
        for lost, found in self.gaps():
            confidence[(even > lost) & (even < found)] = 0
            notes.append(f"nobody was seen from {lost:.1f} s to {found:.1f} s")
        sure = self.names != ALL_NAMES and not self.gaps()
        return Clip(
            joints * _TO_CLIP,
            self.names[: joints.shape[1]],
            fps=1 / step,
            confidence=None if sure else confidence.clip(0, 1),
            source=source,
            notes=notes,
            start=float(self.times[0]),
        )

    def _settled(
        self, even: NDArray[np.float64]
    ) -> tuple[FloatArray, FloatArray, NDArray[np.bool_]]:
        """What BlazePose saw, at even times: joints and confidence; and which frames had left and
        right exchanged."""
        world, visibility, changed = settle_sides(self.world, self.visibility)
        joints = resample(_smoothed(world[:, :LANDMARK_COUNT], self.times), self.times, even)
        confidence = resample(visibility, self.times, even)
        if not visibility[:, LANDMARK_COUNT:].any():
            return joints, confidence[:, :LANDMARK_COUNT], changed
        hands = [
            joints[:, [wrist]]
            + _hand(world[:, own], visibility[:, own.start] > 0, self.times, even)
            for (wrist, *_), own in SIDES
        ]
        joints = np.concatenate([joints, *hands], axis=1)
        confidence[np.isnan(joints[..., 0])] = 0
        return joints, confidence, changed


def _hand(
    places: FloatArray,
    seen: NDArray[np.bool_],
    times: NDArray[np.float64],
    even: NDArray[np.float64],
) -> FloatArray:
    """A hand (T, 21, 3) from its wrist at even times; NaN where the nearest frame lacks it."""
    hand = np.full((len(even), *places.shape[1:]), np.nan, np.float32)
    if seen.sum() > 1:
        between = (times[1:] + times[:-1]) / 2
        there = seen[np.searchsorted(between, even)]
        smooth = _smoothed(places[seen] - places[seen, :1], times[seen])
        hand[there] = resample(smooth, times[seen], even[there])
    return hand


def _smoothed(places: FloatArray, times: NDArray[np.float64]) -> FloatArray:
    """Places (T, ..., 3), metres, smoothed as the reference smooths a body's."""
    smooth = OneEuro(min_cutoff=0.1, beta=40.0)
    return np.stack([smooth(place, time) for place, time in zip(places, times, strict=True)])
