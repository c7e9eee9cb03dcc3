"""How a network in SI units for one pan is trained: batches from the curriculum, and the paper's two losses."""

from __future__ import annotations

from typing import NamedTuple, cast

import numpy as np
import torch
from torch import nn

from runtime.physics.law import DT
from train.batches.batches import Drawn, draw
from train.batches.mid_course import disturb, last_acceleration
from train.config import TrainConfig
from train.curriculum import CURRICULA, Task, task_at
from train.learn.losses import Weights, loss_object, loss_pan
from train.learn.recipe import Outcome, learning_rate
from train.learn.validation import tracking, validate
from train.network.checkpoint import build_model
from train.network.model import Seq2Seq
from train.physics.closed_loop import Prediction, decode


class Decoding(nn.Module):
    """`decode` as a module's forward(), around which DistributedDataParallel averages the gradients."""

    def __init__(self, model: Seq2Seq) -> None:
        super().__init__()
        self.model = model

    def forward(self, *arguments: object) -> Prediction:
        """Decode in closed loop; see `decode`."""
        return decode(self.model, *arguments)  # type: ignore[arg-type]


class TaskBatch(NamedTuple):
    """A batch, and the task of the curriculum that it was drawn for."""

    task: Task
    drawn: Drawn


class OnePanRecipe:
    """The recipe of a `TrainConfig`; see `Recipe`."""

    def __init__(self, config: TrainConfig) -> None:
        self.config = config

    def build(self) -> Seq2Seq:
        """Return the network."""
        return build_model(self.config)

    def decoding(self, network: nn.Module) -> Decoding:
        """Return `decode` as a module."""
        return Decoding(cast(Seq2Seq, network))

    def task(self, step: int) -> Task:
        """Return the task of the epoch that a step belongs to."""
        config = self.config
        epoch = step // (config.trajectories // config.batch) + 1
        return task_at(CURRICULA[config.curriculum], config.model, epoch, config.epochs)

    def stage(self, step: int, steps: int) -> int:
        """Return the stage of Table I."""
        return self.task(step).stage

    def learning_rate(self, step: int, steps: int) -> float:
        """Return the learning rate."""
        return learning_rate(self.config, step / steps)

    def draw(self, step: int, steps: int, rows: slice) -> TaskBatch:
        """Draw the batch, all of it, and keep the rows."""
        task = self.task(step)
        return TaskBatch(task, draw(self.config, task, np.random.default_rng([self.config.seed, step])).rows(rows))

    def outcome(self, decoding: nn.Module, drawn: TaskBatch, device: torch.device) -> Outcome:
        """Decode, and take the loss L' or L."""
        task, (pan_loss, batch, disturbance) = drawn
        batch = batch.to(device)
        with torch.autocast(device.type, torch.bfloat16, enabled=self.config.precision == "bfloat16"):
            if disturbance is not None:
                network = decoding.module if isinstance(decoding, nn.parallel.DistributedDataParallel) else decoding
                batch = disturb(cast(Decoding, network).model, batch, disturbance)
            motion = decoding(batch.command, batch.static, batch.kinetic, not pan_loss, batch.before, batch.noise)
        if pan_loss:
            assert batch.pan_position is not None
            loss = loss_pan(motion.states, motion.covariance, batch.pan_position, batch.mask)
        else:
            loss = loss_object(
                motion.states,
                motion.u,
                motion.covariance,
                batch.object_position,
                batch.mask,
                loss_weights(self.config, task),
                None if batch.before is None else last_acceleration(batch.before),
            )
        return Outcome(loss, *tracking(motion.states.detach(), batch))

    def validate(self, network: nn.Module, device: torch.device) -> dict[str, float]:
        """Track each family of commands."""
        return validate(cast(Seq2Seq, network), self.config, device)


def loss_weights(config: TrainConfig, task: Task) -> Weights:
    """Return the weights of the loss L in `task`."""
    gamma = config.late_gamma if task.late and config.late_gamma is not None else config.gamma
    return Weights(
        alpha=config.alpha,
        beta=config.beta,
        gamma=gamma,
        pan_limit=config.pan_limit - config.pan_margin,
        tracking=config.tracking,
        jerk=config.jerk,
        largest_change=config.jerk_limit * DT,
        braking=config.braking,
    )
