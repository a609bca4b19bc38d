"""The model's configuration: saved inside the weights, so that they say how to be used."""

from __future__ import annotations

import json
from dataclasses import asdict, dataclass, field
from typing import Literal

from actioncli.clips.prepare import BONES, Preparation
from actioncli.errors import WeightsError


@dataclass(frozen=True, slots=True)
class ModelConfig:
    """Sizes and switches of TRX-OS. The defaults are the paper's; all else is an addition.

    Attributes:
        preparation: what happens to a clip before the first layer.
        width: D, length of a token's feature vector after Ψ.
        key_width: W, length of keys, queries and values of a pair.
        tuple_width: features per pair that the discriminator keeps.
        distance: "l2" averages the norms of the pairs' differences, as the paper writes T;
            "squared" averages their squares, as the authors' code does.
        tokens: F, what pairs are formed of; each is `preparation.frames / tokens` neighbouring
            frames. The paper's tokens are single frames.
        body_features: beside joint positions, Ψ reads bone directions, velocities and deviations
            from the clip's mean pose. Needs bodies of standard size.
        convolutions: residual temporal convolutions in Ψ, with a layer norm behind them and
            positions that are learned; 0 is the paper's MLP.
        both_ways: the support's pairs attend to the query's too, and T is the mean of both.
        near_pairs: attention prefers pairs at like places in both clips, by a learned amount.
        warp_width: V, numbers per token that dynamic time warping compares; its cost joins T in
            the score. 0 leaves it out. Needs bodies of standard size.
        neighbours: the warping cost is seen relative to the mean cost to so many nearest motions
            of the cohort in the weights; 0 leaves the cohort out.
        mirrored: factor on the distance of a query that fits better when left and right are
            exchanged; 0 never exchanges them.
    """

    preparation: Preparation = field(default_factory=Preparation)
    width: int = 256
    key_width: int = 128
    tuple_width: int = 16
    distance: Literal["l2", "squared"] = "squared"
    tokens: int = 16
    body_features: bool = False
    convolutions: int = 0
    both_ways: bool = False
    near_pairs: bool = False
    warp_width: int = 0
    neighbours: int = 0
    mirrored: float = 0.0

    @property
    def inputs(self) -> int:
        """Numbers per token that Ψ reads: J·3 for the paper's model."""
        numbers = 12 * len(BONES) if self.body_features else 3 * len(self.preparation.joints)
        return numbers * (self.preparation.frames // self.tokens)

    @property
    def pairs(self) -> int:
        """P, ordered pairs of tokens."""
        return self.tokens * (self.tokens - 1) // 2

    @property
    def view_width(self) -> int:
        """Numbers per token of a clip seen as it is, or mirrored: both pair maps and the warp."""
        return 4 * self.key_width + self.warp_width

    @property
    def embedding_width(self) -> int:
        """E, numbers per token of an embedding: one view or two, and the cohort radius."""
        return (2 if self.mirrored else 1) * self.view_width + bool(self.neighbours)

    def to_json(self) -> str:
        """The configuration as it stands in the header of a weights file."""
        return json.dumps(asdict(self), sort_keys=True)

    @classmethod
    def from_json(cls, text: str) -> ModelConfig:
        """Inverse of `to_json`.

        Raises:
            WeightsError: not JSON, or keys that this version does not know.
        """
        try:
            values = json.loads(text)
            preparation = values.pop("preparation")
            preparation["joints"] = tuple(preparation["joints"])
            return cls(preparation=Preparation(**preparation), **values)
        except (ValueError, TypeError, KeyError, AttributeError) as error:
            raise WeightsError(
                f"the weights hold a configuration that this version cannot read ({error}); "
                "update actioncli or train the weights again."
            ) from error
