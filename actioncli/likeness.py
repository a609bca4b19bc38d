"""Does an example look like its action? How people notice a bad clip, or two actions that the
skeleton cannot tell apart."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from actioncli.decision import Decision
    from actioncli.threshold import Threshold


def doubts(decision: Decision, label: str, threshold: Threshold) -> list[str]:
    """What speaks against an example of `label`.

    Args:
        decision: on the example, with the support set that lacks it.
        label: the action that it should show; it is not ranked where this is its only example.
        threshold: what confidence must exceed.

    Returns:
        Sentences without a full stop; none where all is well.
    """
    own = next((ranked for ranked in decision.ranking if ranked.label == label), None)
    found = []
    if own is not None and own.confidence <= threshold.of(label):
        found.append(f"unlike the other examples of `{label}`, {own.confidence:.2f}")
    if own is not None and decision.shadowed:
        found.append("closest to a negative")
    nearest = decision.ranking[0]
    if own is not None and nearest.label != label:
        found.append(f"closest to `{nearest.label}`, {nearest.confidence:.2f}")
        return found
    others = [ranked for ranked in decision.ranking if ranked.label != label]
    like = max(others, key=lambda ranked: ranked.confidence, default=None)
    if like is not None and like.confidence > threshold.of(like.label):
        close = "closest to" if own is None else "also like"
        found.append(f"{close} `{like.label}`, {like.confidence:.2f}")
    return found
