"""The model's configuration: saved inside the weights, so that they say how to be used."""

from __future__ import annotations

import json
from dataclasses import asdict, dataclass, field
from typing import Literal

from actioncli.clips.prepare import Preparation
from actioncli.clips.skeleton import BONES, DEFAULT_JOINTS
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
        warp_width: V, numbers per token that dynamic time warping compares; its cost joins T in
            the score. 0 leaves it out. Needs bodies of standard size.
        neighbours: the warping cost is seen relative to the mean cost to so many nearest motions
            of the cohort in the weights; 0 leaves the cohort out.
        mirrored: factor on the distance of an action that fits better when left and right are
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
    def views(self) -> int:
        """How a clip is seen: as it is, and with `mirrored` in the mirror."""
        return 2 if self.mirrored else 1

    @property
    def embedding_width(self) -> int:
        """E, numbers per token of an embedding: one view or two, and the cohort radius."""
        return self.views * self.view_width + bool(self.neighbours)

    @property
    def distance_is_odds(self) -> bool:
        """Whether a distance is 1 / confidence - 1, instead of the paper's T."""
        return self.warp_width > 0

    def to_json(self) -> str:
        """The configuration as it stands in the header of a weights file."""
        return json.dumps(asdict(self), sort_keys=True)

    @classmethod
    def from_json(cls, text: str) -> ModelConfig:
        """Inverse of `to_json`.

        Raises:
            WeightsError: not JSON, keys that this version does not know, or values that make no
                model.
        """
        try:
            values = json.loads(text)
            preparation = values.pop("preparation")
            preparation["joints"] = tuple(preparation["joints"])
            # A switch of earlier releases; no weights that have it on are read any more.
            if values.pop("near_pairs", False):
                raise ValueError("near_pairs")
            config = cls(preparation=Preparation(**preparation), **values)
            _check(config)
        except (ValueError, TypeError, KeyError, AttributeError, RecursionError) as error:
            raise WeightsError(
                f"the weights hold a configuration that this version cannot read ({error}); "
                "update actioncli or train the weights again."
            ) from error
        return config


# Beyond every model that anybody trained; what a stranger's file announces stays computable.
_LARGEST_WIDTH = 4096
_MOST_FRAMES = 1024
_MOST_LAYERS = 64
_MOST_JOINTS = 1000


def _check(config: ModelConfig) -> None:
    """Refuse a configuration whose shapes, or whose scores, could not be computed.

    Raises:
        ValueError: which value it is.
    """
    preparation = config.preparation
    _number("frames", preparation.frames, 2, _MOST_FRAMES)
    _number("tokens", config.tokens, 2, preparation.frames)
    for name in ("width", "key_width", "tuple_width"):
        _number(name, getattr(config, name), 1, _LARGEST_WIDTH)
    for name in ("warp_width", "neighbours"):
        _number(name, getattr(config, name), 0, _LARGEST_WIDTH)
    _number("convolutions", config.convolutions, 0, _MOST_LAYERS)
    _number("motion", preparation.motion, 0, 1, whole=False)
    _number("mirrored", config.mirrored, 0, 1e6, whole=False)
    for owner, name in (
        (preparation, "heading"),
        (config, "body_features"),
        (config, "both_ways"),
    ):
        if not isinstance(getattr(owner, name), bool):
            raise ValueError(f"{name} is neither true nor false")
    if config.distance not in ("l2", "squared"):
        raise ValueError("distance is none that is known")
    if preparation.size not in ("recorded", "torso", "standard"):
        raise ValueError("size is none that is known")
    if preparation.frames % config.tokens:
        raise ValueError("frames are no multiple of tokens")
    joints = preparation.joints
    if not all(isinstance(joint, str) for joint in joints) or len(joints) > _MOST_JOINTS:
        raise ValueError(f"joints are no list of at most {_MOST_JOINTS} names")
    needed = {"pelv"}
    if preparation.heading:
        needed |= {"lhip", "rhip", "lsho", "rsho"}
    if preparation.size == "torso":
        needed |= {"neck"}
    standard = preparation.size == "standard"
    if standard or config.body_features or config.warp_width or config.mirrored:
        needed |= set(DEFAULT_JOINTS)
    if len(set(joints)) != len(joints) or not needed <= set(joints):
        raise ValueError("joints are named twice, or lack some that the preparation needs")
    if standard and needed != set(joints):
        raise ValueError("a body of standard size has the default joints alone")
    if (config.body_features or config.warp_width) and not standard:
        raise ValueError("body features and warping need a body of standard size")


def _number(name: str, value: object, least: float, most: float, whole: bool = True) -> None:
    number = isinstance(value, int if whole else int | float) and not isinstance(value, bool)
    # NaN is not between any two numbers.
    if not (number and isinstance(value, int | float) and least <= value <= most):
        raise ValueError(f"{name} is not between {least:g} and {most:g}")
