"""Bones, tasks and augmentation of the default recipe: bodies stay bodies."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

import numpy as np
import pytest
import torch

from actioncli.clips.clip import Clip
from actioncli.clips.prepare import Preparation, prepare
from actioncli.clips.skeleton import DEFAULT_JOINTS
from actioncli.training import augment, estimator, motions
from actioncli.training.data import TrainingSet, cut_long_recordings
from actioncli.training.default import DefaultRecipe
from actioncli.training.tasks import TaskSource, alike

DEFAULT = DefaultRecipe()


@pytest.fixture(scope="module")
def bones(world: TrainingSet) -> torch.Tensor:
    return motions.directions(list(world.clips[:12]), DEFAULT.config.preparation)


def chance(seed: int = 0) -> torch.Generator:
    return torch.Generator().manual_seed(seed)


def test_training_sees_what_inference_prepares(world: TrainingSet, bones: torch.Tensor) -> None:
    how = DEFAULT.config.preparation
    lengths = motions.bone_lengths(list(world.clips[:12]), how)
    theirs = motions.frames_for_model(bones, how, lengths)
    ours = np.stack([prepare(clip, DEFAULT.config.preparation) for clip in world.clips[:12]])
    # Training goes by way of 64 frames, so the two differ by interpolation.
    assert np.abs(theirs.numpy() - ours).mean() < 0.02


def task_source(data: TrainingSet) -> TaskSource:
    return TaskSource(data, DEFAULT.config.preparation)


@pytest.mark.parametrize(
    "step",
    [
        augment.warp_time,
        augment.swap_limbs,
        augment.freeze_bones,
        augment.disturb,
        augment.exaggerate,
        augment.turn,
        estimator.mistake_depth,
        estimator.hide,
        estimator.lag,
        partial(augment.augment, estimated=0.5),
    ],
)
def test_augmentation_keeps_shape_and_leaves_its_input(
    step: Callable[[torch.Tensor, torch.Generator], torch.Tensor], bones: torch.Tensor
) -> None:
    before = bones.clone()
    after = step(bones, chance())
    assert after.shape == bones.shape
    assert torch.isfinite(after).all()
    torch.testing.assert_close(bones, before)
    again = step(bones, chance())
    torch.testing.assert_close(after, again)


def test_augmented_bones_keep_their_length(bones: torch.Tensor) -> None:
    lengths = torch.linalg.vector_norm(augment.augment(bones, chance(), 0.5), dim=-1)
    torch.testing.assert_close(lengths, torch.ones_like(lengths), atol=1e-3, rtol=0)


def test_augmentation_is_mild_enough_to_recognise_the_motion(bones: torch.Tensor) -> None:
    moved = augment.augment(bones, chance(3), 0.5).flatten(1)
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


def test_a_share_of_the_clips_is_seen_by_an_estimator(bones: torch.Tensor) -> None:
    none, half, every = (augment.augment(bones, chance(), share) for share in (0.0, 0.5, 1.0))
    assert (none != every).flatten(1).any(dim=1).all()
    same = (half == every).flatten(1).all(dim=1)
    assert 0 < same.sum() < len(bones)


def test_an_estimator_errs_in_depth(bones: torch.Tensor) -> None:
    error = (
        estimator.mistake_depth(bones.repeat(8, 1, 1, 1), chance()) - bones.repeat(8, 1, 1, 1)
    ).abs()
    across, up, deep = error.mean(dim=(0, 1, 2)).tolist()
    assert deep > 1.3 * across
    assert deep > 1.3 * up


def test_what_is_out_of_sight_hardly_moves(bones: torch.Tensor) -> None:
    many = bones.repeat(6, 1, 1, 1)
    still = estimator.hide(many, chance()).std(dim=1).sum(dim=2) / many.std(dim=1).sum(dim=2)
    unseen = still < 0.6
    assert 0.05 < unseen.any(dim=1).float().mean() < 0.6
    assert unseen.sum(dim=1).max() <= 4


def test_lag_follows_late_and_smooths(bones: torch.Tensor) -> None:
    slow = estimator.lag(bones, chance())
    assert slow.diff(dim=1).abs().mean() < bones.diff(dim=1).abs().mean()
    behind = (slow[:, 4:] - bones[:, 3:-1]).abs().mean()
    ahead = (slow[:, 3:-1] - bones[:, 4:]).abs().mean()
    assert behind < ahead


def test_tasks_have_the_ways_they_say(world: TrainingSet) -> None:
    source = task_source(world)
    rng = np.random.default_rng(0)
    for _ in range(10):
        clips, lengths = source.draw(6, rng)
        assert clips.shape == (2, 6, 64, 14, 3)
        assert lengths.shape == (2, 6, 14)


def test_tasks_of_few_classes_have_few_ways(world: TrainingSet) -> None:
    clips, _ = task_source(world.of_classes([0, 1, 2])).draw(9, np.random.default_rng(0))
    assert clips.shape[1] == 3


def test_a_collection_of_one_class_is_never_asked_alone(world: TrainingSet) -> None:
    # Classes 0 to 7 are of one collection, 8 of the other.
    source = task_source(world.of_classes([*range(8), 8]))
    counts = [source.draw(5, np.random.default_rng(seed))[0].shape[1] for seed in range(30)]
    assert set(counts) == {5}


def test_bones_are_as_long_as_the_preparation_says(bones: torch.Tensor) -> None:
    own = motions.LENGTHS * torch.linspace(0.8, 1.2, 14)[:, None]
    joints = motions.bodies(bones[:3], own).numpy()
    clips = [Clip(body, DEFAULT_JOINTS) for body in joints]
    standard = motions.bone_lengths(clips, DEFAULT.config.preparation)
    torch.testing.assert_close(standard, motions.LENGTHS[:, 0].expand(3, -1))
    how = Preparation(frames=48, size="torso", heading=True, motion=0.5)
    lengths = motions.bone_lengths(clips, how)
    frames = motions.frames_for_model(motions.directions(clips, how), how, lengths)
    ours = np.stack([prepare(clip, how) for clip in clips])
    # Where a limb swings, `prepare` interpolates it too short.
    assert np.abs(frames.numpy() - ours).mean() < 0.03
    assert np.abs(motions.bodies(bones[:3]).numpy()[:, 0] - ours[:, 0]).mean() > 0.03


def test_ways_that_are_the_same_motion_are_left_out(world: TrainingSet) -> None:
    clips, _ = task_source(world).draw(6, np.random.default_rng(1))
    # The first way once more, enrolled by nearly the clip that asks.
    again = torch.stack([clips[1, :1], clips[1, :1]])
    same = alike(torch.cat([clips, again], dim=1))
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
