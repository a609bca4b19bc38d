import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from actioncli.clips.clip import FloatArray
from actioncli.pose.sides import ALL_NAMES, JOINT_NAMES, TWINS, settle_sides


def walker(frames: int = 40) -> FloatArray:
    """(T, 33, 3): left joints 40 cm beside right ones, all swaying slowly."""
    side = np.array([-0.2 if n[0] == "l" else 0.2 if n[0] == "r" else 0 for n in JOINT_NAMES])
    world = np.zeros((frames, 33, 3), np.float32)
    world[..., 0] = side
    world[..., 1] = np.linspace(-1, 1, 33)
    world[..., 2] = 0.1 * np.sin(np.arange(frames) / 5)[:, None]
    return world


def test_twins() -> None:
    assert JOINT_NAMES[TWINS[JOINT_NAMES.index("lwri")]] == "rwri"
    assert ALL_NAMES[TWINS[ALL_NAMES.index("lhand7")]] == "rhand7"
    np.testing.assert_array_equal(TWINS[TWINS], np.arange(75))


@given(st.lists(st.integers(0, 39), max_size=12))
def test_swapped_frames_are_put_right(frames: list[int]) -> None:
    world = walker()
    mixed, visibility = world.copy(), np.tile(np.arange(33, dtype=np.float32) / 33, (40, 1))
    bad = sorted(set(frames))
    mixed[bad] = mixed[bad][:, TWINS[:33]]
    settled, seen, changed = settle_sides(mixed, visibility)
    np.testing.assert_array_equal(settled, world)
    np.testing.assert_array_equal(np.flatnonzero(changed), bad)
    np.testing.assert_array_equal(seen[bad], visibility[bad][:, TWINS[:33]])


def test_legs_alone() -> None:
    world = walker()
    mixed = world.copy()
    mixed[10:14, 23:] = mixed[10:14][:, TWINS[23:33]]
    settled, _, changed = settle_sides(mixed, np.ones((40, 33), np.float32))
    np.testing.assert_array_equal(settled, world)
    assert np.flatnonzero(changed).tolist() == [10, 11, 12, 13]


def test_a_turn_is_no_exchange() -> None:
    """Somebody who turns round in a second crosses over without leaps."""
    world = walker()
    angle = np.linspace(0, np.pi, 40)
    turned = world.copy()
    turned[..., 0] = world[..., 0] * np.cos(angle)[:, None]
    turned[..., 2] = world[..., 0] * np.sin(angle)[:, None]
    assert not settle_sides(turned, np.ones((40, 33), np.float32))[2].any()
