"""Hands: looked for where the body's wrist is, then followed by their own landmarks.

The way is that of mediapipe's holistic graph: wrist, little finger and index of the body say where
a hand may be, a small network says where in there it is, and the landmark network says how it is
held. While a hand moves little, its last landmarks say better where to look. Where the body's
landmarks jump, a hand would be lost: for this they are smoothed, as the reference does.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import cv2
import numpy as np

from actioncli.clips.clip import FloatArray
from actioncli.pose.estimator import Estimator
from actioncli.pose.landmarks import Body
from actioncli.pose.networks import HAND_CROP, HAND_LANDMARKS
from actioncli.pose.one_euro import OneEuro
from actioncli.pose.region import Image, Region
from actioncli.pose.sides import ALL_NAMES

HAND_COUNT = 21
LEAST_PRESENCE = 0.5
# A wrist less visible than this is not in the picture, and no hand is looked for. Visibility
# counts as a running mean, to which a frame adds so much.
LEAST_WRIST, _NEW_VISIBILITY = 0.1, 0.1
# Legs are in view where an ankle is so visible; knees are guessed below the picture's edge.
_LEGS = [ALL_NAMES.index(joint) for joint in ("lank", "rank")]
_LEGS_SEEN = 0.5
# A hand surely seen, not farther than this from where the wrist lets it be expected (in sides of
# the region), is followed without being looked for: of six clips in which mediapipe finds hands
# in 70 % of the frames, that changes the answer in one of a hundred.
_SURE, _NEAR = 0.95, 0.3
# Columns of the body's wrist, little finger and index, and of the hand, for either side.
SIDES = tuple(
    (
        [ALL_NAMES.index(side + joint) for joint in ("wri", "pinky", "index")],
        slice(ALL_NAMES.index(f"{side}hand0"), ALL_NAMES.index(f"{side}hand0") + HAND_COUNT),
    )
    for side in "lr"
)
# A hand's joints that keep together, whatever the fingers do, and those that tell its direction.
_PALM = [0, 1, 2, 3, 5, 6, 9, 10, 13, 14, 17, 18]
_WRIST, _INDEX, _MIDDLE, _RING = 0, 5, 9, 13
# Room around what is seen, in sides of it, and how far the room is moved towards the fingertips.
_ROOM_FROM_BODY, _ROOM_FROM_HAND, _FORWARD = 2.7, 2.0, 0.1
# How far the region of the last landmarks may be from the one found anew: radians, shares of its
# side, and the share of its half within which the landmarks must lie.
_MOST_TURN, _MOST_MOVE, _MOST_GROWTH, _WITHIN = np.radians(40), 0.2, 0.4, 0.9


@dataclass(frozen=True, slots=True, eq=False)
class Hand:
    """One hand in one frame, as the network sees it.

    Attributes:
        presence: probability that the region shows a hand at all.
        points: (21, 2) pixels in the image.
        world: (21, 3) metres about the hand's middle; x right in the image, y down, z away from
            the camera.
    """

    presence: float
    points: FloatArray
    world: FloatArray


class HandCropper(Estimator[Region]):
    """Where in a region that the body's wrist tells a hand is, if there is one."""

    network, side, border = HAND_CROP, 256, cv2.BORDER_REPLICATE

    def postprocess(self, output: dict[str, FloatArray], region: Region) -> Region:
        """See `Estimator`."""
        # The second point lies below the hand's middle, towards the arm.
        centre, below = region.to_image(output["crop"].reshape(2, 2) / np.float32(self.side))
        size = max(2 * float(np.hypot(*(below - centre))), 1.0)
        return Region.towards(centre, 2 * centre - below, size).moved(_FORWARD)


class HandEstimator(Estimator[Hand]):
    """The hand landmark network."""

    network, side, border = HAND_LANDMARKS, 224, cv2.BORDER_REPLICATE

    def postprocess(self, output: dict[str, FloatArray], region: Region) -> Hand:
        """The hand, whatever the region shows; see `Hand.presence`."""
        points = output["landmarks"].reshape(HAND_COUNT, 3)[:, :2] / np.float32(self.side)
        world = region.turned(output["world"].reshape(HAND_COUNT, 3))
        return Hand(float(output["presence"].item()), region.to_image(points), world)


class HandFinder:
    """Looks for a hand at a wrist.

    Attributes:
        everywhere: look for hands of people whose legs are in view, too.
    """

    def __init__(self, threads: int | None = None, everywhere: bool = True) -> None:
        """Nothing is loaded before somebody's hand is looked for."""
        self.everywhere, self._threads = everywhere, threads

    @cached_property
    def _crop(self) -> HandCropper:
        return HandCropper(self._threads)

    @cached_property
    def _estimate(self) -> HandEstimator:
        return HandEstimator(self._threads)

    def __call__(self, image: Image, arm: FloatArray, last: Hand | None) -> Hand | None:
        """The hand, if there is one.

        Args:
            image: BGR.
            arm: the body's wrist, little finger and index (3, 2), pixels.
            last: the hand in the frame before, if it was seen.

        Raises:
            WeightsError: see `Network`.
        """
        region = region_of_arm(arm)
        if last is None:
            region = self._crop(image, region)
        else:
            followed = region_of_hand(last.points)
            if last.presence < _SURE or followed.distance(region) > _NEAR:
                region = self._crop(image, region)
                sure = still_there(last.points, followed, region)
            else:
                sure = True
            region = followed if sure else region
        hand = self._estimate(image, region)
        return hand if hand.presence > LEAST_PRESENCE else None


