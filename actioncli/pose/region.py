"""A turned square of an image, and how to cut it out."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from actioncli.clips.clip import FloatArray

Image = NDArray[np.uint8]

# A region shows the body with this much room around it.
ROOM = 1.25


@dataclass(frozen=True, slots=True)
class Region:
    """Where a person is: a square, in pixels.

    Attributes:
        x, y: its centre.
        size: its side.
        angle: by how much it is turned, radians, clockwise as the image is seen.
    """

    x: float
    y: float
    size: float
    angle: float = 0.0

    @classmethod
    def around(cls, centre: FloatArray, scale: FloatArray) -> Region:
        """The region of a body, from its centre and a point that tells size and direction.

        Args:
            centre: (2,) pixels, the midpoint of the hips.
            scale: (2,) pixels, on the circle around the body, upwards from the hips.
        """
        return cls.towards(centre, scale, 2 * float(np.hypot(*(scale - centre))) * ROOM)

    @classmethod
    def towards(cls, centre: FloatArray, end: FloatArray, size: float) -> Region:
        """The region about a point (2,) whose upper edge lies towards another, pixels."""
        dx, dy = float(end[0] - centre[0]), float(end[1] - centre[1])
        angle = np.pi / 2 - np.arctan2(-dy, dx)
        angle -= 2 * np.pi * np.floor((angle + np.pi) / (2 * np.pi))
        return cls(float(centre[0]), float(centre[1]), size, float(angle))

    def moved(self, forward: float, grown: float = 1.0) -> Region:
        """Moved towards its upper edge, in sides, and then grown about its centre."""
        step = forward * self.size
        x, y = self.x + step * np.sin(self.angle), self.y - step * np.cos(self.angle)
        return Region(float(x), float(y), grown * self.size, self.angle)

    def distance(self, other: Region) -> float:
        """Between the centres, in sides of the larger region."""
        return float(np.hypot(self.x - other.x, self.y - other.y) / max(self.size, other.size, 1))

    def to_image(self, points: FloatArray) -> FloatArray:
        """Points (N, 2) in units of the region's side, from its corner, as pixels (N, 2)."""
        return np.asarray(
            (points - 0.5) * self.size @ _rotation(self.angle).T + (self.x, self.y), np.float32
        )

    def to_region(self, points: FloatArray) -> FloatArray:
        """Pixels (N, 2) in units of the region's side, from its corner; undoes `to_image`."""
        away = (points - (self.x, self.y)) @ _rotation(self.angle)
        return np.asarray(away / self.size + 0.5, np.float32)

    def turned(self, world: FloatArray) -> FloatArray:
        """Vectors (N, 3) along the region's edges and away from the camera, along the image's."""
        turned = world.copy()
        turned[:, :2] = world[:, :2] @ _rotation(self.angle).T.astype(np.float32)
        return turned

    def crop(self, image: Image, side: int, border: int) -> Image:
        """Cut the region out as (side, side, 3), bilinear.

        The sampling positions are rounded to 1/32 of a pixel, as `warpPerspective` of OpenCV 4
        does and that of OpenCV 5 does not: the networks' reference results come from version 4.

        Args:
            border: cv2.BORDER_CONSTANT (black) or cv2.BORDER_REPLICATE outside the image.
        """
        # Every position is the corner plus whole steps along the region's two edges.
        edges = _rotation(self.angle) * self.size  # columns: along the upper, the left edge
        corner = (self.x, self.y) - edges.sum(axis=1) / 2
        steps = np.arange(side) / side
        across, down = (
            np.add.outer(
                (corner[axis] + edges[axis, 1] * steps).astype(np.float32),
                (edges[axis, 0] * steps).astype(np.float32),
            )
            for axis in (0, 1)
        )
        # Cells of the image, and which of the 32 x 32 bilinear weight tables to use in them.
        cells, weights = cv2.convertMaps(across, down, cv2.CV_16SC2)
        return np.asarray(
            cv2.remap(image, cells, weights, cv2.INTER_LINEAR, borderMode=border), np.uint8
        )


def _rotation(angle: float) -> NDArray[np.float64]:
    sine, cosine = np.sin(angle), np.cos(angle)
    return np.array([[cosine, -sine], [sine, cosine]])
