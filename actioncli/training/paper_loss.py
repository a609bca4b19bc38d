"""The paper's losses, on torch tensors; the forward pass is the one of inference."""

from __future__ import annotations

import torch
from torch import Tensor
from torch.nn import functional

from actioncli.model import trx_os
from actioncli.model.config import ModelConfig


def episode_loss(
    params: dict[str, Tensor],
    config: ModelConfig,
    support: Tensor,
    queries: Tensor,
    targets: Tensor,
) -> tuple[Tensor, float]:
    """Cross-entropy over -T, plus the discriminator's binary cross-entropy.

    The discriminator learns from the z known queries whose nearest action is right (it should
    say yes) and from z unknown ones against their nearest action (it should say no).

    Args:
        support: (B, K, F, J, 3) prepared frames, one clip per action.
        queries: (B, Q, F, J, 3).
        targets: (B, Q) place of the query's action, -1 for an unknown one.

    Returns:
        the loss, and the share of known queries whose nearest action is right.
    """
    batch, ways = support.shape[:2]
    asked = queries.shape[1]
    frames = torch.cat([support, queries], dim=1).flatten(0, 1)
    features = trx_os.with_positions(config, trx_os.psi(params, frames))
    keys, values = (
        of_pairs.unflatten(0, (batch, ways + asked))
        for of_pairs in trx_os.pairs(params, config, trx_os.project(params, config, features))
    )
    pair_count = keys.shape[2]
    # All queries of an episode attend to a support clip in one product: (B, K, Q·P, W).
    query_keys = keys[:, ways:].flatten(1, 2)[:, None]
    weights = trx_os.attention(query_keys, keys[:, :ways])
    prototype = trx_os.prototypes(weights, values[:, :ways])
    prototype = prototype.unflatten(2, (asked, pair_count)).transpose(1, 2)
    difference = values[:, ways:, None] - prototype  # (B, Q, K, P, W)
    distances = trx_os.distance(difference)
    known = targets >= 0
    loss = functional.cross_entropy(-distances[known], targets[known])
    nearest = distances.argmin(dim=2)
    right = known & (nearest == targets)
    chosen = difference.gather(
        2, nearest[..., None, None, None].expand(-1, -1, 1, *difference.shape[3:])
    )[:, :, 0]
    z = int(min(right.sum(), (~known).sum()))
    if z:
        judged = torch.cat([chosen[right][:z], chosen[~known][:z]])
        logits = trx_os.discriminator(params, judged)
        same = (torch.arange(2 * z, device=logits.device) < z).to(logits.dtype)
        loss = loss + functional.binary_cross_entropy_with_logits(logits, same)
    return loss, float(right.sum() / known.sum())
