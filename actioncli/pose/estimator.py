"""What every estimator does: preprocess a region of an image, infer, postprocess."""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import Generic, TypeVar

import cv2
import numpy as np

from actioncli.clips.clip import FloatArray
from actioncli.pose.networks import Network
from actioncli.pose.region import Image, Region

Found = TypeVar("Found")


class Estimator(ABC, Generic[Found]):
    """A network that looks at one square region of an image.

    Attributes:
        network: a file in the weights folder.
        side: pixels of the square that the network takes.
        border: how OpenCV fills what lies outside of the image.
        low, high: the network's range for 0 and 255.
    """

    network: str
    side: int
    border: int
    low: float = 0.0
    high: float = 1.0

    def __init__(self, threads: int | None = None) -> None:
        """Load the network.

        Raises:
            WeightsError: see `Network`.
        """
        self._network = Network(self.network, threads)

    def __call__(self, image: Image, region: Region | None = None) -> Found:
        """What is found in a region of a BGR image (H, W, 3), or in all of it."""
        if region is None:
            height, width = image.shape[:2]
            region = Region(width / 2, height / 2, max(width, height))
        return self.postprocess(self._network(self.preprocess(image, region)), region)

    def preprocess(self, image: Image, region: Region) -> FloatArray:
        """(side, side, 3) RGB in the network's range."""
        pixels = cv2.cvtColor(region.crop(image, self.side, self.border), cv2.COLOR_BGR2RGB)
        scaled = pixels * np.float32((self.high - self.low) / 255)
        return scaled + np.float32(self.low) if self.low else scaled

    @abstractmethod
    def postprocess(self, output: dict[str, FloatArray], region: Region) -> Found:
        """What the network's outputs, by name, say of the region, in the image's pixels."""
