"""What a decision must not depend on, with the weights that are shipped."""

import os
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from cases import cases
from clips.bodies import write_json
from hypothesis import given, settings
from hypothesis import strategies as st

from actioncli import Clip, ClipError, Recognizer, SupportSet, SupportStore, read_clip
from actioncli.clips.clip import FloatArray
from actioncli.clips.skeleton import DEFAULT_JOINTS, select_joints
from actioncli.recognition.decision import Comparison

EXAMPLES = Path(__file__).parents[1] / "examples"
FILES = sorted(EXAMPLES.glob("*/*.npz"))
FEW = settings(max_examples=cases(12), deadline=None)
MANY = settings(max_examples=cases(40), deadline=None)
# Beyond rounding: of float32 sums in another order, and of float32 coordinates far from zero.
ROUNDING = 1e-5
FAR = 2e-3


def default_joints(file: Path) -> Clip:
    clip = read_clip(file)
    joints = select_joints(clip.joints, clip.joint_names, DEFAULT_JOINTS)
    return Clip(joints, DEFAULT_JOINTS, clip.fps)


CLIPS = {f"{file.parent.name}/{file.stem}": default_joints(file) for file in FILES}
SUPPORT = {
    action: [CLIPS[name] for name in CLIPS if name.startswith(f"{action}/")][:2]
    for action in ("wave_right", "squat", "jumping_jack", "kick_right", "wave_left")
}


