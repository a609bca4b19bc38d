"""The pooled vector's weights: fitted so that distances order examples as the scores do."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import torch

from actioncli.clips.clip import Clip, FloatArray
from actioncli.clips.parts import PARTS, prepare_parts
from actioncli.model import parts, parts_compare, parts_tokens
from actioncli.model.arrays import Params
from actioncli.model.config import PartsConfig

# Of the clips, how many ask; steps of Adam and their rate.
_ASKED, _STEPS, _RATE = 96, 300, 0.05


def pool_weight(params: Params, config: PartsConfig, clips: Sequence[Clip]) -> FloatArray:
    """Weights of the squared differences between pooled vectors, (P, 4·W), by distillation.

    With s the scores of a query and all clips but itself, and d the weighted squared distances, the
    cross-entropy of softmax(-d) to softmax(s) is minimised.

    Args:
        params: what training learned.
        clips: N training clips of many classes, in random order.
    """
    tokens = parts_tokens.tokens(config, *prepare_parts(clips, config.preparation))
    embedded = parts.embed(params, config, tokens)
    asked = min(_ASKED, len(clips) - 1)
    scores = [
        parts.logits(params, config, parts.Embedded(*(x[:, k : k + 1] for x in embedded)), embedded)
        for k in range(asked)
    ]
    target = torch.from_numpy(np.concatenate(scores))
    vectors = torch.from_numpy(parts_compare.pooled(embedded))  # (N, P, 4W)
    shown = (vectors != 0).any(dim=2, keepdim=True)
    apart = (vectors[:asked, None] - vectors) ** 2 * (shown[:asked, None] & shown)
    apart = apart.flatten(2)  # (asked, N, P·4W)
    itself = torch.eye(asked, len(clips), dtype=torch.bool)
    wanted = torch.softmax(target.masked_fill(itself, -1e4), 1)
    logarithm = torch.full((apart.shape[2],), -2.0, requires_grad=True)
    optimizer = torch.optim.Adam([logarithm], _RATE)
    for _ in range(_STEPS):
        near = torch.log_softmax((-(apart @ logarithm.exp())).masked_fill(itself, -1e4), 1)
        loss = -(wanted * near).sum(1).mean()
        optimizer.zero_grad()
        loss.backward()  # type: ignore[no-untyped-call]  # torch declares no types here
        optimizer.step()
    weight = logarithm.detach().exp().numpy()
    return np.asarray(weight.reshape(len(PARTS), -1), np.float32)
