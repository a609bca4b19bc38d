"""The model's configuration: saved inside the weights, so that they say how to be used."""

from __future__ import annotations

import json
from dataclasses import asdict, dataclass, field
from typing import Literal

from actioncli.clips.prepare import Preparation
from actioncli.errors import WeightsError


@dataclass(frozen=True, slots=True)
class ModelConfig:
    """Sizes and switches of TRX-OS. The defaults are the paper's.

    Attributes:
        preparation: what happens to a clip before the first layer.
        width: D, length of a frame's feature vector after Ψ.
        key_width: length of keys, queries and values of a frame tuple.
        tuple_width: features per tuple that the discriminator keeps.
        distance: "l2" averages the norms of the tuples' differences, as the paper writes T;
            "squared" averages their squares, as the authors' code does.
    """

    preparation: Preparation = field(default_factory=Preparation)
    width: int = 256
    key_width: int = 128
    tuple_width: int = 16
    distance: Literal["l2", "squared"] = "squared"

    @property
    def inputs(self) -> int:
        """Numbers per prepared frame, J·3."""
        return 3 * len(self.preparation.joints)

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
