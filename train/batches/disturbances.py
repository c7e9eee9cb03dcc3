"""What trajectories in training are disturbed by: a start in mid-course or off the mark, and noise on what is seen."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from runtime.documents.checks import FloatArray
from train.config import TrainConfig


class Disturbance(NamedTuple):
    """What a batch of B trajectories of K samples is disturbed by; rows of states as in `train.physics.rollout`.

    Attributes:
        lead_in: chunks of the command that are followed before the trajectories begin.
        start: (B, 8) where the lead-in begins, or without one the trajectories, from rest in the middle.
        push: (B, 8) added to the states at the end of the lead-in, the object's alone: the pan is where it is.
        noise: (B, K, 8) added to the states as the network sees them.
    """

    lead_in: int
    start: FloatArray
    push: FloatArray
    noise: FloatArray

    def rows(self, rows: slice) -> Disturbance:
        """Return what disturbs some of the trajectories."""
        return Disturbance(self.lead_in, self.start[rows], self.push[rows], self.noise[rows])


def draw_disturbance(config: TrainConfig, samples: int, rng: np.random.Generator) -> Disturbance:
    """Draw what disturbs a batch of trajectories of `samples` samples, K."""
    count = config.batch
    mid_course = rng.random() < config.lead_in
    lead_in = int(rng.integers(config.lead_in_chunks[0], config.lead_in_chunks[1] + 1)) if mid_course else 0

    start = np.zeros((count, 8))
    angle, radius = rng.uniform(0.0, 2.0 * np.pi, count), rng.uniform(0.0, config.start_reach, count)
    start[:, 0:2] = radius[:, None] * np.stack([np.cos(angle), np.sin(angle)], axis=1)
    start[:, 2:4] = rng.normal(0.0, config.start_speed, (count, 2))
    start += draw_push(config, rng)
    start *= rng.random((count, 1)) < config.displaced
    push = draw_push(config, rng) * (mid_course and rng.random((count, 1)) < config.displaced)

    noise = np.zeros((count, samples, 8))
    noisy = rng.random(count) < config.noisy
    size = np.repeat(config.noise, 2)
    noise[noisy] = rng.standard_normal((int(noisy.sum()), samples, 8)) * np.tile(size, 2)
    return Disturbance(lead_in, start, push, noise)


def draw_push(config: TrainConfig, rng: np.random.Generator) -> FloatArray:
    """Draw how far the objects are from their marks, and the velocities of those that slide: (B, 8), no pan's."""
    push = np.zeros((config.batch, 8))
    push[:, 4:6] = rng.normal(0.0, config.push, (config.batch, 2))
    push[:, 6:8] = rng.normal(0.0, config.push_speed, (config.batch, 2)) * rng.integers(0, 2, (config.batch, 1))
    return push
