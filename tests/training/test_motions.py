"""Bones, tasks and augmentation of the default recipe: bodies stay bodies."""

from __future__ import annotations

import numpy as np
import pytest
import torch

from actioncli.clips.prepare import prepare
from actioncli.training import augment, motions
from actioncli.training.data import TrainingSet, cut_long_recordings
from actioncli.training.recipes import RECIPES
from actioncli.training.tasks import TaskSource, alike

DEFAULT = RECIPES["default"]


@pytest.fixture(scope="module")
def bones(world: TrainingSet) -> torch.Tensor:
    return motions.directions(list(world.clips[:12]))


def chance(seed: int = 0) -> torch.Generator:
    return torch.Generator().manual_seed(seed)


def test_training_sees_what_inference_prepares(world: TrainingSet, bones: torch.Tensor) -> None:
    theirs = motions.frames_for_model(bones, DEFAULT.config.preparation)
    ours = np.stack([prepare(clip, DEFAULT.config.preparation) for clip in world.clips[:12]])
    # Training goes by way of 64 frames, so the two differ by interpolation.
    assert np.abs(theirs.numpy() - ours).mean() < 0.02


def test_mirroring_twice_changes_nothing(bones: torch.Tensor) -> None:
    torch.testing.assert_close(motions.mirrored(motions.mirrored(bones)), bones)
    assert (motions.mirrored(bones) - bones).abs().max() > 0.1


@pytest.mark.parametrize(
    "step", ["warp_time", "swap_limbs", "freeze_bones", "disturb", "exaggerate", "turn", "augment"]
)
def test_augmentation_keeps_shape_and_leaves_its_input(step: str, bones: torch.Tensor) -> None:
    before = bones.clone()
    after = getattr(augment, step)(bones, chance())
    assert after.shape == bones.shape
    assert torch.isfinite(after).all()
    torch.testing.assert_close(bones, before)
    again = getattr(augment, step)(bones, chance())
    torch.testing.assert_close(after, again)


def test_augmented_bones_keep_their_length(bones: torch.Tensor) -> None:
    lengths = torch.linalg.vector_norm(augment.augment(bones, chance()), dim=-1)
    torch.testing.assert_close(lengths, torch.ones_like(lengths), atol=1e-3, rtol=0)


def test_augmentation_is_mild_enough_to_recognise_the_motion(bones: torch.Tensor) -> None:
    moved = augment.augment(bones, chance(3)).flatten(1)
    apart = torch.cdist(moved, bones.flatten(1))
    # Clips 2k and 2k + 1 are the same action by the same performer.
    action = torch.arange(12) // 6
    assert (action[apart.argmin(dim=1)] == action).float().mean() > 0.8


def test_swapped_limbs_are_exchanged_for_some_frames(bones: torch.Tensor) -> None:
    many = bones[:1].repeat(60, 1, 1, 1)
    swapped = augment.swap_limbs(many, chance())
    changed = (swapped != many).any(dim=3).any(dim=2).sum(dim=1)
    assert 0 < (changed > 0).sum() < 20
    assert changed.max() <= 14
    clip = int(changed.argmax())
    frame = int((swapped[clip] != many[clip]).any(dim=2).any(dim=1).nonzero()[0])
    arms = motions.LEFT_ARM, motions.RIGHT_ARM
    legs = motions.LEFT_LEG, motions.RIGHT_LEG
    assert any(
        torch.equal(swapped[clip, frame, left], many[clip, frame, right])
        and torch.equal(swapped[clip, frame, right], many[clip, frame, left])
        for left, right in (arms, legs)
    )


def test_tasks_have_the_ways_they_say(world: TrainingSet) -> None:
    source = TaskSource(world)
    rng = np.random.default_rng(0)
    lent = 0
    for _ in range(10):
        ways, clips = source.draw(12, rng)
        assert len(ways) == 12
        assert clips.shape == (2, 12, 64, 14, 3)
        plain = [(way.base, way.mirrored) for way in ways if way.lender is None]
        assert len({base for base, _ in plain}) == len(plain)
        lent += sum(way.lender is not None for way in ways)
    assert lent > 10


def test_tasks_of_few_classes_are_filled_with_made_ones(world: TrainingSet) -> None:
    ways, clips = TaskSource(world.of_classes([0, 1, 2])).draw(9, np.random.default_rng(0))
    assert len(ways) == clips.shape[1] == 9


def test_ways_that_are_the_same_motion_are_left_out(world: TrainingSet) -> None:
    ways, clips = TaskSource(world).draw(6, np.random.default_rng(1))
    # The first way once more, enrolled by nearly the clip that asks.
    again = torch.stack([clips[1, :1], clips[1, :1]])
    same = alike([*ways, ways[0]], torch.cat([clips, again], dim=1))
    assert same[0, 6]
    assert not same[1:6, :6].any()
    assert not same.diagonal().any()


def test_long_recordings_become_windows(world: TrainingSet) -> None:
    alone = TrainingSet(
        (world.clips[0],), np.array([0]), np.array([0]), np.array([0]), ("world0/long",)
    )
    assert len(cut_long_recordings(alone).clips) == 1
    slow = type(world.clips[0])(world.clips[0].joints, world.clips[0].joint_names, fps=5)
    windows = cut_long_recordings(
        TrainingSet((slow,), np.array([0]), np.array([0]), np.array([0]), ("world0/long",))
    )
    assert len(windows.clips) == len(windows.classes) == round(slow.duration / 2.5) > 1
    assert sum(len(clip) for clip in windows.clips) == len(slow)
