from __future__ import annotations

import pickle
from xml.etree import ElementTree

import numpy as np
import pytest

from actioncli.clips.clip import Clip
from actioncli.clips.skeleton import DEFAULT_JOINTS
from actioncli.errors import ClipError

from .bodies import waving


def test_a_clip_is_frozen() -> None:
    joints = waving()
    clip = Clip(joints, DEFAULT_JOINTS, 25, np.ones((40, 15)), "here", ["a note"])
    joints[:] = 0
    assert np.abs(clip.joints).max() > 1
    with pytest.raises(ValueError, match="read-only"):
        clip.joints[0] = 0
    with pytest.raises(AttributeError):
        clip.fps = 3  # type: ignore[misc]
    assert (len(clip), clip.fps, clip.notes) == (40, 25, ("a note",))
    assert clip.duration == pytest.approx(39 / 25)
    assert clip.start == 0
    assert repr(clip) == "Clip(40 frames, 15 joints, 25 fps, 'here')"


def test_a_clip_survives_a_process() -> None:
    clip = pickle.loads(pickle.dumps(Clip(waving(), DEFAULT_JOINTS)))  # noqa: S301 - our own
    np.testing.assert_array_equal(clip.joints, waving().astype(np.float32))


def test_a_notebook_shows_the_skeleton() -> None:
    clip = Clip(waving(), DEFAULT_JOINTS, 25, source="<a> & \x1b\udcff.npy")
    svg = ElementTree.fromstring(clip._repr_html_())
    lines = [part for part in svg if part.tag.endswith("line")]
    colours = {line.get("stroke") for line in lines}
    assert (len(lines), len(colours)) == (5 * 14, 3)
    for line in lines:
        assert all(0 <= float(line.attrib[x]) <= 320 for x in ("x1", "x2"))
        assert all(0 <= float(line.attrib[y]) <= 138 for y in ("y1", "y2"))
    # Who faces the viewer has the left hand on the right of the picture.
    x = {side: [float(line.attrib["x1"]) for line in lines[:14] if line.get("stroke") == colour]
         for side, colour in (("left", "var(--left)"), ("right", "var(--right)"))}  # fmt: skip
    assert np.mean(x["left"]) > np.mean(x["right"])
    assert svg[-1].text == "40 frames, 1.6 s, <a> & \ufffd\ufffd.npy"

    long = Clip(waving(), DEFAULT_JOINTS, 25, source=f"{50 * 'a'}/b.npy")
    assert f"40 frames, 1.6 s, …{23 * 'a'}/b.npy<" in long._repr_html_()
    part = Clip(waving()[:, :3], ["<b>", "c", "d"])
    assert part._repr_html_() == "<pre>Clip(40 frames, 3 joints, 30 fps, &#x27;&#x27;)</pre>"


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"joints": np.zeros((4, 15))}, "must be"),
        ({"joints": "text"}, "array of numbers"),
        ({"joints": waving()[:1]}, "2 distinct frames"),
        ({"joints": np.ones((5, 15, 3))}, "2 distinct frames"),
        ({"joints": 1e6 * waving()}, "metres"),
        ({"joints": np.where(waving() > 2.4, np.inf, waving())}, "infinity"),
        ({"joints": np.full((9, 15, 3), np.nan)}, "2 distinct"),
        ({"joint_names": DEFAULT_JOINTS[:3]}, "15 joints but 3"),
        ({"joint_names": ["a"] * 15}, "twice: a"),
        ({"fps": 0}, "fps"),
        ({"fps": float("inf")}, "fps"),
        ({"fps": 0.0009}, "fps must be 0.001 to 1,000,000, not 0.0009"),
        ({"fps": 1e6 + 1}, "fps"),
        ({"fps": "fast"}, "fps"),
        ({"confidence": np.ones((40, 3))}, "confidence must be"),
        ({"confidence": np.full((40, 15), np.nan)}, "confidence must lie"),
    ],
)
def test_what_is_no_clip_is_refused(change: dict[str, object], message: str) -> None:
    fields = {"joints": waving(), "joint_names": DEFAULT_JOINTS, "source": "here"} | change
    with pytest.raises(ClipError, match=f"here: .*{message}"):
        Clip(**fields)  # type: ignore[arg-type]


def test_what_was_not_seen_is_nan_with_confidence_zero() -> None:
    joints = waving().astype(np.float32)
    joints[3, 5, 1] = np.nan
    joints[:, 14] = np.nan
    clip = Clip(joints, DEFAULT_JOINTS)
    unseen = np.isnan(joints).any(axis=2)
    assert clip.confidence is not None
    np.testing.assert_array_equal(clip.confidence, np.where(unseen, 0, 1))
    np.testing.assert_array_equal(np.isnan(clip.joints).all(axis=2), unseen)
    given = Clip(joints, DEFAULT_JOINTS, confidence=np.full(unseen.shape, 0.5))
    assert given.confidence is not None
    np.testing.assert_array_equal(given.confidence, np.where(unseen, 0, 0.5))
    whole = clip.filled()
    assert np.isfinite(whole).all()
    np.testing.assert_allclose(whole[3, 5], joints[[2, 4], 5].mean(axis=0), atol=1e-6)
    np.testing.assert_array_equal(whole[~unseen], joints[~unseen])
    assert Clip(whole, DEFAULT_JOINTS).filled() is not None
