"""A camera and a pose estimator, simulated: joints are projected, tremble, and are lifted again.

Not what training imitates, which bends bones in depth: here a depth
comes from how long a bone ought to be and how long it looks, as the first lifters had it
(C. J. Taylor, "Reconstruction of articulated objects from point correspondences", 2000). Which way
a bone leans is guessed wrongly now and then, and a filter smooths the result.
"""

from __future__ import annotations

import numpy as np

from actioncli.clips.clip import FloatArray
from actioncli.clips.prepare import sample
from actioncli.clips.skeleton import BONES, DEFAULT_JOINTS

_AT = {name: column for column, name in enumerate(DEFAULT_JOINTS)}
RATE = 15.0
# Metres: how far the camera stands, and errors of a joint in the picture, at the body's place.
_AWAY, _STATIC, _TREMBLE = 3.0, 0.02, 0.012
# Share of clips whose lower legs are outside of the picture.
_CUT = 0.2


def estimated(joints: FloatArray, fps: float, rng: np.random.Generator) -> tuple[FloatArray, float]:
    """The default joints (T, 15, 3) as an estimator at 15 poses a second might find them."""
    frames = max(4, round((len(joints) - 1) / fps * RATE) + 1)
    body = sample(joints - joints[:, [_AT["pelv"]]].mean(axis=0), frames)
    body = body @ _turn(rng.normal(0, 0.5), 1) @ _turn(rng.normal(0.1, 0.12), 0)
    seen = body.copy()
    # Perspective: what is nearer looks larger, and is taken for longer.
    seen[..., :2] *= _AWAY / (_AWAY + body[..., 2:])
    seen[..., :2] += _STATIC * rng.normal(size=(1, *body.shape[1:2], 2))
    seen[..., :2] += _TREMBLE * rng.normal(size=(*body.shape[:2], 2))
    lifted = _lift(seen, body, rng)
    if rng.random() < _CUT:
        for side in "lr":
            knee, hip = lifted[:, _AT[f"{side}kne"]], lifted[:, _AT[f"{side}hip"]]
            lifted[:, _AT[f"{side}ank"]] = knee + 0.3 * (knee - hip) + [0, -0.3, 0]
    return _smoothed(lifted), RATE


def _turn(angle: float, axis: int) -> FloatArray:
    i, j = [k for k in range(3) if k != axis]
    turn = np.eye(3, dtype=np.float32)
    turn[i, i] = turn[j, j] = np.cos(angle)
    turn[i, j], turn[j, i] = -np.sin(angle), np.sin(angle)
    return turn


def _lift(seen: FloatArray, body: FloatArray, rng: np.random.Generator) -> FloatArray:
    """Depth of each bone from its length in the picture and that of an average adult."""
    torso = np.median(np.linalg.norm(body[:, _AT["neck"]] - body[:, _AT["pelv"]], axis=1))
    lifted = seen.copy()
    lifted[:, _AT["pelv"], 2] = 0
    for child, parent, length in BONES:
        flat = seen[:, _AT[child], :2] - seen[:, _AT[parent], :2]
        real = body[:, _AT[child], 2] - body[:, _AT[parent], 2]
        long = length * torso * (1 + 0.05 * rng.normal())
        deep = np.sqrt(np.maximum(long**2 - (flat**2).sum(axis=1), 0))
        # Near the picture's plane the side is anybody's guess, and stays wrong for a while.
        guess = (
            0.15
            * long
            * np.interp(np.arange(len(seen)), np.linspace(0, len(seen) - 1, 5), rng.normal(size=5))
        )
        lifted[:, _AT[child], 2] = lifted[:, _AT[parent], 2] + deep * np.sign(real + guess)
    return lifted


def _smoothed(joints: FloatArray) -> FloatArray:
    """One Euro filter (Casiez et al., 2012): slow movements are smoothed, quick ones followed."""
    out = joints.copy()
    speed = np.zeros_like(joints[0])
    for frame in range(1, len(joints)):
        change = (joints[frame] - out[frame - 1]) * RATE
        speed += _share(1.0) * (change - speed)
        out[frame] = out[frame - 1] + _share(1.5 + 2.0 * np.abs(speed)) * change / RATE
    return out


def _share(cutoff: float | FloatArray) -> FloatArray:
    """How much of a new value a low pass of this cutoff (Hz) takes in."""
    return np.asarray(1 / (1 + RATE / (2 * np.pi * cutoff)), np.float32)
