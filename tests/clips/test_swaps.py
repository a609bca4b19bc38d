"""Limbs that a sensor takes for each other."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from actioncli import Recognizer, read_clip
from actioncli.clips.clip import Clip, FloatArray
from actioncli.clips.skeleton import DEFAULT_JOINTS, LIMBS, select_joints
from actioncli.clips.swaps import limb_swaps

EXAMPLES = Path(__file__).parents[2] / "examples"
CLIPS = sorted(EXAMPLES.glob("*/*.npz"))
AS_RECORDED = np.arange(len(DEFAULT_JOINTS))


def body_of(file: Path) -> FloatArray:
    clip = read_clip(file)
    return select_joints(clip.joints, clip.joint_names, DEFAULT_JOINTS, clip.source)


def exchanged(body: FloatArray, kind: str, span: slice, first: int = 0) -> FloatArray:
    """With both arms, or both legs, in each other's place for some frames, from their joint
    `first` on."""
    left, right = ([DEFAULT_JOINTS.index(name) for name in LIMBS[f"{side} {kind}"][first:]]
                   for side in ("left", "right"))  # fmt: skip
    wrong = body.copy()
    wrong[span, left], wrong[span, right] = body[span, right], body[span, left]
    return wrong


@pytest.mark.parametrize("file", CLIPS, ids=lambda file: f"{file.parent.name}/{file.stem}")
def test_a_clip_without_such_a_mistake_stays_as_it_is(file: Path) -> None:
    assert (limb_swaps(body_of(file)) == AS_RECORDED).all()


@given(
    file=st.sampled_from(CLIPS),
    kind=st.sampled_from(["arm", "leg"]),
    share=st.floats(0.1, 0.45),
    place=st.floats(0, 1),
    first=st.integers(0, 1),
)
def test_a_stretch_of_exchanged_limbs_is_put_back(
    file: Path, kind: str, share: float, place: float, first: int
) -> None:
    body = body_of(file)
    count = max(1, int(share * len(body)))
    begin = int(place * (len(body) - count))
    wrong = exchanged(body, kind, slice(begin, begin + count), first)
    found = np.take_along_axis(wrong, limb_swaps(wrong)[..., None], axis=1)
    np.testing.assert_array_equal(found, body)


def test_it_decides_nothing(recognizer: Recognizer) -> None:
    file = EXAMPLES / "kick_right/ada.npz"
    body = body_of(file)
    clip = Clip(body, DEFAULT_JOINTS, read_clip(file).fps)
    third = slice(len(body) // 3, len(body) // 2)
    swapped = Clip(exchanged(body, "leg", third), DEFAULT_JOINTS, clip.fps)
    np.testing.assert_array_equal(*(recognizer.embed([one]) for one in (clip, swapped)))
