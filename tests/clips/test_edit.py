from __future__ import annotations

import numpy as np
import pytest

from actioncli.clips.clip import Clip
from actioncli.clips.edit import cut, resample
from actioncli.clips.skeleton import DEFAULT_JOINTS

from .bodies import waving


def test_a_part_begins_within_its_clip() -> None:
    part = cut(Clip(waving(100), DEFAULT_JOINTS, 20.0, np.ones((100, 15))), 1, 3)
    assert (part.start, part.duration) == (1, pytest.approx(2))
    assert part.confidence is not None
    assert cut(part, 0.5, 1).start == pytest.approx(1.5)


def test_values_at_other_times() -> None:
    times, values = np.array([0.0, 1.0, 3.0]), np.array([[0, 1], [2, 1], [4, 5]], np.float32)
    found = resample(values, times, np.array([-1, 0.5, 2, 9]))
    np.testing.assert_allclose(found, [[0, 1], [1, 1], [3, 3], [4, 5]])
