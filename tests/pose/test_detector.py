from pathlib import Path

import cv2
import numpy as np
import pytest

from actioncli.pose.detector import (
    PersonDetector,
    anchor_centres,
    decode,
    overlap,
    weighted_suppression,
)
from actioncli.pose.region import Image, Region

from .videos import real_frames


@pytest.fixture(scope="module")
def detect() -> PersonDetector:
    return PersonDetector(threads=1)


@pytest.fixture(scope="module")
def clapper(real_videos: Path) -> Image:
    return real_frames(real_videos / "clap" / "sudB.avi", 1)[0]


def test_anchors() -> None:
    anchors = anchor_centres()
    assert anchors.shape == (2254, 2)
    np.testing.assert_allclose(anchors[0], 0.5 / 28)
    np.testing.assert_allclose(anchors[2], (1.5 / 28, 0.5 / 28))
    np.testing.assert_allclose(anchors[-1], 6.5 / 7)


def test_decode() -> None:
    raw = np.array([[22.4, 0, 44.8, 89.6, 0, 0, 112, 0, 0, 0, 0, 0]], np.float32)
    boxes, points = decode(raw, np.array([[0.5, 0.5]], np.float32))
    np.testing.assert_allclose(boxes, [[0.5, 0.3, 0.7, 0.7]], atol=1e-6)
    np.testing.assert_allclose(points[0, :2], [[0.5, 0.5], [1.0, 0.5]], atol=1e-6)


def test_overlap() -> None:
    box = np.array([0, 0, 2, 2], np.float32)
    others = np.array([[0, 0, 2, 2], [1, 1, 3, 3], [5, 5, 6, 6], [1, 1, 1, 1]], np.float32)
    np.testing.assert_allclose(overlap(box, others), [1, 1 / 7, 0, 0], atol=1e-6)


def test_suppression_takes_the_weighted_mean_of_a_person() -> None:
    scores = np.array([0.6, 0.9, 0.8], np.float32)
    boxes = np.array([[0, 0, 1, 1], [0, 0, 1, 1.1], [3, 3, 4, 4]], np.float32)
    points = np.arange(3, dtype=np.float32)[:, None, None] * np.ones((1, 4, 2), np.float32)
    merged = weighted_suppression(scores, boxes, points)
    assert [round(score, 3) for score, _ in merged] == [0.9, 0.8]
    np.testing.assert_allclose(merged[0][1], (0.6 * 0 + 0.9 * 1) / 1.5, rtol=1e-6)
    assert weighted_suppression(scores[:0], boxes[:0], points[:0]) == []


def test_nobody_in_noise(detect: PersonDetector) -> None:
    noise = np.random.default_rng(0).integers(0, 255, (200, 300, 3), np.uint8)
    assert detect(noise) == []


@pytest.mark.parametrize("scale", [0.5, 1, 2])
def test_finds_the_person_at_any_resolution(
    detect: PersonDetector, clapper: Image, scale: float
) -> None:
    first = detect(clapper)[0].region
    scaled = detect(cv2.resize(clapper, None, fx=scale, fy=scale))[0].region
    assert scaled.size == pytest.approx(scale * first.size, rel=0.05)
    assert scaled.distance(Region(scale * first.x, scale * first.y, scaled.size)) < 0.02


def test_two_people(detect: PersonDetector, clapper: Image) -> None:
    half = clapper[:, 120:440]
    found = detect(np.hstack([half, half]))
    assert len(found) == 2
    assert found[0].region.distance(found[1].region) > 0.4


@pytest.mark.parametrize("turns", [1, 2, 3])
def test_the_region_turns_with_the_person(
    detect: PersonDetector, clapper: Image, turns: int
) -> None:
    found = detect(np.ascontiguousarray(np.rot90(clapper, turns)))
    if not found:
        pytest.skip("the detector is made for people who are upright")
    # rot90 turns the picture counterclockwise; angles count clockwise.
    expected = -turns * np.pi / 2 + detect(clapper)[0].region.angle
    off = (found[0].region.angle - expected + np.pi) % (2 * np.pi) - np.pi
    assert abs(off) < 0.35
