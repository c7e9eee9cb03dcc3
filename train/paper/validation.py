"""How well a network tracks, on commands that are drawn once."""

from __future__ import annotations

import numpy as np
import torch
from torch import Tensor

from train.commands.batch import Batch, make_batch
from train.commands.families import free_commands
from train.paper.batches import FAMILY
from train.paper.closed_loop import decode
from train.paper.config import PaperConfig
from train.paper.losses import pan_reach
from train.paper.network import PaperNetwork

VALIDATION_SEED = 2018
VALIDATION_COMMANDS = 64
VALIDATION_SAMPLES = 1200


def tracking(states: Tensor, batch: Batch) -> tuple[Tensor, Tensor]:
    """Mean over the batch of the RMS tracking error (m), and of the pan's reach (m)."""
    squared = ((states[..., 4:6] - batch.object_position) ** 2).sum(-1) * batch.mask
    error = torch.sqrt(squared.sum(1) / batch.mask.sum(1)).mean()
    return error, pan_reach(states).amax(1).mean()


def validate(network: PaperNetwork, config: PaperConfig, device: torch.device) -> dict[str, float]:
    """Tracking and reach (m) on fixed free commands."""
    rng, ones = np.random.default_rng(VALIDATION_SEED), np.ones(VALIDATION_COMMANDS)
    commands = free_commands(rng, VALIDATION_COMMANDS, VALIDATION_SAMPLES, {FAMILY: 1.0}, config.reach, config.speed, 1)
    batch = make_batch(commands.position, commands.samples, None, config.static * ones, config.kinetic * ones)
    batch = batch.to(device)
    with torch.no_grad():
        motion = decode(network, batch.command, batch.static, batch.kinetic)
    error, reach = tracking(motion.states, batch)
    return {f"{FAMILY}_tracking": error.item(), f"{FAMILY}_reach": reach.item()}
