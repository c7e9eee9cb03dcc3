"""What a trainer asks of that which it trains: a network, batches, a loss, and figures to judge it by."""

from __future__ import annotations

import math
from typing import Any, NamedTuple, Protocol

import torch
from torch import Tensor, nn


class Outcome(NamedTuple):
    """What a network made of one batch.

    Attributes:
        loss: to go down; a mean over the batch's trajectories.
        error: mean tracking error (m).
        reach: mean of the pans' largest distances (m).
    """

    loss: Tensor
    error: Tensor
    reach: Tensor


class Recipe(Protocol):
    """One way to train one kind of network; steps count from 0, of `steps` in all."""

    def build(self) -> nn.Module:
        """Return the network with freshly drawn weights."""

    def decoding(self, network: nn.Module) -> nn.Module:
        """Return a module that uses the network as `outcome` wants it; its forward() may be distributed."""

    def stage(self, step: int, steps: int) -> int:
        """Return the number of the curriculum's stage that a step belongs to."""

    def learning_rate(self, step: int, steps: int) -> float:
        """Return the learning rate of a step."""

    def draw(self, step: int, steps: int, rows: slice) -> Any:
        """Draw rows of the batch of a step: the same rows whenever and by whomever they are asked for."""

    def outcome(self, decoding: nn.Module, drawn: Any, device: torch.device) -> Outcome:
        """Let the network move what was drawn."""

    def validate(self, network: nn.Module, device: torch.device) -> dict[str, float]:
        """Return figures (m) on fixed commands."""


def cosine_decay(highest: float, lowest: float, progress: float) -> float:
    """Return what decays from the highest to the lowest over progress in [0, 1], by half a period of the cosine."""
    return lowest + (highest - lowest) * 0.5 * (1.0 + math.cos(math.pi * progress))
