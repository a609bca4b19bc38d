"""Why a clip is as like an action as it is: which body parts and which moments speak for it.

What a part contributes to the score is what the score, the logit of the confidence, loses where
the part is taken out of both clips as if nobody had seen it; what a moment contributes, what it
loses where the moment is taken out of the query. A part with a negative contribution speaks
against the action. Contributions need not add up to the score: two arms that do the same can each
be spared.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from actioncli.clips.clip import Clip
from actioncli.clips.parts import PARTS, prepare_parts
from actioncli.errors import WeightsError
from actioncli.model import parts, parts_tokens
from actioncli.model.config import PartsConfig
from actioncli.recognition.recognizer import Recognizer


@dataclass(frozen=True, slots=True, eq=False)
class Explanation:
    """The score of a query and an action, taken apart.

    Attributes:
        example: which of the action's examples the query is nearest to.
        score: the logit; above 0 where the confidence is above 0.5.
        parts: what each part that both clips show contributes to the score.
        moments: (T,) what equal stretches of the prepared query contribute.
        attention: (T, T) share of the query's attention to the example's moments, mean over the
            parts that both show; rows add up to 1.
    """

    example: int
    score: float
    parts: dict[str, float]
    moments: NDArray[np.float64]
    attention: NDArray[np.float64]


def explain(recognizer: Recognizer, query: Clip, examples: Sequence[Clip]) -> Explanation:
    """Take the score of a query and an action apart.

    Args:
        recognizer: whose score.
        query: the clip.
        examples: all enrolled clips of the action.

    Raises:
        ClipError: a clip lacks joints that the model reads.
        WeightsError: the weights are of another recipe.
    """
    params, config = recognizer.weights.tensors, recognizer.weights.config
    if not isinstance(config, PartsConfig):
        raise WeightsError(f"{recognizer.weights.path}: only weights of recipe default explain.")
    each = {str(number): [clip] for number, clip in enumerate(examples)}
    example = int(recognizer.compare([query], each).confidence[0].argmax())
    frames = prepare_parts([query, examples[example]], config.preparation)
    body, hands, gone = parts_tokens.tokens(config, *frames)
    p, t = gone.shape[1:]
    # Row 0 is as it is, then each part is left out of both, then each moment of the query.
    left_out = np.repeat(gone[:, None], 1 + p + t, axis=1)
    left_out[:, range(1, 1 + p), range(p)] = 1
    left_out[0, range(1 + p, 1 + p + t), :, range(t)] = 1
    asked, enrolled = (
        parts.embed(
            params,
            config,
            (*(np.repeat(x[[of]], len(rows), axis=0) for x in (body, hands)), rows),
        )
        for of, rows in enumerate(left_out)
    )
    logits = parts.paired_logits(params, config, asked, enrolled)
    scores = (logits * params["confidence.scale"] + params["confidence.shift"]).astype(np.float64)
    lost = scores[0] - scores[1:]
    shown = np.flatnonzero((gone < 1).any(axis=2).all(axis=0))
    query_rows, example_rows = (
        parts.Embedded(*(x[:, :1] for x in embedded)) for embedded in (asked, enrolled)
    )
    attention = parts.attention(params, config, query_rows, example_rows)[shown, 0].mean(axis=0)
    return Explanation(
        example=example,
        score=float(scores[0]),
        parts={PARTS[part]: float(lost[part]) for part in shown},
        moments=lost[p:],
        attention=attention.astype(np.float64),
    )
