"""The One-Euro filter: smooths slow motion strongly, fast motion hardly.

G. Casiez, N. Roussel, D. Vogel: "1 Euro Filter: A Simple Speed-based Low-pass Filter for Noisy
Input in Interactive Systems", CHI 2012.
"""

from __future__ import annotations

import math

import numpy as np

from actioncli.clips.clip import FloatArray

DERIVATIVE_CUTOFF = np.array(1.0, np.float32)  # hertz


class OneEuro:
    """Filters arrays of one shape that arrive over time."""

    def __init__(self, min_cutoff: float, beta: float) -> None:
        """Choose the strength.

        Args:
            min_cutoff: cut-off frequency at rest, hertz.
            beta: how much the cut-off rises with speed.
        """
        self._min_cutoff = np.float32(min_cutoff)
        self._beta = np.float32(beta)
        self._time = -math.inf
        self._raw: FloatArray | None = None
        self._smooth: FloatArray | None = None
        self._speed: FloatArray | None = None

    def __call__(self, value: FloatArray, time: float, scale: float = 1.0) -> FloatArray:
        """The smoothed value.

        Args:
            time: seconds; a value that is not later than the last one is returned as it is.
            scale: what one unit of the value is worth when its speed is judged.
        """
        if time <= self._time:
            return value
        if self._raw is None or self._smooth is None or self._speed is None:
            self._smooth, self._speed = value, np.zeros_like(value)
        else:
            rate = 1 / (time - self._time)
            speed = (value - self._raw) * np.float32(scale * rate)
            self._speed = self._speed + _alpha(DERIVATIVE_CUTOFF, rate) * (speed - self._speed)
            cutoff = self._min_cutoff + self._beta * np.abs(self._speed)
            self._smooth = self._smooth + _alpha(cutoff, rate) * (value - self._smooth)
        self._raw, self._time = value, time
        return self._smooth


def _alpha(cutoff: FloatArray, rate: float) -> FloatArray:
    """Weight of a new value: 1 / (1 + tau rate), with tau = 1 / (2 pi cutoff)."""
    return np.asarray(1 / (1 + rate / (2 * np.pi * cutoff)), np.float32)
