"""Why a clip is as like an action as it is: which body parts and which moments speak for it.

What a part contributes to the score is what the score, the logit of the confidence, loses where
the part is taken out of both clips as if nobody had seen it; what a moment contributes, what it
loses where the moment is taken out of the query. A part with a negative contribution speaks
against the action. Contributions need not add up to the score: two arms that do the same can each
be spared.

What would have had to be alike is asked of the model too: parts of the query take the place of what
they were in the example, and the score is computed anew.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from actioncli.clips.clip import Clip
from actioncli.clips.edit import cut
from actioncli.clips.parts import PARTS, PartFrames, prepare_parts
from actioncli.errors import WeightsError
from actioncli.model import parts, parts_compare, parts_tokens
from actioncli.model.arrays import sigmoid
from actioncli.model.config import PartsConfig
from actioncli.model.parts_tokens import PART_BONES
from actioncli.recognition.decision import Decision, compared
from actioncli.recognition.recognizer import Recognizer
from actioncli.store.store import SupportStore

# Parts that are exchanged together, at most: beyond, little of the query would be left.
_EXCHANGED = 3


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
        exchanged: the confidence if these parts had moved as in the example, of one to three.
        hidden: whether too much of what moves in one clip is out of view in the other, which
            rejects whatever the score.
    """

    example: int
    score: float
    parts: dict[str, float]
    moments: NDArray[np.float64]
    attention: NDArray[np.float64]
    exchanged: Mapping[tuple[str, ...], float]
    hidden: bool = False

    def lacking(self, tau: float) -> str:
        """What would have had to be alike for a confidence above tau, the fewest parts: `with both
        arms as in the example it would have been accepted (confidence 0.61 > tau 0.50)`."""
        if self.hidden:
            return "much of what moves in it or in the example is out of view in the other"
        enough = {names: sure for names, sure in self.exchanged.items() if sure > tau}
        if not enough:
            return "most of the body moves in another way"
        parts = min(enough, key=lambda names: (len(names), -enough[names]))
        return (
            f"with {listed(parts)} as in the example it would have been accepted "
            f"({compared(enough[parts], tau)})"
        )


def listed(parts: Sequence[str]) -> str:
    """`the torso and both arms`."""
    both = {
        kind for kind in ("arm", "leg", "hand") if {f"left {kind}", f"right {kind}"} <= {*parts}
    }
    names = [f"the {name}" for name in parts if name.split()[-1] not in both]
    names += [f"both {kind}s" for kind in ("arm", "leg", "hand") if kind in both]
    return names[0] if len(names) == 1 else f"{', '.join(names[:-1])} and {names[-1]}"


def explain_decision(
    recognizer: Recognizer, store: SupportStore, clip: Clip, decision: Decision
) -> tuple[Explanation, Clip]:
    """Take the score of a decision's nearest action apart; and the part of the clip it is about.

    Raises:
        ClipError, WeightsError: as `explain`.
        SupportError: the action was removed meanwhile.
        StoreError: the store cannot be read.
    """
    if decision.part is not None:
        clip = cut(clip, *(at - clip.start for at in decision.part))
    examples = [store.clip(example.id) for example in store.examples(decision.nearest)]
    return explain(recognizer, clip, examples), clip


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
    each = {str(number): recognizer.embed([clip]) for number, clip in enumerate(examples)}
    asked_whole = recognizer.embed([query])
    example = int(recognizer.compare(asked_whole, each).confidence[0].argmax())
    hidden = parts_compare.hidden(config, asked_whole, each[str(example)])
    frames = prepare_parts([query, examples[example]], config.preparation)
    body, hands, gone = parts_tokens.tokens(config, *frames)
    p, t = gone.shape[1:]
    shown = np.flatnonzero((gone < 1).any(axis=2).all(axis=0))
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
        exchanged=_exchanged(recognizer, config, frames, [PARTS[part] for part in shown]),
        hidden=bool(hidden[0, 0] > parts_compare.MOST_HIDDEN),
    )


def _exchanged(
    recognizer: Recognizer, config: PartsConfig, frames: PartFrames, shown: Sequence[str]
) -> dict[tuple[str, ...], float]:
    """The confidence in the example, row 1, where some parts of the query, row 0, are as there."""
    params = recognizer.weights.tensors
    sets = [names for n in range(1, _EXCHANGED + 1) for names in combinations(shown, n)]
    bones, hands, missing = (np.repeat(each[:1], len(sets), axis=0) for each in frames)
    for row, names in enumerate(sets):
        for part in map(PARTS.index, names):
            missing[row, :, part] = frames.missing[1, :, part]
            if part < len(PART_BONES):
                at = list(PART_BONES[part])
                bones[row, :, at] = frames.bones[1, :, at]
            else:
                half = slice(20 * (part - len(PART_BONES)), None)
                hands[row, :, half][:, :20] = frames.hands[1, :, half][:, :20]
    asked = parts.embed(params, config, parts_tokens.tokens(config, bones, hands, missing))
    bones, hands, missing = (np.repeat(each[1:], len(sets), axis=0) for each in frames)
    enrolled = parts.embed(params, config, parts_tokens.tokens(config, bones, hands, missing))
    logits = parts.paired_logits(params, config, asked, enrolled)
    sure = sigmoid(logits * params["confidence.scale"] + params["confidence.shift"])
    return dict(zip(sets, sure.tolist(), strict=True))
