"""How well a network tracks, on commands that are drawn once."""

from __future__ import annotations

import numpy as np
import torch
from torch import Tensor

from train.batches.batches import Batch, make_batch
from train.commands.families import free_commands
from train.config import TrainConfig
from train.learn.losses import pan_reach
from train.network.model import Seq2Seq
from train.physics.closed_loop import decode

VALIDATION_SEED = 2018
VALIDATION_COMMANDS = 64
VALIDATION_SAMPLES = 1200


def tracking(states: Tensor, batch: Batch) -> tuple[Tensor, Tensor]:
    """Mean over the batch of the RMS tracking error (m), and of the pan's reach (m)."""
    squared = ((states[..., 4:6] - batch.object_position) ** 2).sum(-1) * batch.mask
    error = torch.sqrt(squared.sum(1) / batch.mask.sum(1)).mean()
    return error, pan_reach(states).amax(1).mean()


def validate(model: Seq2Seq, config: TrainConfig, device: torch.device) -> dict[str, float]:
    """Tracking and reach (m) on fixed commands of each family of the configuration, under nominal friction."""
    figures: dict[str, float] = {}
    for name in config.families:
        rng = np.random.default_rng(VALIDATION_SEED)
        commands = free_commands(
            rng, VALIDATION_COMMANDS, VALIDATION_SAMPLES, {name: 1.0}, (0.03, 0.15), config.speed, 1
        )
        nominal = np.ones(VALIDATION_COMMANDS)
        batch = make_batch(commands.position, commands.samples, None, config.static * nominal, config.kinetic * nominal)
        batch = batch.to(device)
        with torch.no_grad():
            motion = decode(model, batch.command, batch.static, batch.kinetic)
        error, reach = tracking(motion.states, batch)
        figures |= {f"{name}_tracking": error.item(), f"{name}_reach": reach.item()}
    return figures
