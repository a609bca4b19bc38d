"""Following people through a video: the detector finds them, then the landmarks lead on."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from actioncli.clips.clip import FloatArray
from actioncli.clips.layouts import LAYOUTS
from actioncli.pose.detector import Detection, PersonDetector
from actioncli.pose.landmarks import CENTRE_POINT, SCALE_POINT, Body, LandmarkEstimator
from actioncli.pose.one_euro import OneEuro
from actioncli.pose.region import Image, Region

JOINT_NAMES = LAYOUTS["blazepose_33"]
LEAST_PRESENCE = 0.5
MOST_PEOPLE = 4
# While someone is followed, seconds between looks for people who come in or come back.
LOOK_FOR_NEW, LOOK_FOR_LOST = 1.0, 0.2
# Regions whose centres lie nearer, in sides of the larger, show the same person.
SAME_PERSON = 0.3
# A person found again farther away than this has jumped, or is another one.
SAME_PLACE = 0.6

# Column of each landmark's twin on the other side; the nose is its own.
TWINS = np.array(
    [
        JOINT_NAMES.index({"l": "r", "r": "l"}[name[0]] + name[1:]) if name != "nose" else 0
        for name in JOINT_NAMES
    ]
)
# The joints that tell left from right (a face seen from behind does not).
_LIMBS = [
    JOINT_NAMES.index(s + j) for j in ("sho", "elb", "wri", "hip", "kne", "ank") for s in "lr"
]
# Sides count as swapped if that explains the frame this much better, and the step without it is
# longer than a body can go from frame to frame (metres, mean of the limbs).
_SWAP_RATIO = 0.5
_SWAP_STEP = 0.08


def swapped(body: Body) -> Body:
    """The same body with left and right exchanged."""
    points = body.points.copy()
    points[: len(TWINS)] = points[TWINS]
    return replace(body, points=points, visibility=body.visibility[TWINS], world=body.world[TWINS])


def sides_are_swapped(world: FloatArray, before: FloatArray) -> bool:
    """Whether a frame (33, 3) continues the one before better with left and right exchanged."""
    straight = np.linalg.norm(world - before, axis=1)[_LIMBS].mean()
    crossed = np.linalg.norm(world[TWINS] - before, axis=1)[_LIMBS].mean()
    return bool(straight > _SWAP_STEP and crossed < _SWAP_RATIO * straight)


@dataclass
class Track:
    """One person over time.

    Attributes:
        times: (T) seconds at which the person was seen.
        bodies: (T) what was seen, world landmarks smoothed.
        flipped: (T) whether left and right were exchanged to agree with the frame before.
        jumps: times at which the person was found again in quite another place.
        region: where to look next; None while the person is lost.
    """

    times: list[float] = field(default_factory=list)
    bodies: list[Body] = field(default_factory=list)
    flipped: list[bool] = field(default_factory=list)
    jumps: list[float] = field(default_factory=list)
    region: Region | None = None
    _last_region: Region | None = None
    _raw: FloatArray | None = None

    def resume(self, region: Region, time: float) -> None:
        """Start, or go on after a loss, from where the detector found the person."""
        if self._last_region is not None and region.distance(self._last_region) > SAME_PLACE:
            self.jumps.append(time)
        self.region = region
        # Settings of the reference for the next region (in pixels) and world landmarks.
        self._steady = OneEuro(min_cutoff=0.01, beta=10.0)
        self._smooth = OneEuro(min_cutoff=0.1, beta=40.0)

    def lose(self) -> None:
        """Stop following until `resume`."""
        self._last_region, self.region, self._raw = self.region, None, None

    def step(self, estimate: LandmarkEstimator, image: Image, time: float) -> Body | None:
        """Take in a frame; None (and `region` None) if the person is lost."""
        assert self.region is not None, "resume() comes first"
        body = estimate(image, self.region)
        if body.presence < LEAST_PRESENCE:
            self.lose()
            return None
        ends = body.points[[CENTRE_POINT, SCALE_POINT]]
        reach = float(np.linalg.norm(ends[1] - ends[0]))
        centre, scale = self._steady(ends, time, scale=1 / max(2 * reach, 1e-6))
        self.region = Region.around(centre, scale)
        flip = self._raw is not None and sides_are_swapped(body.world, self._raw)
        body = swapped(body) if flip else body
        self._raw = body.world
        body = replace(body, world=self._smooth(body.world, time))
        self.times.append(time)
        self.bodies.append(body)
        self.flipped.append(flip)
        return body

    def settle_sides(self) -> int:
        """Go with the side that most frames show; returns how many frames were exchanged."""
        count = sum(self.flipped)
        if 2 * count > len(self.flipped):
            self.bodies = [swapped(body) for body in self.bodies]
            self.flipped = [not flip for flip in self.flipped]
            count = len(self.flipped) - count
        return count

    def away(self, region: Region) -> float:
        """How far a region is from where the person was last, in sides."""
        last = self.region or self._last_region
        return region.distance(last) if last is not None else 0.0

    def motion(self) -> float:
        """How much the person moves: metres that a visible joint goes on average, in all.

        Steps of at least 0.2 s are summed, so that trembling does not count as motion.
        """
        total, last = 0.0, 0
        for i in range(1, len(self.times)):
            if self.times[i] - self.times[last] >= 0.2:
                seen = np.minimum(self.bodies[i].visibility, self.bodies[last].visibility)
                steps = np.linalg.norm(self.bodies[i].world - self.bodies[last].world, axis=1)
                total += float((seen * steps)[_LIMBS].mean())
                last = i
        return total


class Tracker:
    """Finds and follows up to four people, frame by frame.

    Attributes:
        tracks: the people seen so far, in order of appearance.
    """

    def __init__(
        self, detect: PersonDetector, estimate: LandmarkEstimator, most: int = MOST_PEOPLE
    ) -> None:
        """Begin without anybody.

        Args:
            most: how many people to follow at once; each costs a run of the network a frame.
        """
        self.tracks: list[Track] = []
        self._detect, self._estimate, self._most = detect, estimate, most
        self._looked = -np.inf

    def __call__(self, image: Image, time: float) -> list[Track]:
        """Take in a BGR frame; returns the tracks of the people seen in it."""
        seen = [
            track
            for track in self.tracks
            if track.region is not None and track.step(self._estimate, image, time) is not None
        ]
        seen = self._without_doubles(seen)
        if self._should_look(seen, time):
            self._looked = time
            for detection in self._detect(image):
                track = self._assign(detection, seen)
                if track is None:
                    continue
                track.resume(detection.region, time)
                if track.step(self._estimate, image, time) is not None:
                    seen.append(track)
                    if track not in self.tracks:
                        self.tracks.append(track)
        return seen

    def _should_look(self, seen: Sequence[Track], time: float) -> bool:
        if not seen:
            return True
        if len(seen) >= self._most:
            return False
        lost = any(t.region is None and time - t.times[-1] < LOOK_FOR_NEW for t in self.tracks)
        return time - self._looked >= (LOOK_FOR_LOST if lost else LOOK_FOR_NEW)

    def _assign(self, detection: Detection, seen: Sequence[Track]) -> Track | None:
        """Whose detection this is: a lost person's, a new one's, or (None) nobody's to add."""
        region = detection.region
        if len(seen) >= self._most or any(t.away(region) < SAME_PERSON for t in seen):
            return None
        lost = [t for t in self.tracks if t.region is None]
        nearest = min(lost, key=lambda t: t.away(region), default=None)
        # With nobody else in view, whoever appears is taken for the person who was lost.
        if nearest is not None and (not seen or nearest.away(region) < SAME_PLACE):
            return nearest
        return Track() if len(self.tracks) < self._most else None

    def _without_doubles(self, seen: list[Track]) -> list[Track]:
        """Two regions that have come to show one person: the longer track keeps them."""
        kept: list[Track] = []
        for track in sorted(seen, key=lambda t: -len(t.times)):
            region = track.region
            if region is not None and any(t.away(region) < SAME_PERSON / 2 for t in kept):
                track.lose()
            else:
                kept.append(track)
        return kept
