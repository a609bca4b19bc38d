"""From clips to the score of query and action with the part transformer, numpy only."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from actioncli.clips.clip import Clip, FloatArray
from actioncli.clips.parts import PARTS, prepare_parts
from actioncli.model import parts, parts_tokens
from actioncli.model.arrays import Params
from actioncli.model.config import PartsConfig

# Pairs of query and example that are compared in one piece: enough for full matrix speed, few
# enough that what is between the layers stays in the processor's cache.
_BLOCK_PAIRS = 24


def embed(params: Params, config: PartsConfig, clips: Sequence[Clip]) -> FloatArray:
    """All that comparison needs of clips: key, value and presence of each part's tokens.

    Returns:
        (N, T, E).

    Raises:
        ClipError: a clip lacks joints that the model reads.
    """
    embedded = np.empty((len(clips), config.tokens, config.embedding_width), np.float32)
    if len(clips):
        tokens = parts_tokens.tokens(config, *prepare_parts(clips, config.preparation))
        joined = np.concatenate(parts.embed(params, config, tokens), axis=-1)  # (P, N, T, 2W + 1)
        embedded[:] = joined.transpose(1, 2, 0, 3).reshape(embedded.shape)
    return embedded


def scores(
    params: Params, config: PartsConfig, queries: FloatArray, actions: Sequence[FloatArray]
) -> tuple[FloatArray, FloatArray]:
    """Distance and logit of every query and action; of several examples the best one counts.

    Args:
        queries: (Q, T, E) embeddings.
        actions: K times (n, T, E), the examples of each.

    Returns:
        distance (Q, K), the odds exp(-logit) against their being the same action, and logit
        (Q, K), whose sigmoid is the confidence.
    """
    examples = _unpacked(config, np.concatenate(actions))
    asked = _unpacked(config, queries)
    total, count = len(queries), examples.keys.shape[1]
    logit = np.empty((total, count), np.float32)
    wide = min(count, _BLOCK_PAIRS)
    high = max(1, _BLOCK_PAIRS // wide)
    for row in range(0, total, high):
        some = parts.Embedded(*(x[:, row : row + high] for x in asked))
        for column in range(0, count, wide):
            beside = parts.Embedded(*(x[:, column : column + wide] for x in examples))
            block = np.s_[row : row + high, column : column + wide]
            logit[block] = parts.logits(params, config, some, beside)
    logit = logit * params["confidence.scale"] + params["confidence.shift"]
    starts = np.cumsum([0, *(len(action) for action in actions[:-1])])
    logit = np.maximum.reduceat(logit, starts, axis=1)
    return np.exp(np.minimum(-logit, 60)), logit


def _unpacked(config: PartsConfig, embedding: FloatArray) -> parts.Embedded:
    w = config.key_width
    each = embedding.reshape(*embedding.shape[:2], len(PARTS), 2 * w + 1).transpose(2, 0, 1, 3)
    keys, values, present = np.split(each, [w, 2 * w], axis=-1)
    return parts.Embedded(*map(np.ascontiguousarray, (keys, values, present)))
