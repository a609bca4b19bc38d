"""From clips to the score of query and action with TRX-OS as published, numpy only."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from actioncli.clips.clip import Clip, FloatArray
from actioncli.clips.prepare import prepare_all
from actioncli.model import trx_os
from actioncli.model.arrays import Params
from actioncli.model.config import ModelConfig


def embed(params: Params, config: ModelConfig, clips: Sequence[Clip]) -> FloatArray:
    """Projected tokens of clips.

    Returns:
        (N, F, 4·W).

    Raises:
        ClipError: a clip lacks joints that the model reads.
    """
    features = trx_os.psi(params, prepare_all(clips, config.preparation))
    projected = trx_os.project(params, config, trx_os.with_positions(config, features))
    return np.asarray(projected, np.float32)


def scores(
    params: Params, config: ModelConfig, queries: FloatArray, actions: Sequence[FloatArray]
) -> tuple[FloatArray, FloatArray]:
    """Distance and logit of every query and action; all examples of an action are attended to
    together.

    Args:
        queries: (Q, F, E) embeddings.
        actions: K times (n, F, E), the examples of each.

    Returns:
        T (Q, K), and the discriminator's logit (Q, K), whose sigmoid is the confidence.
    """
    distance = np.empty((len(queries), len(actions)), np.float32)
    features = []
    query_keys, query_values = trx_os.pairs(params, config, queries)
    for column, action in enumerate(actions):
        of_pairs = trx_os.pairs(params, config, action)
        keys, values = (each.reshape(-1, config.key_width) for each in of_pairs)
        difference = query_values - trx_os.attention(query_keys, keys) @ values
        distance[:, column] = trx_os.distance(difference)
        features.append(trx_os.tuple_features(params, difference))
    # The largest layer of Disc is read once for all.
    return distance, trx_os.judge(params, np.stack(features, axis=1))
