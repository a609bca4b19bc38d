"""Hands: where they are looked for, what is found of them, and how they are followed."""

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from actioncli.clips.clip import FloatArray
from actioncli.pose.detector import PersonDetector
from actioncli.pose.hands import (
    SIDES,
    Hand,
    HandFinder,
    HandFollower,
    hand_finder,
    region_of_arm,
    region_of_hand,
    still_there,
)
from actioncli.pose.landmarks import Body, LandmarkEstimator
from actioncli.pose.region import Image, Region
from actioncli.pose.sides import ALL_NAMES
from actioncli.pose.tracker import Tracker

from .videos import real_frames

# An open hand that points upwards, pixels: wrist, thumb, and four fingers beside each other.
UPRIGHT = np.array(
    [(50, 100), (38, 92), (30, 84), (24, 78), (18, 72)]
    + [(x, y) for x in (40, 50, 58, 66) for y in (62, 46, 36, 28)],
    np.float32,
)
ANGLES = st.floats(-3, 3)


def turned(points: FloatArray, angle: float) -> FloatArray:
    """About (200, 150), clockwise as the image is seen."""
    sine, cosine = np.sin(angle), np.cos(angle)
    turn = np.array([[cosine, -sine], [sine, cosine]])
    return np.asarray((points - (200, 150)) @ turn.T + (200, 150), np.float32)


@given(ANGLES)
def test_a_region_and_back(angle: float) -> None:
    region = Region(30, 40, 20, angle)
    points = np.array([[0, 0], [1, 1], [0.3, 2]], np.float32)
    np.testing.assert_allclose(region.to_region(region.to_image(points)), points, atol=1e-4)
    world = np.array([[0, -1, 0.5]], np.float32)
    up = region.to_image(np.array([[0.5, 0]], np.float32)) - (30, 40)
    np.testing.assert_allclose(region.turned(world), [[*(up[0] / 10), 0.5]], atol=1e-5)


@given(ANGLES)
def test_the_wrist_says_where_a_hand_may_be(angle: float) -> None:
    arm = np.array([(50, 100), (62, 40), (44, 40)], np.float32)
    region = region_of_arm(turned(arm, angle))
    # The middle finger begins a third of the way from index to little finger, 60 pixels up.
    np.testing.assert_allclose(region.size, 2.7 * 2 * 60, rtol=1e-4)
    expected = turned(np.array([(50, 40 - 0.1 * 2 * 60)], np.float32), angle)[0]
    np.testing.assert_allclose((region.x, region.y), expected, atol=1e-2)
    assert abs(np.sin(region.angle - angle)) < 1e-3


@given(ANGLES)
def test_a_hand_says_where_it_will_be(angle: float) -> None:
    upright, region = region_of_hand(UPRIGHT), region_of_hand(turned(UPRIGHT, angle))
    assert region.size == pytest.approx(upright.size, rel=1e-4)
    assert region.size == pytest.approx(2 * (100 - 46), rel=0.02)  # from the wrist to the joints
    middle = turned(np.array([(upright.x, upright.y)], np.float32), angle)[0]
    np.testing.assert_allclose((region.x, region.y), middle, atol=1e-2)
    assert np.sin(region.angle - angle) == pytest.approx(np.sin(upright.angle), abs=1e-3)


def test_a_hand_that_has_gone_is_looked_for() -> None:
    found = region_of_hand(UPRIGHT)
    assert still_there(UPRIGHT, found, found)
    gone = {
        "moved": Region(found.x + 0.25 * found.size, found.y, found.size, found.angle),
        "turned": Region(found.x, found.y, found.size, found.angle + 0.8),
        "nearer": Region(found.x, found.y, 1.8 * found.size, found.angle),
        "out of it": Region(found.x, found.y, 0.75 * found.size, found.angle),
    }
    for why, region in gone.items():
        assert not still_there(UPRIGHT, found, region), why


def somebody(visible: float) -> Body:
    points = np.random.default_rng(0).uniform(20, 80, (33, 2)).astype(np.float32)
    world = np.random.default_rng(1).normal(size=(33, 3)).astype(np.float32)
    return Body(1.0, points, np.full(33, visible, np.float32), world, points[:2])


def test_no_hand_is_seen_on_grey_and_none_looked_for_without_a_wrist() -> None:
    grey = np.full((100, 100, 3), 90, np.uint8)
    find = HandFinder(threads=1)
    looked = []

    def finding(image: Image, arm: FloatArray, last: Hand | None) -> Hand | None:
        looked.append(arm)
        return find(image, arm, last)

    for visible, looks in ((0.9, 2), (0.05, 0)):
        looked.clear()
        body = HandFollower(finding)(grey, somebody(visible), 0.0)
        assert len(looked) == looks
        assert (body.points.shape, body.visibility.shape) == ((75, 2), (75,))
        for (wrist, *_), own in SIDES:
            assert not body.visibility[own].any()
            np.testing.assert_array_equal(body.points[own], np.tile(body.points[wrist], (21, 1)))
            np.testing.assert_array_equal(body.world[own], np.tile(body.world[wrist], (21, 1)))


def test_unasked_hands_are_looked_for_where_legs_are_out_of_view() -> None:
    looked = []
    for ankles in (0.9, 0.05):
        body = somebody(0.9)
        body.visibility[27:29] = ankles
        follow = HandFollower(lambda *given: looked.append(given), everywhere=False)
        follow(np.zeros((9, 9, 3), np.uint8), body, 0.0)
        assert len(looked) == (0 if ankles > 0.5 else 2)
    found = [hand_finder(asked) for asked in (None, True, False)]
    assert [find and find.everywhere for find in found] == [False, True, None]


@pytest.fixture(scope="module")
def jumper(real_videos: Path) -> list[Image]:
    """Somebody with both hands in view."""
    return real_frames(real_videos / "jumping_jack" / "afrlW.mp4", 6, every=2)


def followed(images: list[Image]) -> list[Body]:
    tracker = Tracker(PersonDetector(1), LandmarkEstimator("fast", 1), 1, HandFinder(1))
    return [tracker(image, n / 15)[0].bodies[-1] for n, image in enumerate(images)]


def test_hands_hang_on_their_wrists_and_have_the_size_of_hands(jumper: list[Image]) -> None:
    bodies = followed(jumper)
    for body in bodies[-3:]:
        for (wrist, *_), own in SIDES:
            hand = body.world[own]
            assert body.visibility[own].min() > 0.5
            np.testing.assert_allclose(hand[0], body.world[wrist], atol=1e-6)
            assert 0.06 < np.linalg.norm(hand[9] - hand[0]) < 0.13  # the palm, metres
            reach = np.linalg.norm(body.points[own] - body.points[wrist], axis=1)
            assert reach.max() < 0.4 * np.ptp(body.points[:33, 1])


def test_the_mirror_exchanges_the_hands(jumper: list[Image]) -> None:
    body = followed(jumper)[-1]
    mirrored = followed([np.ascontiguousarray(image[:, ::-1]) for image in jumper])[-1]
    (_, left), (_, right) = SIDES
    width = jumper[0].shape[1]
    for own, other in ((left, right), (right, left)):
        back = mirrored.points[other] * (-1, 1) + (width, 0)
        size = np.ptp(body.points[own], axis=0).max()
        assert np.median(np.linalg.norm(back - body.points[own], axis=1)) < 0.2 * size
    assert (ALL_NAMES[left.start], ALL_NAMES[right.start]) == ("lhand0", "rhand0")
