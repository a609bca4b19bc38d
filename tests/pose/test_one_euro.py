import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from actioncli.pose.one_euro import OneEuro


def test_first_value_and_a_repeated_time_pass() -> None:
    smooth = OneEuro(0.1, 40)
    first = np.array([1.0, 2.0], np.float32)
    assert smooth(first, 0.0) is first
    later = np.array([5.0, 5.0], np.float32)
    assert smooth(later, 0.0) is later


def test_by_hand() -> None:
    smooth = OneEuro(min_cutoff=1.0, beta=0.5)
    smooth(np.zeros(1, np.float32), 0.0)
    got = smooth(np.ones(1, np.float32), 0.1)
    # Speed 10 a second, itself smoothed with alpha(1 Hz); cut-off 1 + 0.5 * that.
    speed = 10 / (1 + 10 / (2 * np.pi))
    alpha = 1 / (1 + 10 / (2 * np.pi * (1 + 0.5 * speed)))
    np.testing.assert_allclose(got, [alpha], rtol=1e-5)


@given(st.floats(-100, 100), st.integers(2, 50))
def test_what_stays_is_left_alone(value: float, count: int) -> None:
    smooth = OneEuro(0.1, 40)
    still = np.full(3, value, np.float32)
    for n in range(count):
        np.testing.assert_allclose(smooth(still, n / 30), still, rtol=1e-5)


def test_trembling_is_smoothed_and_a_leap_followed() -> None:
    trembling = OneEuro(0.1, 40)
    rng = np.random.default_rng(0)
    noise = rng.normal(0, 0.001, (200, 1)).astype(np.float32)
    out = np.array([trembling(x, n / 30) for n, x in enumerate(noise)])
    assert out[50:].std() < 0.7 * noise[50:].std()
    leap = OneEuro(0.1, 40)
    leap(np.zeros(1, np.float32), 0.0)
    assert leap(np.ones(1, np.float32), 1 / 30)[0] > 0.9
