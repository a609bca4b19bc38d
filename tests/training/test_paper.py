"""What training draws from: episodes that a seed decides, and windows of long recordings."""

from __future__ import annotations

import numpy as np
import pytest
from cases import cases
from hypothesis import given, settings
from hypothesis import strategies as st

from actioncli.clips.clip import Clip
from actioncli.training.data import TrainingSet, cut_long_recordings
from actioncli.training.paper import draw_episodes


@given(seed=st.integers(0, 2**32 - 1), ways=st.integers(2, 6))
@settings(max_examples=cases(25))
def test_targets_tell_the_truth(world: TrainingSet, seed: int, ways: int) -> None:
    drawn = draw_episodes(world, 4, ways, np.random.default_rng(seed))
    for support, queries, targets in zip(drawn.support, drawn.queries, drawn.targets, strict=True):
        actions = world.labels[support]
        assert len(set(actions)) == ways
        assert (targets >= 0).sum() == ways
        for query, target in zip(queries, targets, strict=True):
            if target < 0:
                assert world.labels[query] not in actions
            else:
                assert world.labels[query] == actions[target]
                assert world.subjects[query] != world.subjects[support[target]]


def test_every_other_episode_stays_within_a_collection(world: TrainingSet) -> None:
    drawn = draw_episodes(world, 16, 5, np.random.default_rng(0))
    mixed = [
        len(set(world.collections[np.concatenate([support, queries])])) > 1
        for support, queries in zip(drawn.support, drawn.queries, strict=True)
    ]
    assert not any(mixed[::2])
    assert any(mixed[1::2])


def test_a_generator_decides_everything(world: TrainingSet) -> None:
    first, again = (draw_episodes(world, 4, 5, np.random.default_rng([3, 9])) for _ in range(2))
    np.testing.assert_array_equal(first.support, again.support)
    np.testing.assert_array_equal(first.queries, again.queries)


@pytest.mark.parametrize("batch", [1, 3])
def test_shapes(world: TrainingSet, batch: int) -> None:
    drawn = draw_episodes(world, batch, 5, np.random.default_rng(0))
    assert drawn.support.shape == (batch, 5)
    assert drawn.queries.shape == drawn.targets.shape == (batch, 10)


def test_long_recordings_become_windows_that_keep_what_was_seen(world: TrainingSet) -> None:
    clip = world.clips[0]
    one = np.zeros(1, np.int64)

    def alone(fps: float, confidence: float) -> TrainingSet:
        seen = np.full(clip.joints.shape[:2], confidence)
        recording = Clip(clip.joints, clip.joint_names, fps, seen)
        return TrainingSet((recording,), one, one, one, ("world0/long",))

    assert len(cut_long_recordings(alone(clip.fps, 1)).clips) == 1
    windows = cut_long_recordings(alone(5, 0.25))
    assert len(windows.clips) == len(windows.classes) == round(len(clip) / 5 / 2.5) > 1
    assert sum(map(len, windows.clips)) == len(clip)
    for window in windows.clips:
        assert window.confidence is not None
        assert (window.confidence == 0.25).all()
    # A run goes on only with the clips that it began with, and what was seen of them.
    assert alone(5, 0.25).fingerprint != alone(5, 0.5).fingerprint
