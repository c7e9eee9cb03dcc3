"""Checkpoints: weights and what they were trained with, in one file."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import torch

from runtime.errors import FormatError
from train.run_config import RunConfig

CHECKPOINT = "checkpoint.pt"
CHECKPOINT_FORMAT = "slide-checkpoint/2"


def load_checkpoint(path: Path) -> dict[str, Any]:
    """Read a checkpoint, or the one in a run's folder, without running any code in it.

    Raises:
        FormatError: there is none, it is damaged, or of another format.
    """
    if path.is_dir():
        path = path / CHECKPOINT
    try:
        checkpoint = torch.load(path, map_location="cpu", weights_only=True)
    except FileNotFoundError:
        raise FormatError(f"{path}: no such checkpoint") from None
    except Exception as error:  # torch raises whatever its reader meets in a damaged file
        raise FormatError(f"{path}: not a readable checkpoint ({type(error).__name__})") from error
    if not isinstance(checkpoint, dict) or checkpoint.get("format") != CHECKPOINT_FORMAT:
        raise FormatError(f"{path}: not a checkpoint of format {CHECKPOINT_FORMAT}")
    return checkpoint


def weights_to_use(checkpoint: dict[str, Any], config: RunConfig) -> dict[str, Any]:
    """Return a checkpoint's weights to evaluate or export: their moving average, if its configuration has one."""
    if config.average == 0:
        weights: dict[str, Any] = checkpoint["model"]
        return weights
    return {k.removeprefix("module."): v for k, v in checkpoint["average"].items() if k.startswith("module.")}
