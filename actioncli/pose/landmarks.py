"""The landmark network: one region in, the body in it out."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from actioncli.clips.clip import FloatArray
from actioncli.pose.estimator import Estimator
from actioncli.pose.networks import LANDMARKS, sigmoid
from actioncli.pose.region import Region
from actioncli.pose.sides import ARMS, LIMBS

SIDE = 256
LANDMARK_COUNT = 33
# After the body's 33: the two points from which the next frame's region follows, and four spare.
CENTRE_POINT, SCALE_POINT = 33, 34
ALL_POINTS = 39
HEAT_KERNEL = 9
LEAST_HEAT = 0.5
# Limbs of this mean visibility are in view.
LEAST_VISIBLE = 0.5


@dataclass(frozen=True, slots=True, eq=False)
class Body:
    """One person in one frame, as the network sees it.

    Attributes:
        presence: probability that the region shows a person at all.
        points: (J, 2) pixels in the image: 33 landmarks, or 75 with both hands.
        visibility: (J,) probability that the landmark is in view.
        world: (J, 3) metres from the midpoint of the hips; x right in the image, y down,
            z away from the camera.
        ends: (2, 2) pixels: the body's centre, and the point that tells its size and direction.
    """

    presence: float
    points: FloatArray
    visibility: FloatArray
    world: FloatArray
    ends: FloatArray

    @property
    def in_view(self) -> bool:
        """Whether most of the limbs can be seen, or both arms, as at a desk."""
        means = (float(self.visibility[limbs].mean()) for limbs in (LIMBS, ARMS))
        return max(means) >= LEAST_VISIBLE


class LandmarkEstimator(Estimator[Body]):
    """BlazePose's landmark network, "full" (`fast`) or "heavy" (`accurate`)."""

    side, border = SIDE, cv2.BORDER_REPLICATE

    def __init__(self, quality: str, threads: int | None = None) -> None:
        """Load the network.

        Raises:
            WeightsError: see `Network`.
        """
        self.network = LANDMARKS[quality]
        super().__init__(threads)

    def postprocess(self, output: dict[str, FloatArray], region: Region) -> Body:
        """The body, whatever the region shows; see `Body.presence`."""
        rows = output["landmarks"].reshape(ALL_POINTS, 5)  # x, y, z, visibility, presence
        points = refine(rows[:, :2] / np.float32(SIDE), output["heatmap"][0])
        placed = region.to_image(points[: SCALE_POINT + 1])
        return Body(
            presence=float(output["presence"].item()),
            points=placed[:LANDMARK_COUNT],
            visibility=sigmoid(rows[:LANDMARK_COUNT, 3]),
            world=region.turned(output["world"].reshape(ALL_POINTS, 3)[:LANDMARK_COUNT]),
            ends=placed[[CENTRE_POINT, SCALE_POINT]],
        )


def refine(points: FloatArray, heatmap: FloatArray) -> FloatArray:
    """Move each point to the centre of the heat around it, where there is enough heat.

    Args:
        points: (N, 2) in units of the region's side.
        heatmap: (H, W, N) logits.

    Returns:
        (N, 2).
    """
    height, width, count = heatmap.shape
    column, row = (points * (width, height)).T.astype(int)  # each (N,), towards zero
    inside = (points > -1 / width).all(axis=1) & (column < width) & (row < height)
    steps = np.arange(-(HEAT_KERNEL // 2), HEAT_KERNEL // 2 + 1)
    columns, rows = column[:, np.newaxis] + steps, row[:, np.newaxis] + steps  # (N, 9)
    window = heatmap[
        rows.clip(0, height - 1)[:, :, np.newaxis],
        columns.clip(0, width - 1)[:, np.newaxis],
        np.arange(count)[:, np.newaxis, np.newaxis],
    ]
    known = ((rows >= 0) & (rows < height))[:, :, np.newaxis] & (
        (columns >= 0) & (columns < width)
    )[:, np.newaxis]
    heat = sigmoid(window) * known  # (N, 9, 9)
    total = np.maximum(heat.sum(axis=(1, 2)), 1e-12)
    centre = np.stack(
        [(heat.sum(axis=1) * columns).sum(axis=1), (heat.sum(axis=2) * rows).sum(axis=1)], axis=1
    ) / (total[:, np.newaxis] * (width, height))
    hot = inside & (heat.max(axis=(1, 2)) >= LEAST_HEAT)
    return np.asarray(np.where(hot[:, np.newaxis], centre, points), np.float32)
