"""Whoever asks, the answer is the same: the command, the library, the studio and a batch."""

import json
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

import actioncli
from actioncli import Clip, Recognizer, SupportSet, SupportStore, enrol, read_clip
from actioncli.archives.batch import Task
from actioncli.recognition.decision import Decision
from actioncli.recognition.threshold import Threshold, keep_threshold

EXAMPLES = Path(__file__).parents[1] / "examples"


@pytest.fixture
def store(tmp_path: Path, recognizer: Recognizer) -> SupportStore:
    """Examples of different lengths, a negative, and a threshold of one action's own."""
    store = SupportStore(tmp_path / "support.db")
    whole = read_clip(EXAMPLES / "squat" / "ada.npz")
    short = Clip(whole.joints[: len(whole) // 2], whole.joint_names, whole.fps)
    enrol(store, recognizer, "squat", [whole, short])
    enrol(store, recognizer, "wave_right", [read_clip(EXAMPLES / "wave_right" / "ada.npz")])
    enrol(store, recognizer, "", [read_clip(EXAMPLES / "bow" / "ben.npz")], negative=True)
    keep_threshold(store, Threshold(0.4, recognizer.weights.checksum, {"wave_right": 0.3}))
    return store


@pytest.fixture
def query(tmp_path: Path) -> Path:
    """A squat after standing still, and before a wave: long enough for windows."""
    squat = read_clip(EXAMPLES / "squat" / "ben.npz")
    wave = read_clip(EXAMPLES / "wave_right" / "ben.npz")
    rest = np.repeat(squat.joints[:1], 120, axis=0)
    rest = rest + np.random.default_rng(0).normal(scale=0.002, size=rest.shape)
    path = tmp_path / "query.npz"
    np.savez(
        path,
        joints=np.concatenate([rest, squat.joints, wave.joints]),
        joint_names=np.array(squat.joint_names),
        fps=squat.fps,
        unit="m",
        up="y",
    )
    return path


def of(decision: Decision) -> tuple[object, ...]:
    numbers = (decision.confidence, decision.tau, decision.nearest_negative, *(decision.part or ()))
    return (decision.label, decision.nearest, *(float(f"{each:.6g}") for each in numbers if each))


def test_all_front_ends_answer_alike(
    store: SupportStore, query: Path, recognizer: Recognizer, tmp_path: Path
) -> None:
    clip = read_clip(query)
    support = SupportSet.load(store, recognizer)
    wanted = support.classify(clip)
    assert wanted.part is not None
    assert wanted.part[1] - wanted.part[0] < clip.duration / 2  # a window

    command = ["classify", str(query), "--json", "--store", str(store.path), "--top", "1"]
    by_command = subprocess.run(
        [sys.executable, "-m", "actioncli", *command], capture_output=True, text=True, check=False
    )
    (found,) = json.loads(by_command.stdout)["clips"]
    assert (found["label"], found["nearest"]) == (wanted.label, wanted.nearest)
    assert (found["confidence"], found["tau"]) == pytest.approx((wanted.confidence, wanted.tau))
    assert (found["accepted"], found["notes"]) == (wanted.accepted, list(wanted.notes))
    (ranked,), first = found["ranking"], wanted.ranking[0]
    numbers = {each: ranked.pop(each) for each in ("distance", "probability", "confidence")}
    assert ranked == {"label": first.label}
    assert numbers == pytest.approx({each: getattr(first, each) for each in numbers}, rel=1e-4)
    assert (found["part"]["start"], found["part"]["end"]) == pytest.approx(wanted.part)

    # Of clips, the library knows the durations; their threshold is the caller's.
    tau = support.threshold.of(wanted.nearest)
    by_library = recognizer.classify(clip, store.support(), tau, store.negatives())
    assert of(by_library) == of(wanted)

    assert of(actioncli.open(store.path).classify(clip)) == of(wanted)  # as the studio does

    row = Task(support).row(str(query))
    assert (row["label"], row["confidence"], row["part_start"]) == (
        wanted.label,
        wanted.confidence,
        wanted.part[0],
    )
