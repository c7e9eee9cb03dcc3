"""What trajectories in training are disturbed by: a start in mid-course or off the mark, and noise on what is seen."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from runtime.documents import FloatArray
from train.config import TrainConfig


class Disturbance(NamedTuple):
    """What a batch of B trajectories of K samples is disturbed by; rows of states as in `train.rollout`.

    Attributes:
        lead_in: chunks of the command that are followed before the trajectories begin.
        displacement: (B, 8) added to the states they begin from.
        noise: (B, K, 8) added to the states as the network sees them.
    """

    lead_in: int
    displacement: FloatArray
    noise: FloatArray

    def rows(self, rows: slice) -> Disturbance:
        """Return what disturbs some of the trajectories."""
        return Disturbance(self.lead_in, self.displacement[rows], self.noise[rows])


def draw_disturbance(config: TrainConfig, samples: int, rng: np.random.Generator) -> Disturbance:
    """Draw what disturbs a batch of trajectories of `samples` samples, K.

    In mid-course the pan is where the network brought it, so that only the object is displaced further.
    """
    count = config.batch
    mid_course = rng.random() < config.lead_in
    lead_in = int(rng.integers(config.lead_in_chunks[0], config.lead_in_chunks[1] + 1)) if mid_course else 0

    displacement = np.zeros((count, 8))
    if not mid_course:
        angle, radius = rng.uniform(0.0, 2.0 * np.pi, count), rng.uniform(0.0, config.start_reach, count)
        displacement[:, 0:2] = radius[:, None] * np.stack([np.cos(angle), np.sin(angle)], axis=1)
        displacement[:, 2:4] = rng.normal(0.0, config.start_speed, (count, 2))
    displacement[:, 4:6] = rng.normal(0.0, config.push, (count, 2))
    displacement[:, 6:8] = rng.normal(0.0, config.push_speed, (count, 2)) * rng.integers(0, 2, (count, 1))
    displacement *= rng.random((count, 1)) < config.displaced

    noise = np.zeros((count, samples, 8))
    noisy = rng.random(count) < config.noisy
    size = np.repeat(config.noise, 2)
    noise[noisy] = rng.standard_normal((int(noisy.sum()), samples, 8)) * np.tile(size, 2)
    return Disturbance(lead_in, displacement, noise)
