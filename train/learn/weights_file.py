"""Weights in floats beside a bundle's graphs, to train on with: safetensors by torch's names; needs the extra [hub]."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

from torch import Tensor

from runtime.errors import FormatError, extra

WEIGHTS_FILE = "model.safetensors"


def write_weights(path: Path, weights: Mapping[str, Tensor]) -> None:
    """Write weights.

    Raises:
        MissingExtraError: safetensors is not installed.
    """
    with extra("hub"):
        from safetensors.torch import save_file
    save_file({name: tensor.detach().contiguous() for name, tensor in weights.items()}, path)


def read_weights(path: Path) -> dict[str, Tensor]:
    """Read weights.

    Raises:
        FormatError: it is no such file, or damaged.
        MissingExtraError: safetensors is not installed.
    """
    with extra("hub"):
        from safetensors import SafetensorError
        from safetensors.torch import load_file
    try:
        weights: dict[str, Tensor] = load_file(path)
    except (SafetensorError, OSError) as error:
        raise FormatError(f"{path}: not a readable safetensors file: {error}") from error
    return weights
