"""What a motion costs: the error of the object, and what of the pan's limits it does not keep."""

from __future__ import annotations

import torch
from torch import Tensor

from runtime.network.units import ACCELERATION, REACH
from runtime.physics.law import DT
from train.learn.parallel import masked_mean
from train.network.closed_loop import Moved
from train.network.config import TrainConfig
from train.network.situations import Trajectories

MILLIMETRE = 1e-3
"""A thousandth of the network's unit of length."""

ERROR_FLOOR = 1e-4
"""Error below which nothing is to be gained, in the network's units of length."""

HARDNESS = 1.0
"""Added to the error under the root, in thousandths of the unit of length; see `tracking_price`."""

REACH_MARGIN, HEIGHT_MARGIN, SPEED_MARGIN = 0.975, 0.95, 0.97
"""Shares of the limits up to which reach, height and speed cost nothing."""

JERK_MARGIN = 0.8
"""Share of the jerk limit up to which jerk costs nothing of its own."""

SPEED_WEIGHT = 0.1
"""Price of being too fast by one unit, over that of being out of reach by one."""

SQUARE_FLOOR = 1e-12
"""Added to squares under a root, whose derivative at zero would be infinite."""


def tracking_errors(moved: Moved, drawn: Trajectories) -> Tensor:
    """Return the root mean square distance (B,) of each object from its command, smooth at zero."""
    error = moved.states[..., 6:8] - drawn.object_position
    squared = ((error * error).sum(-1) * drawn.mask).sum(1) / drawn.mask.sum(1).clamp(min=1.0)
    return torch.sqrt(squared + ERROR_FLOOR**2)


def farthest(moved: Moved) -> Tensor:
    """Return the largest distance (B,) of each pan from the centre of its reach, in the plane."""
    reach: Tensor = torch.linalg.vector_norm(moved.states[..., :2], dim=-1).amax(1)
    return reach


def tracking_price(errors: Tensor) -> Tensor:
    """Return the mean price of tracking errors (B,): 3 sqrt(1 + e) of one of e thousandths.

    Commands that nobody can follow do not drown the others.
    """
    return 3.0 * torch.sqrt(errors / MILLIMETRE + HARDNESS).mean()


def loss(moved: Moved, drawn: Trajectories, errors: Tensor, config: TrainConfig) -> Tensor:
    """Return the price of B motions with these tracking errors (B,).

    A pan must be able to stop within reach and height, with `braking`, once its acceleration has turned.
    """
    plane, z, velocity, vz, _ = torch.split(moved.states, [2, 1, 2, 1, 4], dim=-1)
    z, vz = z[..., 0], vz[..., 0]
    turning = (0.5 * ACCELERATION / drawn.jerk)[:, None]
    squared = (velocity * velocity).sum(-1)
    stopping = torch.sqrt(squared + SQUARE_FLOOR) / (2.0 * config.braking) + turning
    reach = torch.sqrt(((plane + velocity * stopping[..., None]) ** 2).sum(-1) + SQUARE_FLOOR)
    height = (z + vz * (vz.abs() / (2.0 * config.braking) + turning)).abs()
    speed = torch.sqrt(squared + vz * vz + SQUARE_FLOOR)
    beyond = (
        torch.relu(reach - REACH_MARGIN * REACH)
        + torch.relu(height - HEIGHT_MARGIN * drawn.height[:, None])
        + SPEED_WEIGHT * torch.relu(speed - SPEED_MARGIN * drawn.speed[:, None])
    )
    step = torch.diff(moved.u, dim=1, prepend=torch.zeros_like(moved.u[:, :1]))
    change = torch.sqrt((step * step).sum(-1) + SQUARE_FLOOR)
    too_much = torch.relu(change - JERK_MARGIN * DT * drawn.jerk[:, None])
    return (
        tracking_price(errors)
        + config.beta * masked_mean(beyond, drawn.mask)
        + config.gamma * masked_mean(change, drawn.mask)
        + config.jerk_price * masked_mean(too_much, drawn.mask)
    )
