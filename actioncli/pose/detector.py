"""The person detector: an image in, regions with a person out."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache

import cv2
import numpy as np

from actioncli.clips.clip import FloatArray
from actioncli.pose.estimator import Estimator
from actioncli.pose.networks import DETECTOR, sigmoid
from actioncli.pose.region import Region

SIDE = 224
# Feature maps (side, anchors a cell); an anchor is no more than the centre of its cell.
FEATURE_MAPS = ((28, 2), (14, 2), (7, 6))
LEAST_SCORE = 0.5
MOST_OVERLAP = 0.3


@dataclass(frozen=True, slots=True)
class Detection:
    """A person found: how sure (0 to 1), and where."""

    score: float
    region: Region


@cache
def anchor_centres() -> FloatArray:
    """(2254, 2) centres of the anchors as x, y in units of the image's side."""
    maps = []
    for side, anchors in FEATURE_MAPS:
        steps = (np.arange(side) + 0.5) / side
        grid = np.stack(np.meshgrid(steps, steps), axis=-1).reshape(-1, 2)
        maps.append(np.repeat(grid, anchors, axis=0))
    return np.concatenate(maps).astype(np.float32)


class PersonDetector(Estimator[list[Detection]]):
    """BlazePose's detector, made for people whose head and hips are in view; the surest first."""

    network, side, border = DETECTOR, SIDE, cv2.BORDER_CONSTANT
    low = -1.0

    def postprocess(self, output: dict[str, FloatArray], region: Region) -> list[Detection]:
        """See `Estimator`."""
        scores = sigmoid(output["scores"][0, :, 0])
        likely = scores > LEAST_SCORE
        boxes, points = decode(output["boxes"][0, likely], anchor_centres()[likely])
        found = []
        for score, keypoints in weighted_suppression(scores[likely], boxes, points):
            centre, scale = region.to_image(keypoints[:2])
            found.append(Detection(score, Region.around(centre, scale)))
        return found


def decode(raw: FloatArray, anchors: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Boxes (N, 4) as x0, y0, x1, y1 and key points (N, 4, 2), in units of the image's side.

    Args:
        raw: (N, 12): centre, width and height, then four points, in pixels from the anchor.
        anchors: (N, 2).
    """
    scaled = raw / np.float32(SIDE)
    centre, half = scaled[:, :2] + anchors, scaled[:, 2:4] / 2
    points = scaled[:, 4:].reshape(-1, 4, 2) + anchors[:, np.newaxis]
    return np.concatenate([centre - half, centre + half], axis=1), points


def weighted_suppression(
    scores: FloatArray, boxes: FloatArray, points: FloatArray
) -> list[tuple[float, FloatArray]]:
    """Merge detections of the same person: their key points' mean, weighted by score.

    Returns:
        Score of the best, and key points (4, 2), for each person; the surest first.
    """
    order = np.argsort(-scores, kind="stable")
    merged = []
    while len(order):
        best = order[0]
        same = overlap(boxes[best], boxes[order]) > MOST_OVERLAP
        same[0] = True
        group = order[same]
        weight = (scores[group] / scores[group].sum())[:, np.newaxis, np.newaxis]
        merged.append((float(scores[best]), (points[group] * weight).sum(axis=0)))
        order = order[~same]
    return merged


def overlap(box: FloatArray, boxes: FloatArray) -> FloatArray:
    """Intersection over union of one box (4,) with each of (N, 4)."""
    low, high = np.maximum(box[:2], boxes[:, :2]), np.minimum(box[2:], boxes[:, 2:])
    shared = (high - low).clip(0).prod(axis=1)
    areas = (boxes[:, 2:] - boxes[:, :2]).clip(0).prod(axis=1)
    own = (box[2:] - box[:2]).clip(0).prod()
    return np.asarray(shared / np.maximum(areas + own - shared, 1e-12), np.float32)
