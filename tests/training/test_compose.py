from __future__ import annotations

import numpy as np
import pytest
import torch

from actioncli.training.augment import LEGS, Batch
from actioncli.training.compose import composed, followed_by, where, with_legs_of


@pytest.fixture
def batch() -> Batch:
    generator = torch.Generator().manual_seed(0)
    bones = torch.nn.functional.normalize(torch.randn(6, 48, 14, 3, generator=generator), dim=-1)
    missing = torch.zeros(6, 48, 7, dtype=torch.bool)
    missing[1, :, 3:] = True
    return Batch(bones, torch.zeros(6, 48, 40, 3), missing)


def test_legs_of_another_come_with_whether_they_were_seen(batch: Batch) -> None:
    other = batch.rows(torch.tensor([1, 0, 2, 3, 4, 5]))
    made = with_legs_of(batch, other)
    others = [bone for bone in range(14) if bone not in LEGS]
    torch.testing.assert_close(made.bones[0][:, LEGS], batch.bones[1][:, LEGS])
    torch.testing.assert_close(made.bones[0][:, others], batch.bones[0][:, others])
    assert made.missing[0, :, 3:5].all()
    assert not made.missing[1].any(dim=0)[3:5].any()
    assert made.missing[1, :, 5:].all()


def test_one_action_then_another(batch: Batch) -> None:
    made = followed_by(batch, batch.rows(torch.arange(6).flip(0)))
    for half, clip in ((slice(0, 24), 0), (slice(24, 48), 5)):
        for end, frame in ((0, 0), (-1, 47)):
            torch.testing.assert_close(made.bones[0, half][end], batch.bones[clip, frame])


def test_support_and_query_of_a_place_are_made_of_the_same_two(batch: Batch) -> None:
    kinds = set()
    for seed in range(40):
        supports, queries = composed([batch, batch], np.random.default_rng(seed))
        torch.testing.assert_close(supports, queries)
        changed = (supports.bones != batch.bones).any(3).any(0).any(0)
        kinds.add("none" if not changed.any() else "legs" if not changed[0] else "half")
    assert kinds == {"none", "legs", "half"}
    alone = batch.rows(slice(0, 1))
    assert composed([alone, alone], np.random.default_rng(0))[0] is alone


def test_where_takes_whole_clips(batch: Batch) -> None:
    chosen = torch.tensor([True, False, False, False, False, True])
    made = where(chosen, batch._replace(bones=-batch.bones), batch)
    torch.testing.assert_close(made.bones[0], -batch.bones[0])
    torch.testing.assert_close(made.bones[1:5], batch.bones[1:5])
