"""The batches of training: what the curriculum draws for a step, and how it is disturbed."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
import torch
from torch import Tensor

from runtime.command import command_velocity
from runtime.physics.law import DT
from train.batches.disturbances import Disturbance, draw_disturbance
from train.commands.controlled_slide import physics_commands
from train.commands.families import FloatArray, free_commands
from train.config import TrainConfig
from train.curriculum import Task


class Batch(NamedTuple):
    """One batch as the losses want it: row k of what has K rows, but for `command`, is the instant t_{k+1}.

    `before` and `noise` are as in `train.physics.closed_loop.decode`.
    """

    command: Tensor
    object_position: Tensor
    pan_position: Tensor | None
    mask: Tensor
    static: Tensor
    kinetic: Tensor
    before: Tensor | None = None
    noise: Tensor | None = None

    def to(self, device: torch.device) -> Batch:
        """Return the batch on another device."""
        return Batch(*(None if tensor is None else tensor.to(device) for tensor in self))  # type: ignore[arg-type]

    def rows(self, rows: slice) -> Batch:
        """Return some of the trajectories."""
        return Batch(*(None if tensor is None else tensor[rows] for tensor in self))  # type: ignore[arg-type]


class Drawn(NamedTuple):
    """What is drawn for one step: the batch, and what disturbs it, None for nothing."""

    pan_loss: bool
    batch: Batch
    disturbance: Disturbance | None

    def rows(self, rows: slice) -> Drawn:
        """Return some of the trajectories."""
        disturbance = None if self.disturbance is None else self.disturbance.rows(rows)
        return Drawn(self.pan_loss, self.batch.rows(rows), disturbance)


def draw(config: TrainConfig, task: Task, rng: np.random.Generator) -> Drawn:
    """Draw one step of `task`: which loss, which commands, what friction and what disturbs them."""
    pan_loss = bool(rng.random() < task.pan_loss)
    physics = pan_loss or bool(rng.random() < task.physics)
    chunks = [math.ceil(n / config.chunk) for n in config.samples]
    samples = int(rng.integers(chunks[0], chunks[1] + 1)) * config.chunk
    disturbed = task.disturbed and not physics and config.disturbs
    disturbance = draw_disturbance(config, samples, rng) if disturbed else None
    lead_in = 0 if disturbance is None else disturbance.lead_in * config.chunk
    return Drawn(pan_loss, draw_batch(config, task, samples + lead_in, pan_loss, physics, rng), disturbance)


def draw_batch(
    config: TrainConfig, task: Task, samples: int, pan_loss: bool, physics: bool, rng: np.random.Generator
) -> Batch:
    """Draw commands of `samples` samples and their friction."""
    if physics:
        commands = physics_commands(
            rng, config.batch, samples, config.physics_knots, config.physics_reach, config.static, config.kinetic
        )
    else:
        shorten = config.chunk if config.shorten else 1
        commands = free_commands(rng, config.batch, samples, config.families, config.reach, config.speed, shorten)
    if task.varied_friction and not pan_loss:
        static = rng.uniform(*config.static_range, config.batch)
        kinetic = rng.uniform(config.kinetic_range[0], np.minimum(config.kinetic_range[1], static))
        nominal = rng.random(config.batch) < config.nominal
        static, kinetic = np.where(nominal, config.static, static), np.where(nominal, config.kinetic, kinetic)
    else:
        static, kinetic = np.full(config.batch, config.static), np.full(config.batch, config.kinetic)
    return make_batch(commands.position, commands.samples, commands.pan_position, static, kinetic)


def make_batch(
    position: FloatArray, samples: Any, pan_position: FloatArray | None, static: FloatArray, kinetic: FloatArray
) -> Batch:
    """Make a batch of (B, K, 2) positions held from sample `samples` (B,) on."""
    velocity = np.zeros_like(position)
    for n in np.unique(samples):
        rows = samples == n
        velocity[rows, :n] = command_velocity(position[rows, :n], DT)
    after = np.arange(1, position.shape[1] + 1)
    return Batch(
        command=torch.from_numpy(np.concatenate([position, velocity], axis=-1)),
        object_position=torch.from_numpy(_next(position)),
        pan_position=None if pan_position is None else torch.from_numpy(_next(pan_position)),
        mask=torch.from_numpy((after < samples[:, None]).astype(np.float64)),
        static=torch.from_numpy(static),
        kinetic=torch.from_numpy(kinetic),
    )


def _next(position: FloatArray) -> FloatArray:
    """Shift rows by one sample, to the instants after each input; the last row is repeated and masked out."""
    return np.concatenate([position[:, 1:], position[:, -1:]], axis=1)