@st.composite
def clips(draw: st.DrawFn) -> Clip:
    """A clip of the examples, a part of it, more or less noisy; every one is a new motion."""
    clip = CLIPS[draw(st.sampled_from(sorted(CLIPS)))]
    first = draw(st.integers(0, len(clip) // 2))
    last = draw(st.integers(first + len(clip) // 3, len(clip)))
    noise = draw(st.sampled_from([0.0, 0.01, 0.1]))
    rng = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
    shaken = clip.joints[first:last] + rng.normal(scale=noise, size=clip.joints[first:last].shape)
    return Clip(shaken, clip.joint_names, clip.fps)


def moved(clip: Clip, joints: FloatArray) -> Clip:
    return Clip(joints, clip.joint_names, clip.fps)


def same(one: Comparison, other: Comparison, within: float) -> None:
    """The same confidence and rank for every action, whatever its column."""
    column = [other.labels.tolist().index(label) for label in one.labels.tolist()]
    np.testing.assert_allclose(one.confidence, other.confidence[:, column], atol=within, rtol=0)
    np.testing.assert_allclose(one.probability, other.probability[:, column], atol=within, rtol=0)
    nearest = one.confidence.max(axis=1)
    chosen = np.take_along_axis(
        other.confidence[:, column], one.distance.argmin(axis=1)[:, None], axis=1
    )
    np.testing.assert_allclose(nearest, chosen[:, 0], atol=within, rtol=0)


@FEW
@given(query=clips(), order=st.permutations(list(SUPPORT)), turned=st.booleans())
def test_the_order_of_enrolment(
    recognizer: Recognizer, query: Clip, order: list[str], turned: bool
) -> None:
    other = {label: SUPPORT[label][:: -1 if turned else 1] for label in order}
    first, second = (recognizer.classify(query, each) for each in (SUPPORT, other))
    same(recognizer.compare([query], SUPPORT), recognizer.compare([query], other), ROUNDING)
    assert (first.label, first.nearest, first.accepted) == (
        second.label, second.nearest, second.accepted,
    )  # fmt: skip
    assert [each.label for each in first.ranking] == [each.label for each in second.ranking]


@FEW
@given(queries=st.lists(clips(), min_size=2, max_size=20))
def test_many_at_once_or_one_by_one(recognizer: Recognizer, queries: list[Clip]) -> None:
    together = recognizer.classify_all(queries, SUPPORT)
    alone = [recognizer.classify(query, SUPPORT) for query in queries]
    for one, other in zip(together, alone, strict=True):
        assert (one.label, one.nearest, one.part) == (other.label, other.nearest, other.part)
        assert one.confidence == pytest.approx(other.confidence, abs=ROUNDING)
    embedded = np.concatenate([recognizer.embed([query]) for query in queries])
    np.testing.assert_allclose(recognizer.embed(queries), embedded, atol=1e-4, rtol=1e-4)


THREADS = """
import sys, numpy as np
from pathlib import Path
from actioncli import Recognizer, read_clip
files = [Path(word) for word in sys.argv[2:]]
clips = [read_clip(file) for file in files]
support = {f"{n} {file.stem}": [clips[n]] for n, file in enumerate(files)}
found = Recognizer().compare(clips, support)
np.savez(sys.argv[1], confidence=found.confidence, distance=found.distance)
"""


def test_the_number_of_threads(tmp_path: Path) -> None:
    found = []
    for threads in (1, 2):
        count = {f"{name}_NUM_THREADS": str(threads) for name in ("OMP", "OPENBLAS", "MKL")}
        out = tmp_path / f"{threads}.npz"
        subprocess.run(
            [sys.executable, "-c", THREADS, str(out), *map(str, FILES)],
            env={**os.environ, **count},
            check=True,
        )
        found.append(dict(np.load(out)))
    one, two = found
    np.testing.assert_allclose(one["confidence"], two["confidence"], atol=ROUNDING, rtol=0)
    assert (one["distance"].argmin(axis=1) == two["distance"].argmin(axis=1)).all()


@FEW
@given(query=clips(), away=st.tuples(*[st.floats(-20, 20)] * 3))
def test_translation(recognizer: Recognizer, query: Clip, away: tuple[float, ...]) -> None:
    there = moved(query, query.joints + np.array(away, np.float32))
    same(recognizer.compare([query], SUPPORT), recognizer.compare([there], SUPPORT), FAR)


@FEW
@given(query=clips(), angle=st.floats(-np.pi, np.pi))
def test_heading(recognizer: Recognizer, query: Clip, angle: float) -> None:
    cos, sin = np.cos(angle), np.sin(angle)
    turn = np.array([[cos, 0, -sin], [0, 1, 0], [sin, 0, cos]])
    turned = moved(query, (query.joints @ turn).astype(np.float32))
    same(recognizer.compare([query], SUPPORT), recognizer.compare([turned], SUPPORT), FAR)


@FEW
@given(
    query=st.sampled_from(sorted(CLIPS)), unit=st.sampled_from(["m", "cm", "mm", "in"]),
    stated=st.sampled_from(["in the file", "by the option", "not at all"]),
)  # fmt: skip
def test_the_unit_of_a_file(recognizer: Recognizer, query: str, unit: str, stated: str) -> None:
    clip = CLIPS[query]
    scale = {"m": 1.0, "cm": 100.0, "mm": 1000.0, "in": 1 / 0.0254}[unit]
    # Inches are never inferred.
    told = "in the file" if unit == "in" else stated
    fields: dict[str, Any] = {"fps": clip.fps, "up": "y"}
    options: dict[str, Any] = {"unit": unit} if told == "by the option" else {}
    if told == "in the file":
        fields["unit"] = unit
    with tempfile.TemporaryDirectory() as folder:
        file = write_json(Path(folder, "a.json"), scale * clip.joints.astype(float), **fields)
        read = read_clip(file, **options)
    same(recognizer.compare([clip], SUPPORT), recognizer.compare([read], SUPPORT), FAR)


def test_the_order_of_columns(recognizer: Recognizer) -> None:
    """It says nothing; the names of the joints do."""
    order = np.random.default_rng(0).permutation(len(DEFAULT_JOINTS))
    names = [DEFAULT_JOINTS[column] for column in order]
    for clip in CLIPS.values():
        other = Clip(clip.joints[:, order], names, clip.fps)
        same(recognizer.compare([clip], SUPPORT), recognizer.compare([other], SUPPORT), ROUNDING)


def content(store: SupportStore, recognizer: Recognizer) -> dict[str, Any]:
    """All that a store holds but identifiers, which are never given twice, and times."""
    support = SupportSet.load(store, recognizer)
    return {
        "examples": [
            (each.label, each.negative, each.source, each.note, each.checksum, each.frames)
            for each in store.examples()
        ],
        "clips": {
            label: [(clip.joints.tobytes(), clip.joint_names, clip.fps) for clip in clips]
            for label, clips in store.support().items()
        },
        "embeddings": {label: each.tobytes() for label, each in support.actions.items()},
        "negatives": support.negatives.tobytes(),
        "damage": store.check(),
    }


@FEW
@given(query=clips(), again=st.permutations(range(3)))
def test_enrolled_again_after_removal(
    recognizer: Recognizer, query: Clip, again: list[int]
) -> None:
    with tempfile.TemporaryDirectory() as folder:
        store = SupportStore(Path(folder, "home", "support.db"))
        store.enroll("squat", SUPPORT["squat"][0])
        store.enroll_all([("wave", SUPPORT["wave_right"][0]), ("wave", query)], "a note")
        store.enroll("noise", SUPPORT["wave_left"][0], negative=True)
        before = content(store, recognizer)
        for step in again:
            if step == 0:
                store.remove("wave")
                store.enroll_all([("wave", SUPPORT["wave_right"][0]), ("wave", query)], "a note")
            elif step == 1:
                store.remove("noise")
                store.enroll("noise", SUPPORT["wave_left"][0], negative=True)
            else:
                store.remove("squat")
                store.enroll("squat", SUPPORT["squat"][0])
        assert content(store, recognizer) == before


# What sensors and programs write when something went wrong.
SIZES = st.sampled_from([1e-30, 1e-6, 1.0, 100.0, 9e3])


@st.composite
def odd_joints(draw: st.DrawFn) -> FloatArray:
    """Bodies that are none: points, lines, jumps, extremes, two frames, nearly still."""
    frames = draw(st.sampled_from([2, 3, 5, 40]))
    rng = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
    joints = CLIPS["squat/ada"].joints[:frames].astype(float)
    for change in draw(st.lists(st.sampled_from(range(8)), max_size=3)):
        size = draw(SIZES)
        if change == 0:
            joints[:] = joints[:, :1]  # all joints in one point
        elif change == 1:
            joints[:, rng.integers(15)] = joints[:, rng.integers(15)]  # a bone of no length
        elif change == 2:
            joints = size * joints
        elif change == 3:
            joints[rng.integers(frames)] += size
        elif change == 4:
            joints[:, :, rng.integers(3)] = 0  # flat
        elif change == 5:
            joints[1:] = joints[:1]
            joints[-1, rng.integers(15), rng.integers(3)] += size  # a single change
        elif change == 6:
            joints[:] = 0
            joints[-1, rng.integers(15)] = size
        else:
            joints = size * rng.normal(size=joints.shape)
    return np.clip(joints, -9.9e3, 9.9e3).astype(np.float32)


def finite_or_refused(recognizer: Recognizer, make: Any) -> None:
    try:
        query = make()
        decision = recognizer.classify(query, SUPPORT)
        support = {**SUPPORT, "odd": [query]}
        enrolled = recognizer.classify(CLIPS["squat/ben"], support, negatives=[query])
    except ClipError:
        return
    for each in (decision, enrolled):
        assert 0 <= each.confidence <= 1
        for ranked in each.ranking:
            assert 0 <= ranked.confidence <= 1
            assert 0 <= ranked.probability <= 1
            assert 0 <= ranked.distance < np.inf
        assert each.nearest_negative is None or 0 <= each.nearest_negative < np.inf


@MANY
@given(joints=odd_joints(), fps=st.sampled_from([1e-3, 1.0, 30.0, 1e6]))
def test_a_score_is_a_number_for_every_body(
    recognizer: Recognizer, joints: FloatArray, fps: float
) -> None:
    finite_or_refused(recognizer, lambda: Clip(joints, DEFAULT_JOINTS, fps))


@MANY
@given(joints=odd_joints(), data=st.data())
def test_a_score_is_a_number_for_every_file(
    recognizer: Recognizer, joints: FloatArray, data: st.DataObject
) -> None:
    holes = data.draw(st.floats(0, 0.6))
    value = data.draw(st.sampled_from([np.nan, np.inf, -np.inf, 0.0]))
    rng = np.random.default_rng(data.draw(st.integers(0, 2**32 - 1)))
    joints = joints.copy()
    joints[rng.random(joints.shape[:2]) < holes] = value
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder, "a.npz")
        np.savez(file, joints=joints, joint_names=np.array(DEFAULT_JOINTS), fps=30.0)
        finite_or_refused(recognizer, lambda: read_clip(file, unit="m", up="y"))
