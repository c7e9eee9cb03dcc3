"""How the paper's own network is trained: batches from its curriculum, and its two losses."""

from __future__ import annotations

from typing import Any, cast

import numpy as np
import torch
from torch import nn

from train.learn.checkpoint import weights_to_use
from train.learn.recipe import Outcome, cosine_decay
from train.paper.batches import Drawn, draw
from train.paper.closed_loop import Decoding
from train.paper.config import PaperConfig
from train.paper.curriculum import Task, task_at
from train.paper.losses import Weights, loss_object, loss_pan
from train.paper.network import PaperNetwork
from train.paper.validation import tracking, validate


class PaperRecipe:
    """The recipe of a `PaperConfig`; see `train.learn.recipe.Recipe`."""

    def __init__(self, config: PaperConfig) -> None:
        self.config = config
        self.weights = Weights(config.alpha, config.beta, config.gamma, config.pan_limit)

    def build(self) -> PaperNetwork:
        """Return the network."""
        return build_network(self.config)

    def decoding(self, network: nn.Module) -> Decoding:
        """Return `decode` as a module."""
        return Decoding(cast(PaperNetwork, network))

    def task(self, step: int) -> Task:
        """Return the task of the epoch that a step belongs to."""
        epoch = step // (self.config.trajectories // self.config.batch) + 1
        return task_at(self.config.model, epoch, self.config.epochs)

    def stage(self, step: int, steps: int) -> int:
        """Return the stage of Table I."""
        return self.task(step).stage

    def learning_rate(self, step: int, steps: int) -> float:
        """Return the learning rate."""
        return cosine_decay(self.config.learning_rate, self.config.final_learning_rate, step / steps)

    def draw(self, step: int, steps: int, rows: slice) -> Drawn:
        """Draw the batch, all of it, and keep the rows."""
        return draw(self.config, self.task(step), np.random.default_rng([self.config.seed, step])).rows(rows)

    def outcome(self, decoding: nn.Module, drawn: Drawn, device: torch.device) -> Outcome:
        """Decode, and take the loss L' or L."""
        pan_loss, batch = drawn.pan_loss, drawn.batch.to(device)
        with torch.autocast(device.type, torch.bfloat16, enabled=self.config.precision == "bfloat16"):
            motion = decoding(batch.command, batch.static, batch.kinetic, not pan_loss)
        if pan_loss:
            assert batch.pan_position is not None
            loss = loss_pan(motion.states, motion.covariance, batch.pan_position, batch.mask)
        else:
            loss = loss_object(
                motion.states, motion.u, motion.covariance, batch.object_position, batch.mask, self.weights
            )
        return Outcome(loss, *tracking(motion.states.detach(), batch))

    def validate(self, network: nn.Module, device: torch.device) -> dict[str, float]:
        """Track free commands."""
        return validate(cast(PaperNetwork, network), self.config, device)


def build_network(config: PaperConfig) -> PaperNetwork:
    """Return the configuration's network with freshly drawn weights."""
    torch.manual_seed(config.seed)
    return PaperNetwork(config.units, config.chunk, config.layers)


def load_network(checkpoint: dict[str, Any]) -> tuple[PaperConfig, PaperNetwork]:
    """Return a checkpoint's configuration and the network to evaluate."""
    config = PaperConfig.model_validate(checkpoint["config"])
    network = build_network(config)
    network.load_state_dict(weights_to_use(checkpoint, config))
    return config, network.eval()
