"""The models' configurations: saved inside the weights, so that they say how to be used."""

from __future__ import annotations

import json
from dataclasses import asdict, dataclass, field, fields
from typing import Any, ClassVar

from actioncli.clips.parts import PARTS
from actioncli.clips.prepare import Preparation
from actioncli.clips.skeleton import DEFAULT_JOINTS
from actioncli.errors import WeightsError


@dataclass(frozen=True, slots=True)
class ModelConfig:
    """Sizes of TRX-OS as published.

    Attributes:
        preparation: what happens to a clip before the first layer; F frames, which are the tokens.
        width: D, length of a token's feature vector after Ψ.
        key_width: W, length of keys, queries and values of a pair.
        tuple_width: features per pair that the discriminator keeps.
    """

    method: ClassVar = "trx-os"
    # Distances are the paper's T.
    distance_is_odds: ClassVar = False

    preparation: Preparation = field(default_factory=Preparation)
    width: int = 256
    key_width: int = 128
    tuple_width: int = 16

    @property
    def tokens(self) -> int:
        """F."""
        return self.preparation.frames

    @property
    def inputs(self) -> int:
        """J·3, numbers per token that Ψ reads."""
        return 3 * len(self.preparation.joints)

    @property
    def pairs(self) -> int:
        """P, ordered pairs of tokens."""
        return self.tokens * (self.tokens - 1) // 2

    @property
    def embedding_width(self) -> int:
        """E, numbers per token of an embedding: as first and as second of a pair, key and value."""
        return 4 * self.key_width

    def check(self) -> None:
        """Refuse a configuration whose shapes, or whose scores, could not be computed.

        Raises:
            ValueError: which value it is.
        """
        _check_preparation(self.preparation)
        for name in ("width", "key_width", "tuple_width"):
            _number(name, getattr(self, name), 1, 4096)


@dataclass(frozen=True, slots=True)
class PartsConfig:
    """Sizes of the part transformer.

    Attributes:
        preparation: what happens to a clip before the first layer.
        tokens: T, tokens of each part; each is `preparation.frames / tokens` neighbouring frames.
        width: D, features of a token.
        key_width: W, length of keys and values.
        layers: blocks of convolution in time, mixing of parts, and MLP.
        evidence: features that each part's difference is reduced to.
    """

    method: ClassVar = "parts"
    # A distance is 1 / confidence - 1.
    distance_is_odds: ClassVar = True

    preparation: Preparation = field(
        default_factory=lambda: Preparation(frames=48, size="standard", heading=True, motion=0.5)
    )
    tokens: int = 16
    width: int = 64
    key_width: int = 32
    layers: int = 2
    evidence: int = 32

    @property
    def token_width(self) -> int:
        """Numbers per token: key, value and presence of each part."""
        return len(PARTS) * (2 * self.key_width + 1)

    @property
    def embedding_width(self) -> int:
        """E, numbers per token of an embedding: the token's, and its piece of the pooled vector."""
        return self.token_width + len(PARTS) * 4 * self.key_width // self.tokens

    def check(self) -> None:
        """Refuse what is no model, or none that a computer could hold.

        Raises:
            ValueError: which value it is.
        """
        _check_preparation(self.preparation)
        most = {"tokens": 256, "width": 1024, "key_width": 1024, "layers": 64, "evidence": 1024}
        for name, largest in most.items():
            _number(name, getattr(self, name), 1, largest)
        if self.preparation.frames % self.tokens or self.tokens % 2 or self.width % 4:
            raise ValueError("frames are no multiple of tokens, tokens of 2, or width of 4")
        if 4 * self.key_width % self.tokens:
            raise ValueError("4 times key_width is no multiple of tokens")
        body = self.preparation
        if (body.joints, body.size, body.heading) != (DEFAULT_JOINTS, "standard", True):
            raise ValueError("parts are read of bodies of standard size in the common heading")


Config = ModelConfig | PartsConfig
_CONFIGS = {config.method: config for config in (ModelConfig, PartsConfig)}


def config_to_json(config: Config) -> str:
    """A configuration as it stands in the header of a weights file."""
    return json.dumps({"method": config.method, **asdict(config)}, sort_keys=True)


def config_from_json(text: str) -> Config:
    """Inverse of `config_to_json`.

    Raises:
        WeightsError: not JSON, keys that this version does not know, or values that make no
            model.
    """
    try:
        values: dict[str, Any] = json.loads(text)
        kind = _CONFIGS[values.pop("method", ModelConfig.method)]
        unknown = sorted(set(values) - {each.name for each in fields(kind)})
        if unknown:
            raise ValueError(f"of an earlier method: {', '.join(unknown)}")
        preparation = values.pop("preparation")
        preparation["joints"] = tuple(preparation["joints"])
        config: Config = kind(preparation=Preparation(**preparation), **values)
        config.check()
    except (ValueError, TypeError, KeyError, AttributeError, RecursionError) as error:
        raise WeightsError(
            f"the weights hold a configuration that this version cannot read ({error}); "
            "update actioncli or train the weights again."
        ) from error
    return config


def _check_preparation(preparation: Preparation) -> None:
    """Refuse what no clip could be prepared by.

    Raises:
        ValueError: which value it is.
    """
    _number("frames", preparation.frames, 2, 1024)
    _number("motion", preparation.motion, 0, 1, whole=False)
    if not isinstance(preparation.heading, bool):
        raise ValueError("heading is neither true nor false")
    if preparation.size not in ("recorded", "torso", "standard"):
        raise ValueError("size is none that is known")
    joints = preparation.joints
    if not all(isinstance(joint, str) for joint in joints) or len(joints) > 1000:
        raise ValueError("joints are no list of at most 1000 names")
    needed = {"pelv"}
    if preparation.heading:
        needed |= {"lhip", "rhip", "lsho", "rsho"}
    if preparation.size == "torso":
        needed |= {"neck"}
    if preparation.size == "standard":
        needed = set(DEFAULT_JOINTS)
        if needed != set(joints):
            raise ValueError("a body of standard size has the default joints alone")
    if len(set(joints)) != len(joints) or not needed <= set(joints):
        raise ValueError("joints are named twice, or lack some that the preparation needs")


def _number(name: str, value: object, least: float, most: float, whole: bool = True) -> None:
    number = isinstance(value, int if whole else int | float) and not isinstance(value, bool)
    # NaN is not between any two numbers.
    if not (number and isinstance(value, int | float) and least <= value <= most):
        raise ValueError(f"{name} is not between {least:g} and {most:g}")
