"""What the model reads of prepared frames, for numpy arrays and torch tensors alike."""

from __future__ import annotations

from actioncli.clips.skeleton import BONES, bone_columns, mirrored_columns
from actioncli.model.arrays import Array, namespace
from actioncli.model.config import ModelConfig


def mirror(config: ModelConfig, x: Array) -> Array:
    """The same motion with left and right exchanged.

    Args:
        x: (N, F, J, 3) prepared frames.
    """
    xp = namespace(x)
    swapped = mirrored_columns(config.preparation.joints)
    flip = xp.asarray([-1.0, 1.0, 1.0], dtype=x.dtype)
    return xp.take(x, xp.asarray(swapped), axis=2) * flip


def bone_directions(config: ModelConfig, x: Array) -> Array:
    """Unit vectors along the bones of bodies of standard size, (N, F, J, 3) → (N, F, 14, 3)."""
    xp = namespace(x)
    children, parents = map(xp.asarray, bone_columns(config.preparation.joints))
    length = xp.asarray([[length] for _, _, length in BONES], dtype=x.dtype)
    return (xp.take(x, children, axis=2) - xp.take(x, parents, axis=2)) / length


def token_features(config: ModelConfig, x: Array) -> Array:
    """What Ψ reads: the frames of each token side by side.

    With `body_features` a frame is the positions of the 14 joints beside the pelvis, the
    directions of the bones that end there, the joints' velocity (central difference, in torso
    lengths per frame if the clip had `tokens` frames, times 3), and 1.5 times their deviation
    from the clip's mean pose; the factors bring the four to like size.

    Args:
        x: (N, frames, J, 3) prepared frames.

    Returns:
        (N, F, inputs).
    """
    xp = namespace(x)
    n, frames = x.shape[:2]
    if config.body_features:
        children, _ = bone_columns(config.preparation.joints)
        joints = xp.take(x, xp.asarray(sorted(children)), axis=2)
        ends = [joints[:, 1:2] - joints[:, :1], joints[:, -1:] - joints[:, -2:-1]]
        velocity = xp.concat([ends[0], (joints[:, 2:] - joints[:, :-2]) / 2, ends[1]], axis=1)
        deviation = joints - xp.mean(joints, axis=1, keepdims=True)
        rate = 3.0 * min(frames / config.tokens, 2.0)
        parts = [joints, bone_directions(config, x), rate * velocity, 1.5 * deviation]
        # No -1 for the last length: there may be no clips at all.
        flat = [xp.reshape(part, (n, frames, 3 * part.shape[2])) for part in parts]
        x = xp.concat(flat, axis=2)
    return xp.reshape(x, (n, config.tokens, config.inputs))


def warp_features(config: ModelConfig, components: Array, x: Array) -> Array:
    """What time warping compares: bone directions of each token's middle frame.

    Half of the clip's mean direction is taken away, which counts motion more than posture; then
    a linear map keeps the V directions in which training motions differ most.

    Args:
        components: (42, V), orthonormal columns.
        x: (N, frames, J, 3) prepared frames.

    Returns:
        (N, F, V).
    """
    xp = namespace(x)
    step = x.shape[1] // config.tokens
    directions = bone_directions(config, x[:, step // 2 :: step, ...])
    directions = directions - 0.5 * xp.mean(directions, axis=1, keepdims=True)
    n, tokens, bones, _ = directions.shape
    return xp.reshape(directions, (n, tokens, 3 * bones)) @ components
