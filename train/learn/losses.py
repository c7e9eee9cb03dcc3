"""The losses L and L' (Eqs. 19-25), with the covariances in closed form.

Time line: row k of `states` is the state at t_{k+1}, after u[k]; row k of `covariance` belongs to u[k].
"""

from __future__ import annotations

import math
from typing import NamedTuple

import torch
from torch import Tensor

from runtime.physics.law import DT
from train.config import Tracking
from train.learn.parallel import mean_over_processes

POSITION_STD_FLOOR = 1e-3
"""Standard deviation (m) whose square is added to the position covariance: errors below 1 mm are good enough."""

DISTANCE_FLOOR = 3e-4
"""Distance (m) below which `distance` is flat: there is nothing to gain there."""

SPEED_FLOOR = 1e-6
"""Speed (m/s) that makes the derivative of a speed finite at rest."""

MILLIMETRE = 1e-3
"""In metres; the unit of `distance`, which makes the weights beta and gamma prices in millimetres of error."""


class Weights(NamedTuple):
    """Weights of Eq. 21, the pan limit of Eq. 23 (m), which tracking term (Eq. 22 or plain `distance`), and ours.

    `jerk` is the price of a change of acceleration beyond `largest_change` (m/s^2), on top of gamma; `braking` the
    acceleration (m/s^2) with which the pan is to be able to stop within its limit, 0 if only where it is counts, as in
    the paper.
    """

    alpha: float
    beta: float
    gamma: float
    pan_limit: float
    tracking: Tracking = "likelihood"
    jerk: float = 0.0
    largest_change: float = 10.0
    braking: float = 0.0


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


def masked_mean(values: Tensor, mask: Tensor) -> Tensor:
    """Mean of (B, K) `values` over the samples that count; the mean of all processes' is that over the whole batch."""
    return (values * mask).sum() / mean_over_processes(mask.sum())


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


def distance(error: Tensor) -> Tensor:
    """Distance in millimetres, smooth at zero: sqrt(|e|^2 + floor^2) / 1 mm.

    Where the likelihood lets the network excuse a hard command by a large covariance, this does not.

    Args:
        error: (B, K, 2) position error (m).

    Returns:
        (B, K).
    """
    return torch.sqrt((error * error).sum(-1) + DISTANCE_FLOOR**2) / MILLIMETRE


def root_mean_square(error: Tensor, mask: Tensor) -> Tensor:
    """Return the RMS distance of each trajectory, in millimetres, averaged over those of which some sample counts.

    Args:
        error: (B, K, 2) position error (m).
        mask: (B, K) 1 for the samples that count.
    """
    count = mask.sum(1)
    some = (count > 0.0).to(mask.dtype)
    squared = ((error * error).sum(-1) * mask).sum(1) / count.clamp(min=1.0)
    return masked_mean(torch.sqrt(squared + DISTANCE_FLOOR**2) / MILLIMETRE, some)


def pan_reach(states: Tensor, braking: float = 0.0) -> Tensor:
    """How far the pan is from its centre, or would be once it had braked: |p + v |v| / (2 braking)|.

    A governor holds a pan back that could not stop in reach any more, however close to the centre it is. A network that
    is not told so learns to swing it out to the edge, and is held back where it needs the pan most.

    Args:
        states: (B, K, 8) states after each sample.
        braking: with what acceleration (m/s^2); 0 for where it is.

    Returns:
        (B, K) in metres.
    """
    position = states[..., 0:2]
    if braking > 0.0:
        velocity = states[..., 2:4]
        speed = torch.sqrt((velocity * velocity).sum(-1, keepdim=True) + SPEED_FLOOR**2)
        position = position + velocity * speed / (2.0 * braking)
    reach: Tensor = torch.linalg.vector_norm(position, dim=-1)
    return reach


def loss_object(
    states: Tensor,
    u: Tensor,
    covariance: Tensor,
    object_position: Tensor,
    mask: Tensor,
    weights: Weights,
    u_before: Tensor | None = None,
) -> Tensor:
    """L (Eq. 21): the object against the command, the pan against its limit, and the change of acceleration.

    The object's input covariance of Eq. 20, which the paper leaves open, is the pan's.

    Args:
        states: (B, K, 8) states after each sample.
        u: (B, K, 2) pan accelerations (m/s^2).
        covariance: (B, K, 3) input covariances.
        object_position: (B, K, 2) commanded object position at the same instants, relative to the pan (m).
        mask: (B, K) 1 for the samples that count.
        weights: alpha, beta, gamma, the pan limit, and the price of jerk.
        u_before: (B, 2) acceleration of the sample before the first (m/s^2); zero if None.
    """
    error = states[..., 4:6] - object_position
    if weights.tracking == "likelihood":
        tracking = masked_mean(gaussian_nll(error, position_covariance(covariance)), mask)
    elif weights.tracking == "rms":
        tracking = root_mean_square(error, mask)
    else:
        tracking = masked_mean(distance(error), mask)
    reach = pan_reach(states, weights.braking)
    over = masked_mean(torch.relu(reach - weights.pan_limit), mask)
    first = torch.zeros_like(u[:, :1]) if u_before is None else u_before[:, None]
    change = torch.linalg.vector_norm(torch.diff(u, dim=1, prepend=first), dim=-1)
    loss = weights.alpha * tracking + weights.beta * over + weights.gamma * masked_mean(change, mask)
    if weights.jerk > 0.0:
        loss = loss + weights.jerk * masked_mean(torch.relu(change - weights.largest_change), mask)
    return loss
