"""Following people through a video: the detector finds them, then the landmarks lead on."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

import numpy as np

from actioncli.pose.detector import Detection
from actioncli.pose.hands import HandFinder, HandFollower
from actioncli.pose.landmarks import Body
from actioncli.pose.one_euro import OneEuro
from actioncli.pose.region import Image, Region
from actioncli.pose.sides import ALL_NAMES, LIMBS

# What finds people in a picture, and what sees the one in a region of it.
Detect = Callable[[Image], list[Detection]]
Estimate = Callable[[Image, Region], Body]

LEAST_PRESENCE = 0.5
MOST_PEOPLE = 4
# While someone is followed, seconds between looks for people who come in or come back.
LOOK_FOR_NEW, LOOK_FOR_LOST = 1.0, 0.2
# Regions whose centres lie nearer, in sides of the larger, show the same person.
SAME_PERSON = 0.3
# A person found again farther away than this has jumped, or is another one.
SAME_PLACE = 0.6


@dataclass(eq=False)
class Track:
    """One person over time.

    Attributes:
        times: (T) seconds at which the person was seen.
        bodies: (T) what was seen.
        jumps: times at which the person was found again in quite another place.
        region: where to look next; None while the person is lost.
    """

    times: list[float] = field(default_factory=list)
    bodies: list[Body] = field(default_factory=list)
    jumps: list[float] = field(default_factory=list)
    region: Region | None = None
    _last_region: Region | None = None
    _hands: HandFollower | None = None

    def resume(self, region: Region, time: float) -> None:
        """Start, or go on after a loss, from where the detector found the person."""
        if self._last_region is not None and region.distance(self._last_region) > SAME_PLACE:
            self.jumps.append(time)
        self.region, self._hands = region, None
        self._steady = OneEuro(min_cutoff=0.01, beta=10.0)

    def lose(self) -> None:
        """Stop following until `resume`."""
        self._last_region, self.region = self.region, None

    def step(
        self, estimate: Estimate, hands: HandFinder | None, image: Image, time: float
    ) -> Body | None:
        """Take in a frame; None (and `region` None) if the person is lost."""
        assert self.region is not None, "resume() comes first"
        body = estimate(image, self.region)
        if body.presence < LEAST_PRESENCE:
            self.lose()
            return None
        reach = float(np.linalg.norm(body.ends[1] - body.ends[0]))
        centre, scale = self._steady(body.ends, time, scale=1 / max(2 * reach, 1e-6))
        self.region = Region.around(centre, scale)
        if hands is not None:
            self._hands = self._hands or HandFollower(hands, hands.everywhere)
            body = self._hands(image, body, time)
        self.times.append(time)
        self.bodies.append(body)
        return body

    def away(self, region: Region) -> float:
        """How far a region is from where the person was last, in sides."""
        last = self.region or self._last_region
        return region.distance(last) if last is not None else 0.0

    def motion(self, joints: Sequence[int]) -> float:
        """How much the person moves: metres that a visible one of these joints goes on average, in
        all.

        Steps of at least 0.2 s are summed, so that trembling does not count as motion.
        """
        total, last = 0.0, 0
        for i in range(1, len(self.times)):
            if self.times[i] - self.times[last] >= 0.2:
                seen = np.minimum(self.bodies[i].visibility, self.bodies[last].visibility)
                steps = np.linalg.norm(self.bodies[i].world - self.bodies[last].world, axis=1)
                total += float((seen * steps)[joints].mean())
                last = i
        return total


class Tracker:
    """Finds and follows up to four people, frame by frame.

    Attributes:
        tracks: the people seen so far, in order of appearance.
        names: of the joints of their bodies.
        notes: what to tell of all that is seen.
    """

    def __init__(
        self,
        detect: Detect,
        estimate: Estimate,
        most: int = MOST_PEOPLE,
        hands: HandFinder | None = None,
        names: tuple[str, ...] = ALL_NAMES,
        notes: tuple[str, ...] = (),
    ) -> None:
        """Begin without anybody.

        Args:
            most: how many people to follow at once; each costs a run of the network a frame.
            hands: looks for their hands, too.
        """
        self.tracks: list[Track] = []
        self.names, self.notes = names, notes
        self._detect, self._estimate, self._hands, self._most = detect, estimate, hands, most
        self._looked = -np.inf

    def __call__(self, image: Image, time: float) -> list[Track]:
        """Take in a BGR frame; returns the tracks of the people seen in it."""
        seen = [
            track
            for track in self.tracks
            if track.region is not None
            and track.step(self._estimate, self._hands, image, time) is not None
        ]
        seen = self._without_doubles(seen)
        if self._should_look(seen, time):
            self._looked = time
            for detection in self._detect(image):
                track = self._assign(detection, seen)
                if track is None:
                    continue
                track.resume(detection.region, time)
                if track.step(self._estimate, self._hands, image, time) is not None:
                    seen.append(track)
                    if track not in self.tracks:
                        self.tracks.append(track)
        return seen

    @property
    def limbs(self) -> list[int]:
        """Columns of the joints whose motion tells people who do something from others."""
        return LIMBS if self.names == ALL_NAMES else list(range(len(self.names)))

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
