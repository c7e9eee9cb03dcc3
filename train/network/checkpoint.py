"""Checkpoints: a network and what it was trained with, in one file."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import torch

from runtime.errors import FormatError, InputError
from train.config import AnyConfig, TrainConfig, read_config
from train.network.model import Seq2Seq

CHECKPOINT = "checkpoint.pt"
CHECKPOINT_FORMAT = "slide-checkpoint/1"


def build_model(config: TrainConfig) -> Seq2Seq:
    """Return the configuration's network with freshly drawn weights."""
    torch.manual_seed(config.seed)
    return Seq2Seq(config.units, config.chunk, config.layers, config.command_ahead, config.acceleration_bound)


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


def load_model(checkpoint: dict[str, Any]) -> tuple[TrainConfig, Seq2Seq]:
    """Return a checkpoint's configuration and the network to evaluate or export.

    Raises:
        InputError: it is a network of another kind.
    """
    config = read_config(checkpoint["config"])
    if not isinstance(config, TrainConfig):
        raise InputError(
            f"{config.name} is a network for every pan, and this works with networks for one pan: "
            "evaluate it with  slide-eval RUN"
        )
    model = build_model(config)
    model.load_state_dict(weights_to_use(checkpoint, config))
    return config, model.eval()


def weights_to_use(checkpoint: dict[str, Any], config: AnyConfig) -> dict[str, Any]:
    """Return a checkpoint's weights to evaluate or export: their moving average, if its configuration has one."""
    if config.average == 0:
        weights: dict[str, Any] = checkpoint["model"]
        return weights
    return {k.removeprefix("module."): v for k, v in checkpoint["average"].items() if k.startswith("module.")}
