"""The losses L and L' (Eqs. 19-25), with the covariances in closed form.

Time line: row k of `states` is the state at t_{k+1}, after u[k]; row k of `covariance` belongs to u[k].
"""

from __future__ import annotations

import math
from typing import NamedTuple

import torch
from torch import Tensor

from runtime.physics.law import DT
from train.learn.parallel import masked_mean

POSITION_STD_FLOOR = 1e-3
"""Standard deviation (m) whose square is added to the position covariance: errors below 1 mm are good enough."""


class Weights(NamedTuple):
    """Weights of Eq. 21, and the pan limit of Eq. 23 (m)."""

    alpha: float
    beta: float
    gamma: float
    pan_limit: float


def position_covariance(covariance: Tensor, dt: float = DT) -> Tensor:
    """Covariance of the position after each sample, by Eqs. 19 and 20 from a known start.

    The recursion S[k+1] = A S[k] A' + B Su[k] B' has the position block
    sum over j <= k of (dt^2 (k - j + 1/2))^2 Su[j]; the square is expanded so that three cumulative sums give it.

    Args:
        covariance: (B, K, 3) xx, xy, yy of the input covariance Su[k] ((m/s^2)^2), float64.
        dt: sampling interval (s).

    Returns:
        (B, K, 3) xx, xy, yy of the position covariance (m^2) after sample k.
    """
    j = torch.arange(covariance.shape[1], dtype=covariance.dtype, device=covariance.device)[:, None]
    lead = j + 0.5
    zeroth = torch.cumsum(covariance, dim=1)
    first = torch.cumsum(covariance * j, dim=1)
    second = torch.cumsum(covariance * j * j, dim=1)
    return (lead * lead * zeroth - 2.0 * lead * first + second) * dt**4


def gaussian_nll(error: Tensor, covariance: Tensor, floor: float = POSITION_STD_FLOOR) -> Tensor:
    """Negative log-likelihood as printed in Eqs. 22 and 25: log(2 pi sqrt(det S)) + e' S^-1 e.

    Args:
        error: (B, K, 2) position error (m).
        covariance: (B, K, 3) xx, xy, yy of S (m^2).
        floor: standard deviation (m) whose square is added to the diagonal of S.

    Returns:
        (B, K).
    """
    xx = covariance[..., 0] + floor * floor
    yy = covariance[..., 2] + floor * floor
    xy = covariance[..., 1]
    determinant = xx * yy - xy * xy
    ex, ey = error[..., 0], error[..., 1]
    quadratic = (yy * ex * ex - 2.0 * xy * ex * ey + xx * ey * ey) / determinant
    return math.log(2.0 * math.pi) + 0.5 * torch.log(determinant) + quadratic


def loss_pan(states: Tensor, covariance: Tensor, pan_position: Tensor, mask: Tensor) -> Tensor:
    """L' (Eq. 25): the pan against the pan motion that generated the command, no law of friction in between.

    Args:
        states: (B, K, 8) states after each sample.
        covariance: (B, K, 3) input covariances.
        pan_position: (B, K, 2) wanted pan position at the same instants (m).
        mask: (B, K) 1 for the samples that count.
    """
    error = states[..., 0:2] - pan_position
    return masked_mean(gaussian_nll(error, position_covariance(covariance)), mask)


def pan_reach(states: Tensor) -> Tensor:
    """Return how far the pan is from its centre, (B, K) (m), of (B, K, 8) states."""
    reach: Tensor = torch.linalg.vector_norm(states[..., 0:2], dim=-1)
    return reach


def loss_object(
    states: Tensor, u: Tensor, covariance: Tensor, object_position: Tensor, mask: Tensor, weights: Weights
) -> Tensor:
    """L (Eq. 21): the object against the command, the pan against its limit, and the change of acceleration.

    The object's input covariance of Eq. 20, which the paper leaves open, is the pan's.

    Args:
        states: (B, K, 8) states after each sample.
        u: (B, K, 2) pan accelerations (m/s^2).
        covariance: (B, K, 3) input covariances.
        object_position: (B, K, 2) commanded object position at the same instants, relative to the pan (m).
        mask: (B, K) 1 for the samples that count.
        weights: alpha, beta, gamma and the pan limit.
    """
    error = states[..., 4:6] - object_position
    tracking = masked_mean(gaussian_nll(error, position_covariance(covariance)), mask)
    over = masked_mean(torch.relu(pan_reach(states) - weights.pan_limit), mask)
    change = torch.linalg.vector_norm(torch.diff(u, dim=1, prepend=torch.zeros_like(u[:, :1])), dim=-1)
    return weights.alpha * tracking + weights.beta * over + weights.gamma * masked_mean(change, mask)
