"""Decoding in closed loop, differentiably, in the network's units: a question whenever so much was executed."""

from __future__ import annotations

from itertools import accumulate
from typing import NamedTuple

import torch
from torch import Tensor, nn

from runtime.network.units import AHEAD, CHUNK, ENCODER_CHUNK
from train.network.network import Network, observe
from train.network.situations import Step, Trajectories
from train.physics.rollout import rollout


class Moved(NamedTuple):
    """What became of B trajectories, float64: states (B, K, 10) after each sample, accelerations u (B, K, 3)."""

    states: Tensor
    u: Tensor


def decode(network: Network, trajectories: Trajectories, step: Step) -> Moved:
    """Encode the commands and follow them: ask, execute some samples of the answer, ask again."""
    drawn = trajectories
    batch, samples, _ = drawn.command.shape
    rest = torch.cat([drawn.command[:, -1:, :2], torch.zeros_like(drawn.command[:, -1:, 2:])], dim=-1)
    command = torch.cat([drawn.command, rest.expand(-1, AHEAD + ENCODER_CHUNK, -1)], dim=1)
    law = drawn.static, drawn.kinetic, drawn.gravity
    state = network.encode(_from_first(drawn.command), drawn.told)
    end = drawn.start
    seen = end[:, None].expand(-1, CHUNK, -1)
    last = end.new_zeros(batch, 3)
    first, elapsed = 0, 1.0
    moved, accelerations = [], []
    for question, count in enumerate(step.executed):
        if question == step.reread:
            left = -(-(samples - first) // ENCODER_CHUNK) * ENCODER_CHUNK
            state = network.encode(_from_first(command[:, first : first + left]), drawn.told)
        observation = observe(seen, command[:, first : first + AHEAD], last, drawn.told, elapsed, drawn.noise[question])
        answer, state = network.step(observation, drawn.told, state)
        u = answer[:, :count].double()
        push = step.pushed_at - first
        if 0 < push < count:
            before = rollout(end, u[:, :push], *law)
            end = before[:, -1] + drawn.push
            new = torch.cat([before, rollout(end, u[:, push:], *law)], dim=1)
        else:
            new = rollout(end, u, *law)
        end, last = new[:, -1], u[:, -1]
        seen = new if count == CHUNK else torch.cat([seen[:, count:], new], dim=1)
        moved.append(new)
        accelerations.append(u)
        first, elapsed = first + count, count / CHUNK
    return Moved(torch.cat(moved, dim=1), torch.cat(accelerations, dim=1))


def replay(u: Tensor, drawn: Trajectories, step: Step, static: Tensor, kinetic: Tensor) -> Moved:
    """Let pans do the same, open loop, while objects have other coefficients of friction, (B,) each."""
    law = static, kinetic, drawn.gravity
    if step.pushed_at in accumulate(step.executed):  # between two chunks nothing is pushed; see `decode`
        return Moved(rollout(drawn.start, u, *law), u)
    before = rollout(drawn.start, u[:, : step.pushed_at], *law)
    after = rollout(before[:, -1] + drawn.push, u[:, step.pushed_at :], *law)
    return Moved(torch.cat([before, after], dim=1), u)


class Decoding(nn.Module):
    """`decode` as a module's forward(), around which DistributedDataParallel averages the gradients."""

    def __init__(self, network: Network) -> None:
        super().__init__()
        self.network = network

    def forward(self, trajectories: Trajectories, step: Step) -> Moved:
        """Decode in closed loop; see `decode`."""
        return decode(self.network, trajectories, step)


def _from_first(command: Tensor) -> Tensor:
    """Return commands (B, K, 4) relative to their first positions."""
    return torch.cat([command[..., :2] - command[:, :1, :2], command[..., 2:]], dim=-1)
