from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from actioncli.clips import axes
from actioncli.clips.skeleton import DEFAULT_JOINTS
from actioncli.errors import AmbiguousClipError

from .bodies import CENTRE, TO_FILE, waving


@pytest.mark.parametrize(
    ("text", "metres"),
    [("m", 1), ("Meters", 1), ("metres", 1), ("cm", 0.01), ("Centimeter", 0.01), ("mm", 0.001),
     ("millimetres", 0.001), ("inches", 0.0254), ("0.056444", 0.056444), (2, 2), ("0", None),
     ("-1", None), ("nan", None), ("inf", None), ("furlong", None), ("", None)],
)  # fmt: skip
def test_units(text: str | float, metres: float | None) -> None:
    assert axes.parse_unit(text) == metres


@pytest.mark.parametrize(
    ("text", "up"),
    [("y", "y"), ("+Y", "y"), ("y-up", "y"), ("Y up", "y"), ("z_up", "z"), ("-z", "-z"),
     ("y-down", "-y"), ("camera", "-y"), ("OpenCV", "-y"), ("up", None), ("w", None), ("", None)],
)  # fmt: skip
def test_axes_by_their_names(text: str, up: str | None) -> None:
    assert axes.parse_up(text) == up


@given(
    up=st.sampled_from(axes.UPS),
    points=arrays(np.float32, (4, 3), elements=st.floats(-5, 5, width=32)),
)
def test_turning_is_a_rotation(up: str, points: np.ndarray) -> None:
    frame = axes.to_canonical(np.eye(3, dtype=np.float32), 1.0, up)
    assert np.linalg.det(frame) == pytest.approx(1)
    turned = axes.to_canonical(points, 0.001, up)
    np.testing.assert_allclose(turned, points @ frame * 0.001, atol=1e-6)


@pytest.mark.parametrize("up", axes.UPS)
def test_the_named_axis_points_up(up: str) -> None:
    file_up = np.zeros((1, 3), np.float32)
    file_up[0, "xyz".index(up[-1])] = -1 if up.startswith("-") else 1
    np.testing.assert_array_equal(axes.to_canonical(file_up, 1.0, up), [[0, 1, 0]])
    # Camera axes, (right, down, away), keep the distance.
    right_down_away = np.array([[1, 2, 3]], np.float32)
    np.testing.assert_array_equal(axes.to_canonical(right_down_away, 1.0, "-y"), [[-1, -2, 3]])


def test_body_size_is_relative_to_a_grown_person() -> None:
    body = waving().astype(np.float32)
    size = axes.body_size(body, DEFAULT_JOINTS)
    assert size == pytest.approx(1, abs=0.05)
    assert axes.body_size(1000 * body, DEFAULT_JOINTS) == pytest.approx(1000 * size, rel=1e-4)
    assert axes.body_size(body, tuple(f"marker{j}" for j in range(15))) is None


@given(size=st.floats(0.3, 2.5))
def test_every_person_has_one_unit(size: float) -> None:
    for unit in ("m", "cm", "mm"):
        metres, note = axes.infer_unit(size / axes.UNITS[unit], "clip")
        assert (metres, f": {unit} (--unit)" in note) == (axes.UNITS[unit], True)


@pytest.mark.parametrize("size", [0.1, 10, 26, 4000])
def test_bodies_of_other_sizes_are_made_a_grown_persons(size: float) -> None:
    metres, note = axes.infer_unit(size, "clip")
    assert size * metres == pytest.approx(1)
    assert "a grown person's size" in note


@pytest.mark.parametrize("size", [0.0, None, float("inf")])
def test_no_body_has_no_unit(size: float | None) -> None:
    with pytest.raises(AmbiguousClipError, match=r"clip: .*--unit"):
        axes.infer_unit(size, "clip")


def infer(positions: np.ndarray, rest_up: str | None = None) -> str:
    return axes.infer_up(positions.astype(np.float32), DEFAULT_JOINTS, 1.0, rest_up, "clip")


def test_up_from_posture() -> None:
    centred = waving() - CENTRE
    assert infer(waving()) == "y"
    assert infer(TO_FILE["-y"](waving())) == "-y"
    assert infer(TO_FILE["z"](centred)) == "z"
    on_the_floor = TO_FILE["z"](centred) + np.array([1.0, 0.4, 0.9])
    assert infer(on_the_floor) == "z"


def test_bending_over_for_a_while_changes_nothing() -> None:
    body = waving()
    head = DEFAULT_JOINTS.index("head")
    body[:12, head, 1] -= 1.6
    assert infer(body) == "y"
    body[12:20, head, 1] -= 1.6
    with pytest.raises(AmbiguousClipError, match=r"y 50%.*--up"):
        infer(body)


def test_the_rest_pose_settles_lying_but_not_a_contradiction() -> None:
    lying = TO_FILE["x"](waving())
    assert infer(lying, rest_up="y") == "y"
    assert infer(TO_FILE["z"](waving() - CENTRE), rest_up="z") == "z"
    with pytest.raises(AmbiguousClipError, match="rest pose stands along y"):
        infer(TO_FILE["z"](waving() - CENTRE), rest_up="y")


def test_no_body_no_posture() -> None:
    body = waving().astype(np.float32)
    with pytest.raises(AmbiguousClipError, match="no head and ankles"):
        axes.infer_up(body, tuple(f"marker{j}" for j in range(15)), 1.0, None, "clip")
