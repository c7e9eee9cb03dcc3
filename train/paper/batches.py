"""The batches of the paper's training: what the curriculum draws for a step."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from train.commands.batch import Batch, make_batch
from train.commands.families import free_commands
from train.paper.config import PaperConfig
from train.paper.controlled_slide import physics_commands
from train.paper.curriculum import Task

FAMILY = "spline_acceleration"
"""The paper's free commands: B-spline accelerations (Section IV-B)."""

SLIDE_KNOTS = (0.15, 0.4)
"""Spacing of the knots of physics-generated commands (s)."""


class Drawn(NamedTuple):
    """A batch, and whether it is for the loss L'."""

    pan_loss: bool
    batch: Batch

    def rows(self, rows: slice) -> Drawn:
        """Return some of the trajectories."""
        return Drawn(self.pan_loss, self.batch.rows(rows))


def draw(config: PaperConfig, task: Task, rng: np.random.Generator) -> Drawn:
    """Draw one step of `task`: which loss and which commands."""
    pan_loss = bool(rng.random() < task.pan_loss)
    physics = pan_loss or bool(rng.random() < task.physics)
    chunks = [math.ceil(n / config.chunk) for n in config.samples]
    samples = int(rng.integers(chunks[0], chunks[1] + 1)) * config.chunk
    if physics:
        friction = config.static, config.kinetic
        commands = physics_commands(rng, config.batch, samples, SLIDE_KNOTS, config.reach, *friction)
    else:
        commands = free_commands(rng, config.batch, samples, {FAMILY: 1.0}, config.reach, config.speed, 1)
    ones = np.ones(config.batch)
    frictions = config.static * ones, config.kinetic * ones
    return Drawn(pan_loss, make_batch(commands.position, commands.samples, commands.pan_position, *frictions))
