"""Decoding in closed loop, differentiably: the network's accelerations move the pan, the states come back to it."""

from __future__ import annotations

from typing import NamedTuple

import torch
from torch import Tensor

from train.network.model import Seq2Seq
from train.physics.rollout import rollout


class Prediction(NamedTuple):
    """What a network makes of B commands, all float64.

    Attributes:
        states: (B, K, 8) of pan and object after each sample (m, m/s).
        u: (B, K, 2) pan accelerations (m/s^2).
        covariance: (B, K, 3) xx, xy, yy of the accelerations ((m/s^2)^2).
    """

    states: Tensor
    u: Tensor
    covariance: Tensor


def at_rest(batch: int, chunk: int, device: torch.device) -> Tensor:
    """Return the (B, C, 8) states that lead to a start at rest, the pan in the middle, the object on its mark."""
    return torch.zeros(batch, chunk, 8, dtype=torch.float64, device=device)


def decode(
    model: Seq2Seq,
    command: Tensor,
    static: Tensor,
    kinetic: Tensor,
    through_contact: bool = True,
    before: Tensor | None = None,
    noise: Tensor | None = None,
) -> Prediction:
    """Encode `command` and decode it in closed loop (Section II-C), chunk by chunk.

    Args:
        model: the network.
        command: (B, K, 4) float64 command positions and velocities, K a multiple of the chunk.
        static, kinetic: (B,) coefficients mu and mu', which the network is not told.
        through_contact: whether gradients pass the object's states, which is to say the law of friction; L' must
            not (Section III-B).
        before: (B, C, 8) float64 states that the first iteration sees, the last of which is the start; at rest if
            None.
        noise: (B, K, 8) added to the states as the network sees them, not to the states; none if None.

    Returns:
        The prediction; its rows are the states after each sample, so row K - 1 is the state at t_K.
    """
    batch, samples, _ = command.shape
    chunk = model.chunk
    chunks = command.reshape(batch, samples // chunk, 4 * chunk).float()
    state = model.encode(chunks)
    decoder = model.decoder(chunks)
    seen = at_rest(batch, chunk, command.device) if before is None else before
    start = seen[:, -1]
    moved, accelerations, covariances = [], [], []
    for n in range(samples // chunk):
        output, state = decoder.step(n, seen, state)
        u = output.acceleration.double()
        seen = rollout(start, u, static, kinetic)
        start = seen[:, -1]
        moved.append(seen)
        accelerations.append(u)
        covariances.append(output.covariance.double())
        if not through_contact:
            seen = torch.cat([seen[..., :4], seen[..., 4:].detach()], dim=-1)
            start = seen[:, -1]
        if noise is not None:
            seen = seen + noise[:, n * chunk : (n + 1) * chunk]
    return Prediction(torch.cat(moved, 1), torch.cat(accelerations, 1), torch.cat(covariances, 1))
