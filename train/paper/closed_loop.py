"""Decoding in closed loop, differentiably: the network's accelerations move the pan, the states come back to it."""

from __future__ import annotations

from typing import NamedTuple

import torch
from torch import Tensor, nn

from train.paper.network import PaperNetwork
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
    network: PaperNetwork, command: Tensor, static: Tensor, kinetic: Tensor, through_contact: bool = True
) -> Prediction:
    """Encode `command` and decode it in closed loop (Section II-C), chunk by chunk.

    Args:
        network: the network.
        command: (B, K, 4) float64 command positions and velocities, K a multiple of the chunk.
        static, kinetic: (B,) coefficients mu and mu', which the network is not told.
        through_contact: whether gradients pass the object's states, which is to say the law of friction; L' must
            not (Section III-B).

    Returns:
        The prediction; its rows are the states after each sample, so row K - 1 is the state at t_K.
    """
    batch, samples, _ = command.shape
    chunk = network.chunk
    state = network.encode(command.reshape(batch, samples // chunk, 4 * chunk).float())
    seen = at_rest(batch, chunk, command.device)
    moved, accelerations, covariances = [], [], []
    for _ in range(samples // chunk):
        output, state = network.step(seen, state)
        u = output.acceleration.double()
        seen = rollout(seen[:, -1], u, static, kinetic)
        moved.append(seen)
        accelerations.append(u)
        covariances.append(output.covariance.double())
        if not through_contact:
            seen = torch.cat([seen[..., :4], seen[..., 4:].detach()], dim=-1)
    return Prediction(torch.cat(moved, 1), torch.cat(accelerations, 1), torch.cat(covariances, 1))


class Decoding(nn.Module):
    """`decode` as a module's forward(), around which DistributedDataParallel averages the gradients."""

    def __init__(self, network: PaperNetwork) -> None:
        super().__init__()
        self.network = network

    def forward(self, *arguments: object) -> Prediction:
        """Decode in closed loop; see `decode`."""
        return decode(self.network, *arguments)  # type: ignore[arg-type]
