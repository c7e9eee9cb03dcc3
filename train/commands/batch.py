"""Commands as the trainings want them."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
import torch
from torch import Tensor

from runtime.command import command_velocity
from runtime.documents.checks import FloatArray
from runtime.physics.law import DT


class Batch(NamedTuple):
    """B commands, and friction: row k of what has K rows, but for `command`, is the instant t_{k+1}.

    Attributes:
        command: (B, K, 4) positions and velocities.
        object_position: (B, K, 2) where the objects should be.
        pan_position: (B, K, 2) of the pans that made the commands, if pans did.
        mask: (B, K) 1 for samples that count.
        static, kinetic: (B,) coefficients.
    """

    command: Tensor
    object_position: Tensor
    pan_position: Tensor | None
    mask: Tensor
    static: Tensor
    kinetic: Tensor

    def to(self, device: torch.device) -> Batch:
        """Return the batch on another device."""
        return Batch(*(None if tensor is None else tensor.to(device) for tensor in self))  # type: ignore[arg-type]

    def rows(self, rows: slice) -> Batch:
        """Return some of the trajectories."""
        return Batch(*(None if tensor is None else tensor[rows] for tensor in self))  # type: ignore[arg-type]


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
