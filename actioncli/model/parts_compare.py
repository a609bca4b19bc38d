"""From clips to the score of query and action with the part transformer, numpy only.

Comparing a query with an example in full takes about a millisecond. So an embedding also holds a
pooled vector, the means of keys and values over each half of the clip, weighted so that distances
between pooled vectors order examples nearly as the scores do; of more than `EXACT` examples only
the nearest by it are compared in full.

A squat of which only the upper half is seen may look like one, and like many other things. So
where much of one clip's motion is in parts that the other does not show, the two never match.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from actioncli.clips.clip import Clip, FloatArray
from actioncli.clips.parts import PARTS, prepare_parts
from actioncli.model import parts, parts_tokens
from actioncli.model.arrays import Params
from actioncli.model.config import PartsConfig

# Examples up to which every one is compared in full, and how many are beyond.
EXACT = 256
# Pairs of query and example that are compared in one piece: enough for full matrix speed, few
# enough that what is between the layers stays in the processor's cache.
_BLOCK_PAIRS = 24
# The share of a clip's motion that may lie in arms or legs which the other clip does not show, and
# the most that the logit of a pair beyond it can be, a confidence of .001. Of train classes of six
# collections, asked without legs, .613 of the arms' actions are accepted (.657 without this rule),
# .117 of the legs' (.675).
MOST_HIDDEN, _HIDDEN_LOGIT = 0.2, -7.0
_PAIRS = [[PARTS.index(f"{side} {limb}") for side in ("left", "right")] for limb in ("arm", "leg")]
# Columns of a token of the body that hold the deviation of its bones from the clip's mean.
_DEVIATION = slice(9, 18)


def embed(params: Params, config: PartsConfig, clips: Sequence[Clip]) -> FloatArray:
    """All that comparison needs of clips: key, value, presence and motion of each part's tokens,
    and the pooled vector, cut into as many pieces as there are tokens.

    Presence and motion are one number: 0 where a part was not seen, else 1 and by how much its
    bones deviate from their mean directions, squared.

    Returns:
        (N, T, E).

    Raises:
        ClipError: a clip lacks joints that the model reads.
    """
    embedded = np.empty((len(clips), config.tokens, config.embedding_width), np.float32)
    if len(clips):
        tokens = parts_tokens.tokens(config, *prepare_parts(clips, config.preparation))
        of_parts = parts.embed(params, config, tokens)
        moved = np.zeros_like(of_parts.present)
        moved[: tokens[0].shape[2], ..., 0] = (
            np.square(tokens[0][..., _DEVIATION]).sum(axis=-1).transpose(2, 0, 1)
        )
        joined = np.concatenate(
            [of_parts.keys, of_parts.values, of_parts.present * (1 + moved)], axis=-1
        ).transpose(1, 2, 0, 3)  # (N, T, P, 2W + 1)
        columns = config.token_width
        embedded[..., :columns] = joined.reshape(*embedded.shape[:2], columns)
        weighted = pooled(of_parts) * np.sqrt(params["pool.weight"])
        embedded[..., columns:] = weighted.reshape(*embedded.shape[:2], -1)
    return embedded


def pooled(clips: parts.Embedded) -> FloatArray:
    """Keys and values, mean over each half of the clip as far as a part was seen, (N, P, 4·W)."""
    both = np.concatenate([clips.keys, clips.values], axis=-1)
    p, n, t, w = both.shape
    halves = (p, n, 2, t // 2)
    seen = clips.present.reshape(*halves, 1)
    sums = (both.reshape(*halves, w) * seen).sum(axis=3)
    means = sums / np.maximum(seen.sum(axis=3), 1)
    return np.asarray(means.transpose(1, 0, 2, 3).reshape(n, p, 2 * w))


def scores(
    params: Params, config: PartsConfig, queries: FloatArray, actions: Sequence[FloatArray]
) -> tuple[FloatArray, FloatArray]:
    """Distance and logit of every query and action; of several examples the best one counts.

    Beyond `EXACT` examples those that are not compared in full are less likely than all that are.

    Args:
        queries: (Q, T, E) embeddings.
        actions: K times (n, T, E), the examples of each.

    Returns:
        distance (Q, K), the odds exp(-logit) against their being the same action, and logit
        (Q, K), whose sigmoid is the confidence.
    """
    count = sum(map(len, actions))
    if count <= EXACT:
        logit = _logits(params, config, queries, np.concatenate(actions))
    else:
        logit = np.empty((len(queries), count), np.float32)
        apart = pooled_distance(config, queries, actions)
        kept = np.argpartition(apart, EXACT, axis=1)[:, :EXACT]
        of, starts = _places(actions)
        for row, some in enumerate(kept):
            near = np.stack([actions[of[k]][k - starts[of[k]]] for k in some.tolist()])
            exact = _logits(params, config, queries[row : row + 1], near)[0]
            logit[row] = exact.min() - apart[row]
            logit[row, some] = exact
    starts = np.cumsum([0, *(len(action) for action in actions[:-1])])
    logit = np.maximum.reduceat(logit, starts, axis=1)
    return np.exp(np.minimum(-logit, 60)), logit


def _places(actions: Sequence[FloatArray]) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """The action of every example, and at which example each action begins."""
    counts = [len(action) for action in actions]
    return np.repeat(np.arange(len(actions)), counts), np.cumsum([0, *counts])


def pooled_distance(
    config: PartsConfig, queries: FloatArray, actions: Sequence[FloatArray]
) -> FloatArray:
    """Squared distance of pooled vectors over the parts that both clips show, (Q, examples)."""

    def vectors(embedded: FloatArray) -> FloatArray:
        return embedded[..., config.token_width :].reshape(len(embedded), len(PARTS), -1)

    asked, enrolled = vectors(queries), np.concatenate([vectors(action) for action in actions])
    # Σ over parts seen in both of |a|² + |b|² - 2·a·b, as one product; a part that was never seen
    # is zero.
    norms = [(x * x).sum(axis=2) for x in (asked, enrolled)]
    shown = [(norm > 0).astype(np.float32) for norm in norms]
    left = np.concatenate([shown[0], norms[0], -2 * asked.reshape(len(asked), -1)], axis=1)
    right = np.concatenate([norms[1], shown[1], enrolled.reshape(len(enrolled), -1)], axis=1)
    return np.asarray(np.maximum(left @ right.T, 0))


def _logits(
    params: Params, config: PartsConfig, queries: FloatArray, examples: FloatArray
) -> FloatArray:
    """Of every query and example, (Q, N)."""
    asked, enrolled = _unpacked(config, queries), _unpacked(config, examples)
    total, count = len(queries), len(examples)
    logit = np.empty((total, count), np.float32)
    wide = min(count, _BLOCK_PAIRS)
    high = max(1, _BLOCK_PAIRS // max(wide, 1))
    for row in range(0, total, high):
        some = parts.Embedded(*(x[:, row : row + high] for x in asked))
        for column in range(0, count, wide):
            beside = parts.Embedded(*(x[:, column : column + wide] for x in enrolled))
            block = np.s_[row : row + high, column : column + wide]
            logit[block] = parts.logits(params, config, some, beside)
    logit = np.asarray(logit * params["confidence.scale"] + params["confidence.shift"])
    unseen = hidden(config, queries, examples) > MOST_HIDDEN
    return np.where(unseen, np.minimum(logit, np.float32(_HIDDEN_LOGIT)), logit)


def _unpacked(config: PartsConfig, embedding: FloatArray) -> parts.Embedded:
    w = config.key_width
    tokens = embedding[..., : config.token_width]
    each = tokens.reshape(*tokens.shape[:2], len(PARTS), 2 * w + 1).transpose(2, 0, 1, 3)
    keys, values, seen = np.split(each, [w, 2 * w], axis=-1)
    present = (seen > 0).astype(np.float32)
    return parts.Embedded(*map(np.ascontiguousarray, (keys, values, present)))


def hidden(config: PartsConfig, queries: FloatArray, examples: FloatArray) -> FloatArray:
    """The share of a clip's motion that lies in arms or legs of which the other clip shows neither
    side most of the time, of query and example the larger one, (Q, N)."""
    unseen, shares = [], []
    for embedding in (queries, examples):
        tokens = embedding[..., : config.token_width]
        seen = tokens.reshape(*tokens.shape[:2], len(PARTS), -1)[..., -1]  # (N, T, P)
        gone = (seen == 0).mean(axis=1)[:, _PAIRS].min(axis=2) > 0.5
        motion = np.maximum(seen - 1, 0).sum(axis=1)
        unseen.append(gone.astype(np.float32))
        shares.append(motion[:, _PAIRS].sum(axis=2) / (motion.sum(axis=1, keepdims=True) + 1e-6))
    return np.asarray(np.maximum(unseen[0] @ shares[1].T, shares[0] @ unseen[1].T))
