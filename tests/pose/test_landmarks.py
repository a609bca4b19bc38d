"""What the landmark network sees of a body."""

import numpy as np
import pytest

from actioncli.pose.landmarks import Body
from actioncli.pose.sides import ARMS, LIMBS


@pytest.mark.parametrize(
    ("arms", "legs", "in_view"),
    [(0.95, 0.95, True), (0.95, 0.03, True), (0.3, 0.9, True), (0.4, 0.1, False)],
)
def test_in_view_are_most_limbs_or_the_arms(arms: float, legs: float, in_view: bool) -> None:
    visibility = np.ones(33, np.float32)
    visibility[LIMBS], visibility[ARMS] = legs, arms
    points = np.zeros((33, 2), np.float32)
    body = Body(1.0, points, visibility, np.zeros((33, 3), np.float32), points[:2])
    assert body.in_view is in_view
