"""Weights on disk: safetensors whose header says what they are and how they came about."""

from __future__ import annotations

import hashlib
import json
import stat
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from actioncli.clips.clip import FloatArray
from actioncli.errors import WeightsError
from actioncli.files import replacing, weights_file
from actioncli.model import parts, trx_os
from actioncli.model.config import Config, PartsConfig, config_from_json, config_to_json

FORMAT = "actioncli-weights"
FORMAT_VERSION = "1"
DEFAULT_WEIGHTS = "trx_os.safetensors"
# Bytes; the shipped ones are a hundred times smaller.
LARGEST_FILE = 512 * 2**20


@dataclass(frozen=True, slots=True, eq=False)
class Weights:
    """A trained model.

    Attributes:
        config: how to prepare clips and which tensors there are.
        tensors: float32 arrays by name, see `parameter_shapes` of `parts` and `trx_os`; the
            part transformer's file also holds what its confidence means and the embeddings
            `cohort` of other people's motions, which only `calibrate` looks at.
        metadata: recipe, seed, steps, figures, sources, as plain JSON values.
        checksum: SHA-256 over configuration, metadata and tensors, hexadecimal; embeddings of
            one checksum are not comparable with those of another.
        path: the file they were read from.
    """

    config: Config
    tensors: Mapping[str, FloatArray]
    metadata: Mapping[str, Any]
    checksum: str
    path: Path


def write_weights(
    path: Path,
    config: Config,
    tensors: Mapping[str, np.ndarray[Any, Any]],
    metadata: Mapping[str, Any],
) -> str:
    """Write weights so that a crash leaves the old file or the new one, never half of one.

    Args:
        tensors: as `Weights` has them; stored in the type they have.
        metadata: JSON values under any name but those of the header itself.

    Returns:
        The checksum.

    Raises:
        WeightsError: the file cannot be written.
    """
    from safetensors.numpy import save

    stored = {name: np.ascontiguousarray(tensor) for name, tensor in tensors.items()}
    configuration, description = config_to_json(config), json.dumps(dict(metadata), sort_keys=True)
    checksum = _checksum(configuration, description, stored)
    header = {
        "format": FORMAT,
        "format_version": FORMAT_VERSION,
        "config": configuration,
        "metadata": description,
        "checksum": checksum,
    }
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        with replacing(path) as part:
            part.write_bytes(save(stored, metadata=header))
    except OSError as error:
        raise WeightsError(f"{path}: cannot write weights: {error.strerror}.") from error
    return checksum


def read_weights(path: str | Path | None = None) -> Weights:
    """Read and check weights; without a path those that came with the package.

    Raises:
        WeightsError: missing, damaged, not weights of actioncli, or of another format version.
    """
    from safetensors import SafetensorError, safe_open

    file = Path(path) if path is not None else weights_file(DEFAULT_WEIGHTS)
    _check_file(file)
    try:
        with safe_open(file, framework="np") as opened:
            header = opened.metadata() or {}
            # What safe_open gives is no mapping: only its keys can be walked through.
            stored = {name: opened.get_tensor(name) for name in opened.keys()}  # noqa: SIM118
    except (SafetensorError, OSError, ValueError, TypeError, AttributeError) as error:
        raise WeightsError(
            f"{file}: cannot read weights ({error}); the file is damaged or no safetensors "
            "file. Install actioncli again, or train again."
        ) from error
    if header.get("format") != FORMAT:
        raise WeightsError(f"{file}: safetensors, but not weights of actioncli.")
    if header.get("format_version") != FORMAT_VERSION:
        raise WeightsError(
            f"{file}: weights of format version {header.get('format_version')}, this "
            f"actioncli reads version {FORMAT_VERSION}; update actioncli or train again."
        )
    try:
        configuration = header["config"]
        config = config_from_json(configuration)
        description, checksum = header["metadata"], header["checksum"]
        metadata = json.loads(description)
    except (KeyError, ValueError, RecursionError) as error:
        raise WeightsError(f"{file}: the header is damaged ({error}).") from error
    except WeightsError as error:
        raise WeightsError(f"{file}: {error}") from error
    shapes = {name: tensor.shape for name, tensor in stored.items()}
    if shapes != _expected_shapes(config, (*shapes.get("cohort", ()), 0)[0]):
        raise WeightsError(f"{file}: tensors do not fit the configuration in the header.")
    if checksum != _checksum(configuration, description, stored):
        raise WeightsError(f"{file}: damaged, the checksum does not match the content.")
    if not isinstance(metadata, dict) or any(each.dtype.kind != "f" for each in stored.values()):
        raise WeightsError(f"{file}: holds what are no weights; train again.")
    with np.errstate(over="ignore"):
        tensors = {name: each.astype(np.float32, copy=False) for name, each in stored.items()}
    # A score must be a number, whatever the file.
    if not all(np.isfinite(tensor).all() for tensor in tensors.values()):
        raise WeightsError(f"{file}: holds weights that are no finite numbers; train again.")
    return Weights(config, tensors, metadata, checksum, file)


def _expected_shapes(config: Config, cohort: int) -> dict[str, tuple[int, ...]]:
    if not isinstance(config, PartsConfig):
        return trx_os.parameter_shapes(config)
    shapes = parts.parameter_shapes(config) | parts.fitted_shapes(config)
    if cohort:
        shapes["cohort"] = (cohort, config.tokens, config.embedding_width)
    return shapes


def _check_file(file: Path) -> None:
    """Refuse what is missing, special (a pipe would never end), or far too large."""
    try:
        status = file.stat()
    except FileNotFoundError as error:
        raise WeightsError(f"{file}: no such weights file.") from error
    except (OSError, ValueError) as error:
        raise WeightsError(f"{file}: cannot read weights ({error}).") from error
    if not stat.S_ISREG(status.st_mode):
        raise WeightsError(f"{file}: is not a regular file; name a weights file.")
    if status.st_size > LARGEST_FILE:
        raise WeightsError(
            f"{file}: has {status.st_size >> 20} MB; weights have at most {LARGEST_FILE >> 20}."
        )


def _checksum(
    configuration: str, description: str, tensors: Mapping[str, np.ndarray[Any, Any]]
) -> str:
    # Over the text that is stored: what a later version makes of it may have more keys.
    digest = hashlib.sha256(f"{configuration}\n{description}\n".encode())
    for name in sorted(tensors):
        tensor = tensors[name]
        digest.update(f"{name} {tensor.dtype.str} {tensor.shape}".encode())
        digest.update(np.ascontiguousarray(tensor).data)
    return digest.hexdigest()
