"""Configuration of the parts model, saved inside its weights."""

from __future__ import annotations

import json
from dataclasses import asdict, dataclass, field

from actioncli.clips.parts import PARTS
from actioncli.clips.prepare import Preparation
from actioncli.clips.skeleton import DEFAULT_JOINTS
from actioncli.errors import WeightsError

METHOD = "parts"


@dataclass(frozen=True, slots=True)
class PartsConfig:
    """Sizes of the parts model.

    Attributes:
        preparation: what happens to a clip before the first layer.
        tokens: T, tokens of each part; each is `preparation.frames / tokens` neighbouring frames.
        width: D, features of a token.
        key_width: W, length of keys and values.
        layers: blocks of convolution in time, mixing of parts, and MLP.
        evidence: features that each part's difference is reduced to.
    """

    preparation: Preparation = field(
        default_factory=lambda: Preparation(frames=48, size="standard", heading=True, motion=0.5)
    )
    tokens: int = 16
    width: int = 64
    key_width: int = 32
    layers: int = 2
    evidence: int = 32

    @property
    def embedding_width(self) -> int:
        """E, numbers per token of an embedding: key, value and presence of each part."""
        return len(PARTS) * (2 * self.key_width + 1)

    @property
    def distance_is_odds(self) -> bool:
        """Whether a distance is 1 / confidence - 1."""
        return True

    def to_json(self) -> str:
        """The configuration as it stands in the header of a weights file."""
        return json.dumps({"method": METHOD, **asdict(self)}, sort_keys=True)

    @classmethod
    def from_json(cls, text: str) -> PartsConfig:
        """Inverse of `to_json`.

        Raises:
            WeightsError: not JSON, unknown keys, or values that make no model.
        """
        try:
            values = json.loads(text)
            if values.pop("method") != METHOD:
                raise ValueError("the method is not parts")
            preparation = values.pop("preparation")
            preparation["joints"] = tuple(preparation["joints"])
            config = cls(preparation=Preparation(**preparation), **values)
            _check(config)
        except (ValueError, TypeError, KeyError, AttributeError, RecursionError) as error:
            raise WeightsError(
                f"the weights hold a configuration that this version cannot read ({error}); "
                "update actioncli or train the weights again."
            ) from error
        return config


def _check(config: PartsConfig) -> None:
    """Refuse what is no model, or none that a computer could hold.

    Raises:
        ValueError: which value it is.
    """
    preparation = config.preparation
    most = {"tokens": 256, "width": 1024, "key_width": 1024, "layers": 64, "evidence": 1024}
    sizes = {name: (getattr(config, name), largest) for name, largest in most.items()}
    for name, (value, largest) in {**sizes, "frames": (preparation.frames, 1024)}.items():
        if type(value) is not int or not 1 <= value <= largest:
            raise ValueError(f"{name} is not between 1 and {largest}")
    if preparation.frames % config.tokens or config.tokens < 2 or config.width % 4:
        raise ValueError("frames are no multiple of tokens, or width is none of 4")
    if not isinstance(preparation.motion, int | float) or not 0 <= preparation.motion <= 1:
        raise ValueError("motion is not between 0 and 1")
    if (preparation.joints, preparation.size, preparation.heading) != (
        DEFAULT_JOINTS, "standard", True,
    ):  # fmt: skip
        raise ValueError("parts are read of bodies of standard size in the common heading")