class HandFollower:
    """Both hands of one person, frame after frame."""

    def __init__(
        self,
        find: Callable[[Image, FloatArray, Hand | None], Hand | None],
        everywhere: bool = True,
    ) -> None:
        """Begin with a person who has just been found.

        Args:
            find: looks as a `HandFinder` does.
            everywhere: look while legs are in view, too.
        """
        self._find, self._everywhere = find, everywhere
        self._steady = OneEuro(min_cutoff=0.05, beta=80.0)
        self._visible: FloatArray | None = None
        self._last: list[Hand | None] = [None, None]

    def __call__(self, image: Image, body: Body, time: float) -> Body:
        """The body of 75 joints, in the order of `holistic_75`.

        A hand's visibility is its presence, and it hangs on the body's wrist. One that was not
        seen has visibility 0, and its joints stand where the wrist does.

        Args:
            image: BGR.
            body: of 33 joints, as seen in this image.
            time: of the image, seconds.
        """
        size = Region.around(*body.ends).size
        steady = self._steady(body.points, time, 1 / max(size, 1e-6))
        before = body.visibility if self._visible is None else self._visible
        self._visible = before + _NEW_VISIBILITY * (body.visibility - before)
        points, visibility, world = [body.points], [body.visibility], [body.world]
        looking = self._everywhere or bool(self._visible[_LEGS].max() < _LEGS_SEEN)
        for side, (arm, _) in enumerate(SIDES):
            hand, wrist = None, arm[0]
            if looking and self._visible[wrist] > LEAST_WRIST:
                hand = self._find(image, steady[arm], self._last[side])
            self._last[side] = hand
            none = np.zeros((HAND_COUNT, 3), np.float32)
            seen = hand or Hand(0.0, body.points[wrist] + none[:, :2], none)
            points.append(seen.points)
            visibility.append(np.full(HAND_COUNT, seen.presence, np.float32))
            world.append(body.world[wrist] + seen.world - seen.world[0])
        return Body(
            body.presence,
            np.concatenate(points),
            np.concatenate(visibility),
            np.concatenate(world),
            body.ends,
        )


def hand_finder(hands: bool | None) -> HandFinder | None:
    """What looks for hands: everywhere, nowhere, or (None) of people whose legs are out of view.

    Beside the whole body, hands are small and held in no way that belongs to the action: over 14
    films of exercises, one enrolled clip of each, hands let the nearest action be right in 75 %
    instead of 90 %. At a desk they are most of what moves.
    """
    return None if hands is False else HandFinder(everywhere=hands is True)


def region_of_arm(arm: FloatArray) -> Region:
    """Where to look for a hand, from the body's wrist, little finger and index (3, 2), pixels."""
    wrist, little, index = arm
    middle = (2 * index + little) / 3
    around = Region.towards(wrist, middle, 2 * float(np.hypot(*(middle - wrist))))
    x, y = middle.tolist()
    return Region(x, y, around.size, around.angle).moved(_FORWARD, _ROOM_FROM_BODY)


def region_of_hand(points: FloatArray) -> Region:
    """Where to look for a hand that was at these points (21, 2), pixels."""
    knuckles = (points[_INDEX] + points[_RING]) / 4 + points[_MIDDLE] / 2
    angle = Region.towards(points[_WRIST], knuckles, 0).angle
    palm = Region(0, 0, 1, angle)
    # The box around the palm along the hand's own axes.
    box = palm.to_region(points[_PALM])
    low, high = box.min(axis=0), box.max(axis=0)
    width, height = (high - low).tolist()
    ((x, y),) = palm.to_image(((low + high) / 2)[None]).tolist()
    tall = Region(x, y, height, angle).moved(_FORWARD)
    return Region(tall.x, tall.y, _ROOM_FROM_HAND * max(width, height), angle)


def still_there(points: FloatArray, followed: Region, found: Region) -> bool:
    """Whether a hand has moved so little that its last landmarks say best where it is.

    Args:
        points: (21, 2) of the frame before, pixels.
        followed: the region that they give.
        found: the region in which the hand was found in this frame, from the body's wrist.
    """
    turn = (followed.angle - found.angle + np.pi) % (2 * np.pi) - np.pi
    move = found.to_region(np.array([[followed.x, followed.y]], np.float32)) - 0.5
    within = np.abs(found.to_region(points) - 0.5) < _WITHIN / 2
    return bool(
        abs(turn) <= _MOST_TURN
        and np.abs(move).max() <= _MOST_MOVE
        and abs(followed.size - found.size) <= _MOST_GROWTH * found.size
        and within.all()
    )
