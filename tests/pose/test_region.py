import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from actioncli.pose.region import Image, Region


def gradient(width: int = 200, height: int = 120) -> Image:
    """Blue grows by one a pixel to the right, green downwards."""
    image = np.zeros((height, width, 3), np.uint8)
    image[..., 0], image[..., 1] = np.arange(width), np.arange(height)[:, None]
    return image


def test_around_upright_and_lying() -> None:
    centre = np.array([50, 80], np.float32)
    upright = Region.around(centre, np.array([50, 60], np.float32))
    assert (upright.x, upright.y, upright.size) == (50, 80, pytest.approx(50))
    assert upright.angle == pytest.approx(0)
    assert Region.around(centre, np.array([70, 80], np.float32)).angle == pytest.approx(np.pi / 2)
    assert Region.around(centre, np.array([30, 80], np.float32)).angle == pytest.approx(-np.pi / 2)


def test_crop_has_no_half_pixel_shift() -> None:
    crop = Region(60, 50, 64).crop(gradient(), 64, cv2.BORDER_REPLICATE)
    np.testing.assert_array_equal(crop, gradient()[18:82, 28:92])


@given(st.floats(40, 160), st.floats(30, 90), st.floats(8, 50), st.floats(-np.pi, np.pi))
def test_crop_shows_what_to_image_says(x: float, y: float, size: float, angle: float) -> None:
    region = Region(x, y, size, angle)
    crop = region.crop(gradient(), 16, cv2.BORDER_REPLICATE)
    grid = np.stack(np.meshgrid(np.arange(16), np.arange(16)), axis=-1).reshape(-1, 2) / 16
    at = region.to_image(grid.astype(np.float32)).clip(0, (199, 119))
    np.testing.assert_allclose(crop[..., :2].reshape(-1, 2), at, atol=0.6)


def test_outside_the_image() -> None:
    far = Region(-500, 60, 40)
    assert not far.crop(gradient(), 8, cv2.BORDER_CONSTANT).any()
    assert (far.crop(gradient(), 8, cv2.BORDER_REPLICATE)[..., 0] == 0).all()
    # Beyond what the fixed-point maps can say, still outside and no error.
    assert not Region(1e7, 0, 40).crop(gradient(), 8, cv2.BORDER_CONSTANT).any()
